"""What a backend says about itself: ``backend.toml``, schema 1 (``docs/backend-toml.md``).

Every line is checked by the runs, both ways: too much claimed, too little claimed, and a known
failure that passes are all errors. What is left out has the strict value.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any, Literal, TypeAlias

from msgspec import Struct, convert, field, structs, to_builtins

from nros_conformance.formats.durations import Duration
from nros_conformance.formats.places import Document, Path_, nearest
from nros_conformance.formats.toml import read_toml
from nros_conformance.rmw.events import KIND_BY_LABEL, EventKind

Claim: TypeAlias = Literal["yes", "limited", "no"]
Absent: TypeAlias = Literal["never", "not-yet", "not-wired"]


NOTHING_TO_INSTALL = "nothing to install"


class _Part(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    pass


class Pinned(_Part, frozen=True, kw_only=True):
    """The version that somebody else (nano-ros) is tied to."""

    by: str
    version: str


class HeldTo(_Part, frozen=True, kw_only=True):
    """Recordings that a model or protocol implementation is held to."""

    what: str
    in_: str = field(name="in")


class Subject(_Part, frozen=True, kw_only=True):
    """What a cell of this row is a statement about."""

    kind: Literal["library", "protocol", "model", "compiled", "device"]
    says: str
    not_: str = field(name="not", default="")
    package: str = ""
    """The distribution on PyPI whose installed version is printed; empty when there is none."""
    range: str = ""
    pinned: Pinned | None = None
    held_to: list[HeldTo] = []
    install: str = NOTHING_TO_INSTALL


class Event(_Part, frozen=True, kw_only=True):
    """One status event: the claim, and the choices between permitted behaviours."""

    claim: Claim = "no"
    how: str = ""
    absent: Absent | None = None
    because: str = ""
    link: str = ""
    limit: dict[str, Any] = {}
    dispatch: Literal["drive_io", "own_call"] = "drive_io"
    armed_at: Literal["create", "first_sample"] = "create"
    deadline_source: Literal["qos_then_registration", "registration_only", "qos_only", "refuse_conflict"] = (
        "qos_then_registration"
    )
    after_publisher_gone: Literal["continues", "stops"] = "continues"
    presence_only: bool = False
    distinguishes_orderly_destroy: bool = False
    loss_class: Literal["destroy", "lease"] | None = None
    publish_asserts: bool = False
    manual_by_node: Literal["enforced", "refused"] = "enforced"
    manual: bool = True
    """Whether MANUAL liveliness exists at all."""
    sources: list[Literal["overflow", "wire"]] = field(default_factory=lambda: ["overflow", "wire"])


class HardLiveliness(_Part, frozen=True, kw_only=True):
    """The agent's hard liveliness check."""

    claim: Claim = "no"
    timeout: Duration = Duration.parse("10s")
    grace: Duration = Duration.parse("800ms")
    client_opt_in: bool = True


class Connection(_Part, frozen=True, kw_only=True):
    """Ping, reconnection, hard liveliness."""

    ping: Literal["round_trip", "no"] = "no"
    ping_before_session: bool = False
    ping_attempts: bool = False
    peer: Literal["none", "agent", "router", "broker"] = "none"
    reconnect: Claim = "no"
    hard_liveliness: HardLiveliness = HardLiveliness()
    lease: Duration = Duration.parse("10s")
    absent: Absent | None = None
    because: str = ""
    link: str = ""


class Bounds(_Part, frozen=True, kw_only=True):
    """What the judge may count on, and what one process can carry."""

    discovery: Duration = Duration.parse("2s")
    min_lease: Duration = Duration.parse("100ms")
    min_deadline: Duration = Duration.parse("20ms")
    sessions: int = 8
    """Sessions at once in one process."""


class QosSupport(_Part, frozen=True, kw_only=True):
    """What is checked when."""

    pair_check: Literal["create", "no_match", "none"] = "create"
    unsupported: list[str] = []
    """Policies that creation refuses, such as ``lifespan`` or ``liveliness.manual_by_node``."""


class Behaviour(_Part, frozen=True, kw_only=True):
    """Choices that belong to no single event."""

    clock: Literal["real", "virtual"] = "real"
    receives_only_in_drive_io: bool = False
    same_session_visible: bool = True
    two_sessions: Literal["independent", "second_fails"] = "independent"
    callback_cap: bool = True
    counter_limit: Literal["saturate", "wrap"] = "saturate"
    derived_support: bool = False
    """supports_event does not exist and is derived from return codes: REG-001 cannot be asked."""


class Known(_Part, frozen=True, kw_only=True):
    """A deviation that is known: it must fail, conclusively, whenever its scenario is played; see ``strict``."""

    key: str
    requirement: str
    scenario: str
    cause: Literal["middleware", "adapter", "contract"]
    because: str
    link: str
    versions: str = ""
    model: str = ""
    """The deviation of `nros_conformance.model.deviations` that this is, so that ``explore`` knows it again."""
    strict: bool = True
    """False for a race inside the middleware, which ``because`` explains: a play that passes is no contradiction."""
    review: date | None = None


class KnownFile(_Part, frozen=True, kw_only=True):
    """A list of known failures beside a declaration, in the same format: ``run --known FILE``."""

    known: list[Known]


class Planted(_Part, frozen=True, kw_only=True):
    """A defective variant of the reference that every run must catch."""

    adapter: str
    says: str
    scenario: str
    requirement: str


