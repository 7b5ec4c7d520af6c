from __future__ import annotations

from collections.abc import Iterator

import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.node import Context
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import VirtualClock
from tests.node.pair import Pair


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def context(clock: VirtualClock) -> Iterator[Context]:
    with Context(ReferenceBackend(Host(clock))) as context:
        yield context


@pytest.fixture
def pair(context: Context) -> Pair:
    return Pair(context)
