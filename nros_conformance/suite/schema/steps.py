"""What happens: the steps of a script, and what callbacks do."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from msgspec import field

from nros_conformance.formats.durations import Duration, Period
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.schema.words import Base, EntityName, FaultName, Identifier, KindName


class Step(Base, frozen=True, kw_only=True):
    """Common to all steps."""

    as_: Identifier | None = field(default=None, name="as")
    at: Moment | None = None
    """Begin at this moment instead of after the step before."""


class Drive(Step, frozen=True, kw_only=True):
    """Let time pass; nothing is called but drive_io, in the background, unless an ``idle`` runs beside it."""

    drive: Duration


class Idle(Step, frozen=True, kw_only=True):
    """Let time pass; nobody calls drive_io."""

    idle: Duration


class Phase(Step, frozen=True, kw_only=True):
    """Let a part of this time pass, drawn by the play's seed: stimuli at round times hide poll grids."""

    phase: Duration


class Cycle(Step, frozen=True, kw_only=True):
    """Play a script so many times. What happens is summed up cycle by cycle, and not written down one by one.

    Only `cycles` can say what is expected of it; a last cycle that is to be looked at closely follows it.
    """

    cycle: int
    script: list[Any]


class Parallel(Step, frozen=True, kw_only=True):
    """Branches that run side by side; the step ends with the last of them."""

    parallel: list[list[Any]]


class Fault(Step, frozen=True, kw_only=True):
    """Inject a fault. ``of`` names the session or entity that it hits.

    ``lose``, ``duplicate``, ``reorder``: that publisher publishes ``count`` samples under this step's
    label, and none of them arrives, each arrives twice, the last one arrives first.
    ``partition``: nothing passes between that session and the others; ``block``: nothing ``out`` of it,
    or ``in``; ``delay``: what it sends arrives ``by`` so much later; ``stall``: what it sends stops in the middle
    of a frame; ``bus_off``: its controller is off the bus; ``heal``: all passes again, in order what was held back.
    ``inject``: ``count`` malformed packets reach that session.
    ``crash``: SIGKILL to the process of that session, which has one of its own; ``freeze``: SIGSTOP, until
    ``thaw``; ``clock_step``: its wall clock is set forward by ``by``, or back if that is negative.
    ``stop``: the peer of the sessions (agent, router, broker) ends, with ``kill`` by SIGKILL; ``start``: a new
    one begins at the same endpoint, which knows nothing of the one before. Neither takes an ``of``.
    ``preset``: the total (or alive_count) of event ``kind`` on that entity becomes ``count``; without
    ``kind``, the number that the wire or the queue gives to the next sample of its topic.
    """

    fault: FaultName
    of: EntityName | None = None
    count: int | None = None
    kind: KindName | None = None
    by: Duration | None = None
    for_: Duration | None = field(default=None, name="for")
    direction: Literal["out", "in"] | None = None
    kill: bool = False


class Until(Step, frozen=True, kw_only=True):
    """Drive in the background until something is so, at most for ``limit``; answers whether it was.

    ``heard``: publisher ``by`` publishes ``every`` so often until ``of`` (``take: always``) has taken one of
    these samples. ``reported``: ``session`` has answered anything but OK: drive_io in the background, a ping
    ``every`` so often (with that timeout), or ``by`` publishing, if it is named. ``reachable``: a ping before
    any session, ``every`` so often, answers OK. ``connected``: the reconnector of ``session`` is connected.
    """

    until: Literal["heard", "reported", "reachable", "connected"]
    limit: Duration
    every: Duration = Duration.parse("0.5T")
    by: EntityName | None = None
    of: EntityName | None = None
    session: Identifier | None = None


class Repeat(Step, frozen=True, kw_only=True):
    """The same steps several times, one turn after the other; the actions of a label are numbered on."""

    repeat: int
    script: list[Any]


class Settle(Step, frozen=True, kw_only=True):
    """Wait until publishers and subscriptions of one topic know each other; recorded as ``matched``."""

    do: Literal["settle"]


class Repeated(Step, frozen=True, kw_only=True):
    """A doing that may happen several times: ``times`` times, begun ``every`` so often (0: at once)."""

    times: int = 1
    every: Duration = Duration.parse(0)


class Publish(Repeated, frozen=True, kw_only=True):
    """``publish_raw`` with the next sequence number of that publisher."""

    do: Literal["publish"]
    by: EntityName
    size: int | None = None
    """Bytes of the serialized sample, when it matters. One of 0 bytes cannot say who sent it."""


class Assert(Repeated, frozen=True, kw_only=True):
    """``assert_liveliness``."""

    do: Literal["assert"]
    by: EntityName


