"""The suite format, version 1, as types. The JSON Schema (`jsonschema.py`) is generated from them.

A step or an expectation is a mapping whose *head*, its first word, says what it is; `STEPS`, `DOINGS`,
`GIVENS` and `EXPECTATIONS` list the heads. Fields that name Python keywords end in ``_`` here only.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from msgspec import Meta, Struct, field

from nros_conformance.formats.durations import Duration, Period
from nros_conformance.suite.moments import Moment

Profile: TypeAlias = Literal["smoke", "standard", "publish"]
PROFILES: tuple[Profile, ...] = ("smoke", "standard", "publish")
"""Each one includes those before it."""

KindName: TypeAlias = Literal[
    "LivelinessChanged", "RequestedDeadlineMissed", "MessageLost", "LivelinessLost", "OfferedDeadlineMissed"
]
KindOrAny: TypeAlias = KindName | Literal["ANY"]
Identifier: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
EntityName: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_-]*(\[[0-9]+\])?$")]
"""An entity where it is referred to; ``crowd[0]`` is one of an entity with a count."""
RequirementId: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Z]{3}-[0-9]{3}$")]
ScenarioId: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z]+\.[a-z0-9-]+$")]
# Alone it is plain text, without the pattern: a union of a list and a text with a pattern makes msgspec (0.19 to
# 0.22) crash in every third process that ends (https://github.com/msgspec/msgspec/issues/717 has the same picture).
EntityNames: TypeAlias = str | list[EntityName]
Labels: TypeAlias = str | list[Identifier]
FaultName: TypeAlias = Literal[
    "crash", "freeze", "thaw", "lose", "duplicate", "reorder", "delay", "block", "partition", "heal", "stall",
    "overflow", "stop", "start", "bus_off", "inject", "clock_step", "preset", "load",
]  # fmt: skip


class Base(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What all parts of a suite have in common: frozen, and a key that is not known is an error."""


# --- who takes part -------------------------------------------------------------------------------


class Qos(Base, frozen=True, kw_only=True):
    """QoS of an entity: a standard profile, and what differs from it."""

    profile: Literal["default", "sensor_data", "services_default", "parameters", "system_default"] = "default"
    reliability: Literal["reliable", "best_effort"] | None = None
    durability: Literal["volatile", "transient_local"] | None = None
    history: Literal["keep_last", "keep_all"] | None = None
    depth: int | None = None
    deadline: Period | None = None
    lifespan: Period | None = None
    liveliness: Literal["none", "automatic", "manual_by_topic", "manual_by_node"] | None = None
    lease: Period | None = None


class Session(Base, frozen=True, kw_only=True):
    """A session. Sessions without an entry here take their defaults."""

    process: Literal["shared", "own"] = "shared"
    domain: int = 0
    node: Identifier | None = None
    slice: Duration = Duration.parse("10ms")
    """How long one drive_io in the background may wait."""
    driven: bool = True
    """Whether it is driven in the background while the script waits."""
    may_fail: bool = False
    lease: Duration | None = None
    """``connection_lease_ms`` of the session; default: the backend's own, which is the declared one."""
    hard_liveliness: Duration | None = None
    """``hard_liveliness_ms``: the peer removes the session's entities when it is silent for so long."""
    reconnector: bool = False
    """Kept by the state machine of `node.reconnection`: it pings, creates the session with its entities,
    drives it, destroys it when the peer is gone, and begins anew."""


class Entity(Base, frozen=True, kw_only=True):
    """A publisher or a subscription: exactly one of the two keys, its value is the topic.

    Topic and type names are made unique per scenario; ``raw`` passes the topic on as it is written.
    """

    publisher: str | None = None
    subscription: str | None = None
    type: str = "Sample"
    raw: bool = False
    session: Identifier | None = None
    """Default: ``pub`` for publishers, ``sub`` for subscriptions, so that a wire lies between them."""
    qos: Qos = Qos()
    register: Literal["expected", "supported", "none"] | list[KindName] = "expected"
    """``expected``: the kinds that this scenario's expectations name for this entity."""
    registration_deadline: Duration | None = None
    """``deadline_ms`` of the registrations; default: the deadline of the QoS, else 1T."""
    take: Literal["withheld", "always"] = "withheld"
    """``always``: every sample is taken at once. Default: nothing but drive_io is called."""
    count: int = 1
    """More than one: entities ``name[0]``, ``name[1]``..., addressed together by ``name``."""
    deferred: bool = False
    """Created by a ``create`` step and not at the start."""
    may_fail: bool = False
    """A refused creation is an observation, not the end of the scenario."""


