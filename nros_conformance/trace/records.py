"""The records of a trace, one JSON object a line (JSON Lines). ``docs/trace-format.md`` is the prose.

All times are nanoseconds of CLOCK_MONOTONIC (or of the virtual clock), shared by all sessions and
processes of the host. Something observed at ``t`` with ``wait`` w happened in [t - w, t]: w is how long
the observing thread was runnable but not running just before.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from msgspec import Struct, field

FORMAT = 1

WAITING_PING, WAITING_BY = "/ping", "/by"
"""Behind the label of an ``until`` step: the calls that it makes while it waits."""


class Record(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="rec"):
    """Common to all records: ``rec`` names the type. Unknown keys are ignored, so that the format can grow."""


class Header(Record, frozen=True, kw_only=True, tag="header"):
    """First line. Embeds everything that judging needs, so that a trace stands on its own."""

    format: int = FORMAT
    scenario: dict[str, Any]
    """The resolved scenario, in the suite format: parameters put in, conditions decided."""
    suite: str
    source: str = ""
    """Where the scenario stands: ``suites/requested_deadline_missed.yaml:40``."""
    parameters: dict[str, Any] = {}
    levels: dict[str, str] = {}
    """Level of every requirement that an expectation names: must, should or may."""
    digest: str = ""
    """Suite digest, ``sha256:...``: results of different suites do not merge."""
    backend: str
    variant: str = ""
    subject: str = ""
    versions: dict[str, str] = {}
    claims: dict[str, str] = {}
    """Event label -> yes, limited or no."""
    declares: dict[str, Any] = {}
    """The declaration's capability fields, flat: ``RequestedDeadlineMissed.armed_at: first_sample``."""
    clock: str
    """``real`` or ``virtual``: on the virtual clock both tolerances are 0."""
    quantities: dict[str, int]
    """``T``, ``tolerance`` (late), ``early``, ``discovery_bound``...: nanoseconds."""
    attempt: int = 1
    seed: int = 0
    host: str = ""
    start: int


class Act(Record, frozen=True, kw_only=True, tag="act"):
    """A call that the script made. It took effect somewhere in [begin, end]."""

    label: str
    """The step's label, for what an ``until`` step calls meanwhile with `WAITING_PING` or `WAITING_BY` behind it;
    steps without one are ``#3``, the position in the script."""
    index: int = 0
    """0, 1... for a repeated step."""
    op: str
    """``publish``, ``take``, ``register``, ``supports``, ``create``, ``destroy``, ``drive``, ``spin``..."""
    session: str = ""
    entity: str = ""
    args: dict[str, Any] = {}
    due: int
    begin: int
    end: int
    result: Any = None
    """Return code, true/false, or the number of samples taken."""
    raised: str = ""
    """What the call raised instead of answering, when it raised something else than `RmwError`."""
    wait: int = 0
    """How long the calling thread was runnable but not running during the call."""
    within: str = ""
    """The registration whose callback made the call; empty: the script did."""


class Spin(Record, frozen=True, kw_only=True, tag="spin"):
    """One drive_io call of a session, or several consecutive ones without any callback.

    ``sure``: the latest moment at which one of the calls had certainly not ended yet (its end minus
    its wait), which is what "late" is judged on.
    """

    session: str
    begin: int
    end: int
    sure: int
    calls: int = 1
    callbacks: int = 0
    code: int = 0
    gap: int = 0
    """The longest time between two of these calls during which nobody was in drive_io."""
    longest: int = 0
    """How long the longest of several calls took; 0: not known. With ``gap`` and ``wait`` it tells how far
    apart their ends were, for a window that closes while the record goes on."""
    wait: int = 0
    """The longest wait within one of them."""
    raised: str = ""
    """What came out of it because a callback raised it at the script's behest; then it answered nothing."""


class Event(Record, frozen=True, kw_only=True, tag="event"):
    """A status callback was entered at ``t``."""

    registration: str
    """Label of the register step, or ``listener/RequestedDeadlineMissed`` for automatic ones."""
    kind: int
    """The kind argument as it came."""
    entity: str
    session: str
    context: str = ""
    process: int = 0
    thread: int
    driver: int
    """The thread that drives this session."""
    spin: int = -1
    """Number of the drive_io call within the session, -1 outside of any."""
    inside_drive: bool
    nested: bool = False
    """Whether another callback of this session had not returned yet."""
    t: int
    wait: int = 0
    earlier: int = 0
    """How much of ``wait`` was over when the callback before it in the same drive_io had returned. It may have made
    this one late; that this one was called before the wait, and so too early, it is no reason to suspect."""
    status: dict[str, int]