class Take(Repeated, frozen=True, kw_only=True):
    """``try_recv_raw``: ``max`` samples, default all there are."""

    do: Literal["take"]
    from_: EntityName = field(name="from")
    max: int | None = None
    size: int = 65536
    """Room in the caller's buffer, bytes."""


class HasData(Repeated, frozen=True, kw_only=True):
    """``has_data``."""

    do: Literal["has_data"]
    of: EntityName


class Register(Repeated, frozen=True, kw_only=True):
    """``register_event``. ``kind`` may be any integer; ``callback: none`` passes no callback."""

    do: Literal["register"]
    of: EntityName
    kind: KindName | int
    deadline: Period | None = None
    callback: Literal["given", "none"] = "given"
    context: str | None = None
    """Handed to the callback; default: the step's label."""


class Supports(Repeated, frozen=True, kw_only=True):
    """``supports_event``."""

    do: Literal["supports"]
    of: EntityName
    kind: KindName | int


class Create(Step, frozen=True, kw_only=True):
    """Create a deferred entity."""

    do: Literal["create"]
    entity: EntityName
    stale: bool = False
    """On the session as it is, also if it is destroyed; else a destroyed session is created anew before."""


class Destroy(Repeated, frozen=True, kw_only=True):
    """Destroy an entity or a session."""

    do: Literal["destroy"]
    of: EntityName


class Call(Repeated, frozen=True, kw_only=True):
    """``drive_io``, called by the script itself; that session is not driven in the background meanwhile."""

    do: Literal["drive"]
    session: Identifier = "sub"
    timeout: Duration


class Spin(Repeated, frozen=True, kw_only=True):
    """One spin of an executor: messages and events, at most ``cap`` callbacks."""

    do: Literal["spin"]
    session: Identifier = "sub"
    timeout: Duration
    cap: int | None = None


class Ping(Repeated, frozen=True, kw_only=True):
    """``ping``, of ``session``, or without one the ping before any session exists."""

    do: Literal["ping"]
    session: Identifier | None = None
    timeout: Duration
    attempts: int = 1


class Released(Step, frozen=True, kw_only=True):
    """Whether callback and context of these registrations are gone, now that nobody else refers to them."""

    do: Literal["released"]
    registration: Identifier
    """The label of a register step."""
    but_last: bool = False
    """Of all but the last one, which is still in force."""


Quantity: TypeAlias = Literal["cpu", "threads", "descriptors", "memory", "listed", "checks", "probes"]


class Measure(Step, frozen=True, kw_only=True):
    """Write down a quantity.

    Of the process: ``cpu``, the processor time that all its threads have used; ``threads`` and ``descriptors``, how
    many there are; ``memory``, bytes that are resident after the garbage is collected. As the peer tells it:
    ``listed``, how many entities with the topic and the side of entity ``of`` it has in its graph;
    ``checks``, how many hard liveliness pings it has sent; ``probes``, how many pings of clients it has seen.
    """

    do: Literal["measure"]
    what: Quantity
    of: EntityName | None = None


class Raise(Step, frozen=True, kw_only=True):
    """Raise an exception out of the callback. Only as the last step of a reaction."""

    do: Literal["raise"]


class Reaction(Base, frozen=True, kw_only=True):
    """What a status callback does when it runs, beside being written down.

    Its steps are calls on the callback's own session, made on the thread that runs the callback.
    """

    to: KindName
    of: EntityName
    times: int = 1
    """The first so many callbacks do it."""
    script: list[Any]


Doing: TypeAlias = (
    Settle
    | Publish
    | Assert
    | Take
    | HasData
    | Register
    | Supports
    | Create
    | Destroy
    | Call
    | Spin
    | Ping
    | Released
    | Measure
    | Raise
)
AnyStep: TypeAlias = Drive | Idle | Phase | Cycle | Parallel | Fault | Until | Repeat | Doing

DOINGS: dict[str, type[Step]] = {
    "settle": Settle, "publish": Publish, "assert": Assert, "take": Take, "has_data": HasData, "register": Register,
    "supports": Supports, "create": Create, "destroy": Destroy, "drive": Call, "spin": Spin, "ping": Ping,
    "released": Released, "measure": Measure, "raise": Raise,
}  # fmt: skip
"""By the value of ``do``."""

STEPS: dict[str, type[Step]] = {
    "drive": Drive, "idle": Idle, "phase": Phase, "cycle": Cycle, "parallel": Parallel, "fault": Fault, "until": Until,
    "repeat": Repeat,
}  # fmt: skip
"""By head; a step with ``do`` is one of `DOINGS`."""