# --- what happens ---------------------------------------------------------------------------------


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


# --- what must have happened for the rest to mean anything ----------------------------------------


class GapGiven(Base, frozen=True, kw_only=True):
    """Between consecutive actions of this label, or of these together, at most ``max`` and at least ``min``."""

    gap: Labels
    max: Duration | None = None
    min: Duration | None = None


class ReturnsGiven(Base, frozen=True, kw_only=True):
    """The actions of this label answered one of these codes."""

    returns: Identifier
    is_: list[str] = field(name="is")


class ReceivedGiven(Base, frozen=True, kw_only=True):
    """As the expectation: which of the samples published under this label were received."""

    received: Identifier
    of: EntityName
    is_: Literal["all", "none"] | int = field(default="all", name="is")


class DrivenGiven(Base, frozen=True, kw_only=True):
    """This session was driven at least this often between two moments."""

    driven: Identifier
    max: Duration
    from_: Moment = field(default=Moment.parse("start"), name="from")
    until: Moment = Moment.parse("end")


AnyGiven: TypeAlias = GapGiven | ReturnsGiven | ReceivedGiven | DrivenGiven
GIVENS: dict[str, type[Base]] = {
    "gap": GapGiven, "returns": ReturnsGiven, "received": ReceivedGiven, "driven": DrivenGiven,
}  # fmt: skip


# --- what is expected -----------------------------------------------------------------------------


class Expectation(Base, frozen=True, kw_only=True):
    """Common to all expectations: the requirements that it proves."""

    proves: str | list[RequirementId]

    @property
    def requirements(self) -> tuple[str, ...]:
        """The requirement ids."""
        return (self.proves,) if isinstance(self.proves, str) else tuple(self.proves)


class Never(Expectation, frozen=True, kw_only=True):
    """No such event begins in the window."""

    never: KindOrAny | list[KindName]
    of: EntityNames | Literal["ALL"]
    from_: Moment = field(default=Moment.parse("start"), name="from")
    until: Moment = Moment.parse("end")


class Periodic(Expectation, frozen=True, kw_only=True):
    """From ``since`` on the total grows by one per ``every``, neither early nor late."""

    periodic: KindName
    of: EntityName
    every: Duration
    since: Moment
    until: Moment = Moment.parse("end")


class Total(Expectation, frozen=True, kw_only=True):
    """The running total (sum of changes) at a moment."""

    total: KindName
    of: EntityName
    at: Moment = Moment.parse("end")
    is_: int | None = field(default=None, name="is")
    at_least: int | None = None
    at_most: int | None = None


class Level(Expectation, frozen=True, kw_only=True):
    """alive_count or not_alive_count: ``by`` a moment, or ``from`` one ``until`` another throughout."""

    level: Literal["alive_count", "not_alive_count"]
    of: EntityNames
    is_: int = field(name="is")
    by: Moment | None = None
    from_: Moment | None = field(default=None, name="from")
    until: Moment | None = None


class Returns(Expectation, frozen=True, kw_only=True):
    """What the actions of a label answered: codes by name, ``ANY_ERROR``, ``true``, ``false``, ``DATA``."""

    returns: Identifier
    is_: list[str] = field(name="is")
    some: bool = False
    """One of several actions is enough."""


class Agrees(Expectation, frozen=True, kw_only=True):
    """``supports_event`` says beforehand what registering answers: both labels, pairwise."""

    agrees: Identifier
    with_: Identifier = field(name="with")


class Admitted(Expectation, frozen=True, kw_only=True):
    """Creating this entity answered INCOMPATIBLE_QOS if the backend declares a policy of it unsupported, else OK."""

    admitted: EntityName


class Received(Expectation, frozen=True, kw_only=True):
    """Which of the samples published under this label the subscription's takes returned, in order, once."""

    received: Identifier
    of: EntityName
    is_: Literal["all", "none"] | int = field(default="all", name="is")


class Conserved(Expectation, frozen=True, kw_only=True):
    """Received plus lost equals published, from ``since`` to the last received sample, per publisher."""

    conserved: EntityName
    from_: list[EntityName] = field(name="from")
    since: Moment = Moment.parse("start")


class Inside(Expectation, frozen=True, kw_only=True):
    """An event was delivered inside the drive_io or spin call of this label, with these payload fields."""

    inside: Identifier
    event: KindName
    of: EntityName
    at_least: int = 1
    status: dict[str, int] = {}


class Callback(Expectation, frozen=True, kw_only=True):
    """Whether the callback of this registration ran, and with what."""

    callback: Identifier
    is_: Literal["some", "never"] = field(name="is")
    kind: KindName | None = None
    context: str | None = None
    from_: Moment = field(default=Moment.parse("start"), name="from")
    until: Moment = Moment.parse("end")


