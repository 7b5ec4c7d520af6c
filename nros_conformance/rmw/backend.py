"""The contract that an adapter implements: the nano-ros vtable in Python terms (``nros/rmw_vtable.h``).

Calls answer with return codes (plain integers, so that a code outside the published set can be
observed); creation raises `RmwError`. Event kinds are plain integers at this border.

What an adapter has to write is small: `Backend.create_session`, and of the three entities the
abstract methods. Everything else has the default that the contract gives it.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeAlias

from nros_conformance.rmw.child import Launcher, launch
from nros_conformance.rmw.clock import Clock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventCallback, Side
from nros_conformance.rmw.qos import QosProfile

MessageCallback: TypeAlias = Callable[[object], None]
"""``callback(context)``: a sample can be taken from the subscription it was registered on."""


@dataclasses.dataclass(frozen=True, slots=True)
class Host:
    """What the harness lends a backend for one scenario.

    ``network`` numbers the scenarios that live at the same time on this host, so that each can have a
    domain, port or partition of its own; ``ports`` are leased for this run alone. ``scratch`` is a folder
    that this play alone may create and use; what is left in it stays beside the trace.
    ``processes``: some session of this play lives in a process of its own, with an adapter of its own
    (same ``network``, ``ports``, ``scratch``), so memory does not connect them. ``faults``: those that
    `Backend.inject` may be asked for, so that what they take need not stand in the way of other scenarios.
    ``launch``: starts a module of the backend as a process of its own.
    """

    clock: Clock
    variant: str = ""
    network: int = 0
    ports: range = range(0)
    scratch: Path = Path()
    processes: bool = False
    faults: frozenset[str] = frozenset()
    options: Mapping[str, str] = dataclasses.field(default_factory=dict)
    launch: Launcher = launch

    @property
    def peer_untouched(self) -> bool:
        """Whether nothing will happen to the agent or router but sessions that come and go (`Environment.release`)."""
        return not self.faults and not self.processes


@dataclasses.dataclass(frozen=True, slots=True)
class SessionOptions:
    """Arguments of ``create_session``. ``domain_id`` 0 is the scenario's own domain, 1 its neighbour.

    ``connection_lease_ms`` and ``hard_liveliness_ms``: 0 means the backend's default, respectively off.
    """

    node_name: str = "node"
    locator: str = ""
    mode: str = "client"
    domain_id: int = 0
    connection_lease_ms: int = 0
    hard_liveliness_ms: int = 0


class Entity(abc.ABC):
    """What publishers and subscriptions have in common.

    ``qos`` is what is in force, which an adapter may have had to complete.
    """

    topic: str
    type_name: str
    qos: QosProfile

    @abc.abstractmethod
    def supports_event(self, kind: int) -> bool:
        """Whether `register_event` would answer OK for this kind on this entity (REG-001)."""

    @abc.abstractmethod
    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        """Have ``callback(kind, status, context)`` called from `Session.drive_io`.

        ``deadline_ms`` matters for the two deadline kinds when the QoS states no deadline (C04).
        Answers OK, UNSUPPORTED, INVALID_ARGUMENT (no callback, destroyed entity) or INCOMPATIBLE_QOS
        (a deadline kind without any finite period). A second registration replaces the first.
        """

    @abc.abstractmethod
    def destroy(self) -> int:
        """Release everything; no callback runs afterwards. A second call is harmless (LIF-004)."""


class Publisher(Entity):
    """The sending end."""

    @abc.abstractmethod
    def publish_raw(self, data: bytes) -> int:
        """Send one serialized sample."""

    def assert_liveliness(self) -> int:
        """OK without effect for AUTOMATIC and NONE, else what the backend can do (LVL-003)."""
        return ReturnCode.UNSUPPORTED if self.qos.liveliness.is_manual else ReturnCode.OK


class Subscription(Entity):
    """The receiving end."""

    @abc.abstractmethod
    def has_data(self) -> bool | int:
        """Whether `try_recv_raw` would return a sample, without taking it; or a negative code."""

    @abc.abstractmethod
    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample, or NO_DATA, BUFFER_TOO_SMALL or another negative code."""

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        """Have ``callback(context)`` called from `Session.drive_io` for each sample, in order with events.

        A backend without it answers UNSUPPORTED; the executor then looks at `has_data` after the drive.
        """
        return ReturnCode.UNSUPPORTED


class Session(abc.ABC):
    """A connection to the middleware, driven by the thread that calls `drive_io`."""

    @abc.abstractmethod
    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        """Raises `RmwError`: INCOMPATIBLE_QOS, TOPIC_NAME_INVALID, INVALID_ARGUMENT, CONNECTION_FAILED..."""

    @abc.abstractmethod
    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        """Raises `RmwError` as `create_publisher` does."""

    @abc.abstractmethod
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """Move bytes and dispatch callbacks, for at most ``timeout_ms``; OK when idle (C09).

        At most ``max_callbacks`` run, messages and events together; what is left runs in later calls.
        """

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        """OK if the peer answered this very probe in time, TIMEOUT if not, UNSUPPORTED without a round trip."""
        return ReturnCode.UNSUPPORTED

    @abc.abstractmethod
    def destroy(self) -> int:
        """Close, and release everything of this session in bounded time, also with a dead peer."""


