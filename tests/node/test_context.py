from __future__ import annotations

import gc
import sys
import weakref
from pathlib import Path

import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.node import Context, Executor
from nros_conformance.rmw.backend import Backend, Environment, Host, Session, SessionOptions
from nros_conformance.rmw.clock import VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from tests.node.fakes import QueueSession
from tests.node.pair import TOPIC, TYPE


def test_a_backend_by_name_lives_on_the_real_clock() -> None:
    with Context("uorb") as context:
        assert not context.clock.virtual
        node = context.create_node("listener")
        assert Executor(node).clock is context.clock
        assert Executor(node).spin_once() == ReturnCode.OK


def test_a_host_may_be_lent() -> None:
    clock = VirtualClock()
    with Context("reference", Host(clock, network=3)) as context:
        assert context.clock is clock
        assert context.backend.host.network == 3


def test_a_backend_that_exists_keeps_its_host() -> None:
    with pytest.raises(TypeError, match=r"^a backend that exists has its host already$"):
        Context(ReferenceBackend(Host(VirtualClock())), Host(VirtualClock()))


def test_nodes_of_one_context_meet(context: Context) -> None:
    got: list[bytes] = []
    listener = context.create_node("listener")
    listener.create_subscription(TYPE, TOPIC, got.append)
    context.create_node("talker").create_publisher(TYPE, TOPIC).publish(b"hello")
    Executor(listener).spin_once()
    assert got == [b"hello"]


def test_an_unknown_backend_is_an_error_that_tells_the_known_ones() -> None:
    with pytest.raises(RmwError) as caught:
        Context("cyclon")
    assert caught.value.code is ReturnCode.UNKNOWN_BACKEND
    assert str(caught.value) == "UNKNOWN_BACKEND (-17): no backend 'cyclon'; did you mean 'cyclone'?"


@pytest.mark.parametrize(("name", "detail"), [
    ("nros_backends.uorb:Nothing", "uorb/__init__.py: there is no class 'Nothing'; valid are UorbBackend"),
    ("nros_backends.uorb.bus:Bus", "bus.py: Bus is no adapter; derive it from nros_conformance.rmw.backend.Backend"),
])  # fmt: skip
def test_a_name_of_something_else_is_an_unknown_backend(name: str, detail: str) -> None:
    with pytest.raises(RmwError) as caught:
        Context(name)
    assert caught.value.code is ReturnCode.UNKNOWN_BACKEND
    assert str(caught.value).startswith("UNKNOWN_BACKEND (-17): ")
    assert str(caught.value).endswith(detail)


def test_missing_middleware_is_an_error_with_the_command_that_mends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.startswith("nros_backends.cyclone.")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.delitem(sys.modules, "nros_backends.cyclone", raising=False)
    for module in ["cyclonedds", *(name for name in sys.modules if name.startswith("cyclonedds."))]:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(RmwError) as caught:
        Context("cyclone")
    assert caught.value.code is ReturnCode.NO_BACKEND
    assert caught.value.detail.endswith('; pip install "nros-conformance[cyclone]"')


def test_a_backend_without_a_declaration_is_good_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "undeclared_backend"
    folder.mkdir()
    (folder / "__init__.py").write_text("from nros_backends.uorb import UorbBackend as Mine\n")
    monkeypatch.syspath_prepend(tmp_path)
    with Context("undeclared_backend:Mine") as context:
        assert type(context.backend).__name__ == "UorbBackend"
    with pytest.raises(RmwError) as caught:
        Context("undeclared_backend.absent:Mine")
    assert str(caught.value) == "NO_BACKEND (-15): No module named 'undeclared_backend.absent'"


# Closing, and what stands beside a backend.


class Agent(Environment):
    def __init__(self, log: list[str]) -> None:
        self._log = log

    def start(self) -> None:
        self._log.append("agent started")

    def stop(self, *, kill: bool = False) -> None:
        self._log.append("agent stopped")

    def endpoint(self) -> str:
        return "127.0.0.1:2019"


class AgentBackend(Backend):
    """Writes down what is asked of it; needs an agent beside it."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.said: list[str] = []
        self.destroy_code: int = ReturnCode.OK

    def create_session(self, options: SessionOptions) -> Session:
        self.said.append(f"{options.node_name} at {options.locator} in {options.domain_id}")
        session = QueueSession()
        session.destroy_code = self.destroy_code
        return session

    def environment(self) -> Environment:
        return Agent(self.said)

    def close(self) -> None:
        self.said.append("closed")


def test_a_backend_that_needs_a_peer_gets_one_unless_there_is_a_locator() -> None:
    backend = AgentBackend(Host(VirtualClock()))
    with Context(backend) as context:
        context.create_node("far", SessionOptions(locator="10.0.0.1:8888"))
        context.create_node("near", SessionOptions(node_name="replaced", domain_id=1))
        context.create_node("near too")
    assert backend.said == [
        "far at 10.0.0.1:8888 in 0", "agent started", "near at 127.0.0.1:2019 in 1", "near too at 127.0.0.1:2019 in 0",
        "agent stopped",
    ]  # fmt: skip


def test_a_node_that_cannot_be_destroyed_is_reported_and_the_rest_is_closed() -> None:
    backend = AgentBackend(Host(VirtualClock()))
    backend.destroy_code = ReturnCode.TIMEOUT
    context = Context(backend)
    nodes = [context.create_node(name) for name in ("first", "second")]
    with pytest.raises(RmwError, match=r"^TIMEOUT \(-2\): destroying the node first$") as caught:
        context.close()
    assert str(caught.value.__context__) == "TIMEOUT (-2): destroying the node second"
    assert backend.said[-1] == "agent stopped"
    for node in nodes:
        node.destroy()
    context.close()
    assert backend.said.count("agent stopped") == 1


def test_a_destroyed_node_is_not_kept_by_its_context(context: Context) -> None:
    references = []
    for _ in range(3):
        node = context.create_node("node")
        references.append(weakref.ref(node))
        node.destroy()
        del node
    gc.collect()
    assert [reference() for reference in references] == [None, None, None]


def test_creation_that_fails_raises_what_the_backend_raised(context: Context) -> None:
    node = context.create_node("node")
    with pytest.raises(RmwError) as caught:
        node.create_publisher(TYPE, "not a name")
    assert caught.value.code is ReturnCode.TOPIC_NAME_INVALID


def test_a_backend_made_from_a_name_is_closed_with_its_context(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[Backend] = []
    monkeypatch.setattr("nros_backends.uorb.backend.UorbBackend.close", lambda backend: closed.append(backend))
    with Context("uorb") as context:
        pass
    assert closed == [context.backend]