class Callbacks(Expectation, frozen=True, kw_only=True):
    """How many callbacks ran inside the calls of this label: together, or in ``each``."""

    callbacks: Identifier
    counting: list[Literal["events", "messages"]] = field(default_factory=lambda: ["events", "messages"])
    each: bool = False
    at_most: int | None = None
    at_least: int | None = None


class Takes(Expectation, frozen=True, kw_only=True):
    """How long each call of this label took."""

    takes: Identifier
    at_most: Duration | None = None
    at_least: Duration | None = None


class Measured(Expectation, frozen=True, kw_only=True):
    """By how much a measured quantity grew from one ``measure`` step to another."""

    measured: Literal["cpu"]
    from_: Identifier = field(name="from")
    to: Identifier
    at_most: Duration


class Counted(Expectation, frozen=True, kw_only=True):
    """The number that a ``measure`` step found: itself, or what it is more than at the step ``since``."""

    counted: Identifier
    since: Identifier | None = None
    is_: int | None = field(default=None, name="is")
    at_least: int | None = None
    at_most: int | None = None


class Cycles(Expectation, frozen=True, kw_only=True):
    """In each turn of a ``cycle``: what a step answered, how many samples an entity took, what an event counted.

    Exactly one of ``step``, ``sampled`` and ``event``. Of events the occurrences count, of
    LivelinessChanged the callbacks.
    """

    cycles: Identifier
    step: Identifier | None = None
    is_: list[str] = field(name="is", default_factory=list)
    sampled: EntityName | None = None
    event: KindName | None = None
    of: EntityName | None = None
    at_least: int = 1


class AnyOf(Expectation, frozen=True, kw_only=True):
    """One of these groups of expectations holds as a whole."""

    any_of: list[list[Any]]


AnyExpectation: TypeAlias = (
    Never
    | Periodic
    | Total
    | Level
    | Returns
    | Agrees
    | Admitted
    | Received
    | Conserved
    | Inside
    | Callback
    | Callbacks
    | Takes
    | Measured
    | Counted
    | Cycles
    | AnyOf
)
EXPECTATIONS: dict[str, type[Expectation]] = {
    "never": Never, "periodic": Periodic, "total": Total, "level": Level, "returns": Returns, "agrees": Agrees,
    "admitted": Admitted, "received": Received, "conserved": Conserved, "inside": Inside, "callback": Callback,
    "callbacks": Callbacks, "takes": Takes, "measured": Measured, "counted": Counted, "cycles": Cycles,
    "any_of": AnyOf,
}  # fmt: skip


# --- scenario and file ----------------------------------------------------------------------------


class Needs(Base, frozen=True, kw_only=True):
    """What a backend must have for this scenario to apply, or to be playable."""

    claims: list[KindName] = []
    """Events that it must claim; those of the expectations are added by themselves."""
    declares: dict[str, Any] = {}
    """Fields of the declaration and the value that they must have, such as ``callback_cap: true``."""
    clock: Literal["any", "real", "virtual"] = "any"
    process: Literal["shared", "alone", "own"] = "shared"
    """``alone``: nothing else plays in its process meanwhile, because it times calls; ``own``: a process of its own,
    before and after too, because it counts what a process has."""


class Scale(Base, frozen=True, kw_only=True):
    """The unit that durations are multiples of."""

    T: Duration = Duration.parse("130ms")


class Scenario(Base, frozen=True, kw_only=True):
    """One scenario, its parameters already put in."""

    id: ScenarioId
    title: str
    profile: Profile = "standard"
    scale: Scale = Scale()
    needs: Needs = Needs()
    canonical: KindName | None = None
    """This scenario is the stimulus that decides whether a claimed event works at all."""
    refusal: KindName | None = None
    """This scenario is the proof that an event which is not claimed is absent. Plays only then."""
    peer: Literal["present", "absent"] = "present"
    """``absent``: the agent, router or broker is not there until a ``start`` step. Sessions without a
    reconnector are then created together with the first entity that is created on them."""
    sessions: dict[Identifier, Session] = {}
    entities: dict[Identifier, Entity]
    script: list[Any]
    react: list[Reaction] = []
    given: list[Any] = []
    expect: list[Any]


class SuiteFile(Base, frozen=True, kw_only=True):
    """A file of ``suites/``."""

    suite: Annotated[str, Meta(pattern=r"^[a-z_]+$")]
    title: str
    scenarios: list[Any]