class Message(Record, frozen=True, kw_only=True, tag="message"):
    """A sample came out of a take."""

    session: str
    entity: str
    t: int
    wait: int = 0
    publisher: str
    """The entity that sent it, from the payload; empty for a foreign sample."""
    sequence: int
    label: str = ""
    """Label of the publish step that sent it."""
    size: int
    callback: bool = False
    """Whether it was taken in a message callback."""


class Matched(Record, frozen=True, kw_only=True, tag="matched"):
    """The two know each other since [begin, end], as the adapter or the discovery bound says."""

    publisher: str
    subscription: str
    begin: int
    end: int
    how: str
    """``adapter``, ``bound`` (could not be told: the declared bound was waited for) or ``timeout``."""


class Registered(Record, frozen=True, kw_only=True, tag="registered"):
    """An automatic registration at creation."""

    registration: str
    entity: str
    session: str
    kind: int
    supports: bool
    code: int
    begin: int
    end: int


class State(Record, frozen=True, kw_only=True, tag="state"):
    """An entity or session was created or destroyed."""

    entity: str
    session: str
    what: str
    """``created``, ``refused``, ``destroyed``."""
    code: int = 0
    detail: str = ""
    begin: int
    end: int


class FaultRecord(Record, frozen=True, kw_only=True, tag="fault"):
    """A fault was in force from [begin, end] on."""

    label: str
    fault: str
    of: str = ""
    begin: int
    end: int
    detail: dict[str, Any] = {}


class Changed(Record, frozen=True, kw_only=True, tag="changed"):
    """The reconnector of a session went from one state to another at ``t``."""

    session: str
    before: str
    state: str
    """``WAITING_AGENT``, ``AGENT_AVAILABLE``, ``AGENT_CONNECTED``, ``AGENT_DISCONNECTED``."""
    reason: str = ""
    t: int


class Blind(Record, frozen=True, kw_only=True, tag="blind"):
    """Nothing could be observed in this interval (a frozen recorder, a lost connection to a device)."""

    begin: int
    end: int
    session: str = ""


class Cycles(Record, frozen=True, kw_only=True, tag="cycles"):
    """What happened in the turns of a cycle step, summed up. No other record tells of them."""

    label: str
    times: int
    """Cycles that were played to their end."""
    calls: dict[str, list[Act]] = {}
    """Step -> the first call of each different answer."""
    answers: dict[str, list[int]] = {}
    """Step -> how often each of these answers came."""
    received: dict[str, list[int]] = {}
    """Entity -> fewest and most samples that it took in a cycle; entities that took none at all are left out."""
    events: dict[str, list[int]] = {}
    """``listener/RequestedDeadlineMissed`` -> the smallest and the largest sum of changes in a cycle, of
    LivelinessChanged number of callbacks; likewise."""
    begin: int
    end: int


class Starved(Record, frozen=True, kw_only=True, tag="starved"):
    """Between these moments a thread of the process that plays was runnable but not running for ``wait`` ns.

    Any thread, the middleware's own and those of this play's peer among them, and the one that waited longest. A
    backend that holds the interpreter, sleeps or computes does not make its threads wait for a core.
    """

    begin: int
    end: int
    wait: int
    session: str = ""
    """The session that this process hosts alone; empty: all that have none of their own."""


class Measure(Record, frozen=True, kw_only=True, tag="measure"):
    """A measured quantity of a process, or of the peer."""

    label: str
    what: str
    """``cpu``: the processor time that all its threads have used, ns; ``threads``, ``descriptors``: how many there
    are; ``memory``: resident bytes. ``listed``, ``checks``, ``probes``: what the peer has counted."""
    value: float
    begin: int
    end: int


class End(Record, frozen=True, kw_only=True, tag="end"):
    """Last line: how the play ended. A trace without it proves nothing."""

    outcome: str
    """``done``, ``crash``, ``hang``, ``raised`` (the backend) or ``error`` (the harness)."""
    t: int
    detail: str = ""


AnyRecord: TypeAlias = (
    Act
    | Spin
    | Event
    | Message
    | Matched
    | Registered
    | State
    | FaultRecord
    | Changed
    | Blind
    | Cycles
    | Measure
    | Starved
    | End
)


class Trace(Struct, frozen=True):
    """A header and what followed, in the order of writing; ``end`` is None for a trace cut short."""

    header: Header
    records: tuple[AnyRecord, ...] = field(default=())

    @property
    def end(self) -> End | None:
        """The last record, if the trace is whole."""
        last = self.records[-1] if self.records else None
        return last if isinstance(last, End) else None