class Declaration(_Part, frozen=True, kw_only=True):
    """A whole ``backend.toml``."""

    schema: Literal[1]
    name: str
    title: str
    adapter: str
    """``module:Class``."""
    subject: Subject
    control: bool = False
    """The reference: it belongs to the control line and has no row."""
    planted: list[Planted] = []
    variants: dict[str, dict[str, Any]] = {}
    """One row each. ``title`` follows that of the backend in brackets, ``says`` follows the subject's;
    ``default = false``: only if asked for; ``connection = {...}`` replaces fields of that section."""
    events: dict[str, Event] = {}
    connection: Connection = Connection()
    bounds: Bounds = Bounds()
    behaviour: Behaviour = Behaviour()
    qos: QosSupport = QosSupport()
    faults: dict[str, str] = {}
    notes: dict[str, str] = {}
    """Stable note keys of the matrix: event label, ``ping``... -> ``C1``."""
    known: list[Known] = []

    def event(self, kind: EventKind) -> Event:
        """The section of a kind; the strict one (claim no) when there is none."""
        return self.events.get(kind.label, Event())

    def in_variant(self, name: str) -> Declaration:
        """What holds for the row of this variant."""
        replaced = self.variants.get(name, {}).get("connection", {})
        if not replaced:
            return self
        fields = {field: getattr(convert(replaced, Connection, dec_hook=_duration), field) for field in replaced}
        return structs.replace(self, connection=structs.replace(self.connection, **fields))

    def claims(self) -> dict[str, Claim]:
        """The claim for each of the five events."""
        return {kind.label: self.event(kind).claim for kind in EventKind}

    def quantities(self) -> dict[str, int]:
        """The declared bounds that suites refer to by name, ns."""
        return {
            "discovery_bound": self.bounds.discovery.ns({}),
            "connection_lease": self.connection.lease.ns({}),
            "hard_liveliness_timeout": self.connection.hard_liveliness.timeout.ns({}),
            "hard_liveliness_grace": self.connection.hard_liveliness.grace.ns({}),
        }

    def capabilities(self) -> dict[str, Any]:
        """The fields that ``needs: {declares: ...}`` may ask for, flat; defaults are filled in.

        >>> # "MessageLost.sources": ["wire"], "callback_cap": True, "ping": "round_trip"
        """
        flat: dict[str, Any] = {}
        for kind in EventKind:
            section = self.event(kind)
            flat |= {f"{kind.label}.{name.rstrip('_')}": getattr(section, name) for name in section.__struct_fields__}
        for part in (self.connection, self.behaviour, self.qos):
            flat |= {name: getattr(part, name) for name in part.__struct_fields__}
        hard = flat.pop("hard_liveliness")
        flat |= {f"hard_liveliness.{name}": getattr(hard, name) for name in hard.__struct_fields__}
        plain: dict[str, Any] = to_builtins(flat, enc_hook=str)
        return plain


def _duration(type_: type[Any], value: Any) -> Any:
    return Duration.parse(value) if type_ is Duration else value


def load_declaration(file: Path, text: str | None = None) -> Declaration:
    """Read and check a ``backend.toml``. Raises `FormatError` with line, key and remedy."""
    document = read_toml(file, text)
    declaration = document.read(Declaration)
    _check(document, declaration)
    return declaration


def _check_absence(document: Document, here: Path_, what: str, section: Event | Connection) -> None:
    """What is absent says of which class, why, and an event that is absent for ever where that is shown."""
    if section.absent is None:
        raise document.error(here, f"{what} without a class", 'add absent = "never", "not-yet" or "not-wired"')
    if not section.because:
        raise document.error(here, f"{what} without a reason", "add because = ...")
    if isinstance(section, Event) and section.absent == "never" and not section.link:
        raise document.error(here, f'{what}, absent = "never" without a link', "add link = ..., where it is shown")


def check_links(document: Document, entries: Sequence[Known]) -> None:
    """Every known deviation says where it is reported. Raises `FormatError`."""
    for index, known in enumerate(entries):
        if not known.link:
            raise document.error(
                ("known", index), f"known {known.key}: no link", 'add link = ..., or link = "unreported"'
            )


def _check(document: Document, declaration: Declaration) -> None:
    for label, event in declaration.events.items():
        here = ("events", label)
        if label not in KIND_BY_LABEL:
            raise document.error(here, f"unknown event {label!r}", nearest(label, list(KIND_BY_LABEL)))
        if event.claim == "no":
            _check_absence(document, here, f'{label}: claim = "no"', event)
        if event.claim == "limited" and not event.because:
            raise document.error(here, f'{label}: claim = "limited" without a reason', "add because = ...")
        if event.claim != "no" and not event.how:
            raise document.error(here, f"{label}: it is not said how the event is produced", "add how = ...")
        if event.claim == "limited" and not event.limit:
            raise document.error(here, f'{label}: claim = "limited" without a limit', "add limit = { ... }")
    places: dict[str, Path_] = {"": ("connection",)}
    for variant, facts in declaration.variants.items():
        for name in ("title", "says"):
            if not isinstance(facts.get(name, ""), str):
                raise document.error(("variants", variant, name), f"{name}: {facts[name]!r} is not text")
        if "connection" in facts:
            document.read(Connection, path=("variants", variant, "connection"))
            places[variant] = ("variants", variant, "connection")
    for variant, place in places.items():
        connection = declaration.in_variant(variant).connection
        if connection.ping == "no":
            _check_absence(document, place, 'ping = "no"', connection)
    check_links(document, declaration.known)
    for name in ("min_lease", "min_deadline", "discovery"):
        duration: Duration = getattr(declaration.bounds, name)
        if duration.names:
            raise document.error(
                ("bounds", name), f"{name}: {duration} depends on {sorted(duration.names)[0]}", "give a plain duration"
            )
    if ":" not in declaration.adapter:
        raise document.error(("adapter",), f"adapter: {declaration.adapter!r} is not module:Class")