class Listed(NamedTuple):
    """A client's entity as the peer lists it; ``topic`` as it was given to ``create_*``."""

    side: Side
    topic: str


class Environment:
    """An agent, router or broker that a backend needs beside it. The default needs none.

    The harness calls `Backend.environment` once per play and is the only one that starts and stops what it
    gets; its calls come one at a time, from another thread than those of the sessions.
    """

    def start(self) -> None:
        """Start it, at the same `endpoint` each time and knowing nothing of before; returns when it answers.

        Raises `RmwError` CONNECTION_FAILED with the reason when it does not come up.
        """

    def stop(self, *, kill: bool = False) -> None:
        """Stop it, orderly or with SIGKILL; returns when it is gone. Harmless when it does not run.

        Raises `RmwError` UNSUPPORTED for one that somebody else runs.
        """

    def release(self) -> None:
        """The play is over, its sessions closed: stop it, or leave it to the next play if it is as good as new."""
        self.stop()

    def endpoint(self) -> str:
        """What a client puts into `SessionOptions.locator`; empty when there is nothing."""
        return ""

    def log(self) -> str:
        """What it has printed so far, in all its lives."""
        return ""

    def processes(self) -> Sequence[int]:
        """Ids of the processes of this machine in which it runs now, asked at any time and from any thread.

        Where one of them gets no core, what comes late is not the backend's fault.
        """
        return ()

    def entities(self) -> Sequence[Listed] | None:
        """The publishers and subscriptions of all clients in its graph now; None: it cannot be asked."""
        return None

    def counts(self) -> Mapping[str, int]:
        """What it has counted on the wire so far, in all its lives, as far as it can be asked.

        ``checks``: hard liveliness pings that it has sent; ``probes``: pings of clients that reached it.
        """
        return {}


class Backend(abc.ABC):
    """One middleware. A fresh instance plays each scenario."""

    option_names: ClassVar[Collection[str] | None] = ()
    """What ``--option NAME=VALUE`` may set in `Host.options`; None: any name, the adapter hands them on."""

    def __init__(self, host: Host) -> None:
        self.host = host

    @abc.abstractmethod
    def create_session(self, options: SessionOptions) -> Session:
        """Open a session; raises `RmwError` CONNECTION_FAILED, INVALID_CONFIG..."""

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        """A ping before any session exists."""
        return ReturnCode.UNSUPPORTED

    def close(self) -> None:  # noqa: B027 - most backends share nothing
        """Release what outlives the sessions, such as a network that they share."""

    # Harness hooks, outside the contract.

    def environment(self) -> Environment:
        """The peer that has to run beside the sessions."""
        return Environment()

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool | None:
        """Wait, without sending data, until both ends know each other; None: this backend cannot tell.

        Called from the harness while other threads drive both sessions.
        """
        return None

    def matched(self, entity: Entity) -> int | None:
        """How many entities at the other end it knows now; None: this backend cannot tell.

        Asked where the two ends live in different processes; called on the thread of its session.
        """
        return None

    def inject(self, fault: str, **arguments: Any) -> int:
        """Inject a fault that the declaration lists under ``[faults]``; OK, or why not.

        Called on the thread of the session that it hits, outside of callbacks.

        - ``lose``, ``duplicate``, ``reorder`` (``entity``: a publisher, ``count``, ``publish``): call
          ``publish()`` so often; none of these samples arrives, each arrives twice, the last one arrives
          first. Afterwards all is as before.
        - ``preset`` (``entity``, ``count``, ``kind``: int or None): the total (alive_count) of that event
          on this entity becomes ``count``, as if so much had been reported; for None the number by which
          losses are found, of the entity's topic, so that the next sample follows it. Nothing is lost.
        - ``partition`` (``session``): nothing passes between it and the others any more;
          ``block`` (``session``, ``direction``: "out" or "in"): nothing of what it sends, respectively of
          what others send to it; ``delay`` (``session``, ``by_ns``): what it sends arrives so much later;
          ``stall`` (``session``): what it sends stops in the middle of a frame, and goes on after ``heal``;
          ``bus_off`` (``session``): its controller is off the bus. ``heal`` (``session``), declared with any
          of these, ends that.
        - ``inject`` (``session``, ``count``, ``seed``): so many malformed, truncated, foreign and oversized
          packets reach the wire end of that session, always the same ones for a seed.
        - ``crash``, ``freeze``, ``thaw``, ``clock_step`` (``session``, ``by_ns``): only on the virtual clock,
          where no process can be hit: the session ends without a word, stands still, goes on, or has its
          wall clock set. On the real clock they are declared too, and the harness does it to the process.
        """
        return ReturnCode.UNSUPPORTED

    def lacking(self) -> Mapping[str, str]:
        """Faults that are declared, but cannot be injected with the options of `host`, and why: one line each."""
        return {}

    def versions(self) -> Mapping[str, str]:
        """Name and version of the middleware packages in use, for the report."""
        return {}
