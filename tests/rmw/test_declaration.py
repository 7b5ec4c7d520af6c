from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from nros_conformance.formats.places import FormatError
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.declaration import NOTHING_TO_INSTALL, load_declaration
from nros_conformance.rmw.discovery import BackendNotFound, Unavailable, find_backend, find_backends
from nros_conformance.rmw.events import EventKind

GOOD = """\
schema = 1
name = "mine"
title = "Mine"
adapter = "mine:Backend"

[subject]
kind = "library"
says = "my middleware"

[events.MessageLost]
claim = "limited"
how = "sequence numbers"
limit = { sources = ["wire"] }
because = "the queue is not ours"
sources = ["wire"]

[events.LivelinessChanged]
claim = "no"
absent = "never"
because = "nothing like it"
link = "https://example.org/issue"

[connection]
absent = "not-yet"
because = "nobody asked"

[[known]]
key = "M1"
requirement = "MSL-001"
scenario = "msl.conservation"
cause = "middleware"
because = "it forgets"
link = "unreported"
"""


def load(text: str) -> None:
    load_declaration(Path("mine/backend.toml"), text)


def test_what_is_left_out_has_the_strict_value() -> None:
    declaration = load_declaration(Path("b.toml"), GOOD)
    assert declaration.claims() == {
        "LivelinessChanged": "no", "RequestedDeadlineMissed": "no", "MessageLost": "limited",
        "LivelinessLost": "no", "OfferedDeadlineMissed": "no",
    }  # fmt: skip
    assert declaration.event(EventKind.REQUESTED_DEADLINE_MISSED).armed_at == "create"
    capabilities = declaration.capabilities()
    assert capabilities["MessageLost.sources"] == ["wire"]
    assert (capabilities["callback_cap"], capabilities["ping"]) == (True, "no")
    assert declaration.quantities()["discovery_bound"] == 2_000_000_000


@pytest.mark.parametrize(("old", "new", "message"), [
    ("[events.MessageLost]", "[events.MesageLost]", "10: unknown event 'MesageLost'; did you mean 'MessageLost'?"),
    ('claim = "limited"', 'claim = "limted"', "11: claim: unknown value 'limted'; did you mean 'limited'?"),
    ('how = "sequence', 'hwo = "sequence', "12: unknown key 'hwo'; did you mean 'how'?"),
    ('title = "Mine"\n', "", "1: the key 'title' is missing; add title: ..."),
    ('absent = "never"\nbecause = "nothing like it"', 'because = "nothing"',
     '17: LivelinessChanged: claim = "no" without a class; add absent = "never", "not-yet" or "not-wired"'),
    ('because = "nothing like it"\n', "", '17: LivelinessChanged: claim = "no" without a reason; add because = ...'),
    ('link = "https://example.org/issue"\n', "",
     '17: LivelinessChanged: claim = "no", absent = "never" without a link; add link = ..., where it is shown'),
    ('because = "the queue is not ours"\n', "",
     '10: MessageLost: claim = "limited" without a reason; add because = ...'),
    ('limit = { sources = ["wire"] }\n', "", '10: MessageLost: claim = "limited" without a limit; add limit = { ... }'),
    ('how = "sequence numbers"\n', "", "10: MessageLost: it is not said how the event is produced; add how = ..."),
    ('absent = "not-yet"\n', "",
     '23: ping = "no" without a class; add absent = "never", "not-yet" or "not-wired"'),
    ('link = "unreported"', 'link = ""', '27: known M1: no link; add link = ..., or link = "unreported"'),
    ('adapter = "mine:Backend"', 'adapter = "mine"', "4: adapter: 'mine' is not module:Class"),
    ('kind = "library"', "kind = library", "7: not TOML: Invalid value"),
    ("schema = 1", "schema = 2", "1: schema: unknown value '2'; valid are 1"),
])  # fmt: skip
def test_a_broken_declaration_gets_one_error_with_line_and_remedy(old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(FormatError) as caught:
        load(GOOD.replace(old, new, 1))
    assert str(caught.value) == f"mine/backend.toml:{message}"


def test_a_bound_has_to_be_a_plain_duration() -> None:
    with pytest.raises(FormatError) as caught:
        load(GOOD + '\n[bounds]\nmin_lease = "2T"\n')
    assert str(caught.value) == "mine/backend.toml:36: min_lease: 2T depends on T; give a plain duration"


def test_installed_backends_are_found_by_entry_point_without_importing_their_middleware() -> None:
    found = find_backends()
    assert {"cyclone", "reference", "uorb"} <= set(found)
    assert all(one.declaration is not None and one.error is None for one in found.values())
    assert [name for name, one in found.items() if one.declaration and one.declaration.control] == ["reference"]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "__init__.py").write_text("class Backend: pass\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    importlib.invalidate_caches()
    return tmp_path / "mine"


def test_a_backend_is_found_by_module_and_class(package: Path) -> None:
    (package / "backend.toml").write_text(GOOD, encoding="utf-8")
    found = find_backend("mine:Backend")
    assert (found.name, found.adapter, found.error) == ("mine", "mine:Backend", None)
    with pytest.raises(FormatError) as error:
        found.load()
    assert str(error.value) == (
        f"{package / '__init__.py'}: Backend is no adapter; derive it from nros_conformance.rmw.backend.Backend"
    )


_DERIVED = "from nros_conformance.rmw.backend import Backend\n"


@pytest.mark.parametrize(("code", "said"), [
    ("x = 1\nraise ValueError('no licence')\n", ":2: importing it raised ValueError: no licence"),
    ("class Backend(\n", ":1: SyntaxError: '(' was never closed"),
    ("class Bakend: pass\n", ": there is no class 'Backend'"),
    (_DERIVED + "class MyBackend(Backend): pass\ndel Backend\n",
     ": there is no class 'Backend'; did you mean 'MyBackend'?"),
    (_DERIVED.replace("import Backend", "import Backend as B") + "class Backend(B): pass\n",
     "mine:Backend: creating it raised TypeError: Can't instantiate abstract class Backend"),
    (_DERIVED.replace("import Backend", "import Backend as B")
     + "class Backend(B):\n    def __init__(self, host):\n        raise OSError('no card')\n"
     + "    def create_session(self, options): ...\n",
     ":4: creating it raised OSError: no card"),
])  # fmt: skip
def test_an_adapter_that_is_broken_names_the_place_and_what_it_raised(package: Path, code: str, said: str) -> None:
    (package / "backend.toml").write_text(GOOD, encoding="utf-8")
    (package / "__init__.py").write_text(code, encoding="utf-8")
    found = find_backend("mine:Backend")
    with pytest.raises(FormatError) as error:
        found.versions(Host(clock=MonotonicClock()))
    assert str(error.value).startswith(said if said.startswith("mine") else f"{package / '__init__.py'}{said}")


def test_what_is_missing_is_told_with_its_command_or_with_where_to_name_one() -> None:
    assert str(Unavailable("No module named 'x'", "pip install x")) == "No module named 'x'; install it: pip install x"
    assert str(Unavailable("No module named 'x'", NOTHING_TO_INSTALL)) == (
        "No module named 'x'; install it, and name the command in backend.toml: [subject] install"
    )


def test_an_adapter_without_declaration_or_module_says_so(package: Path) -> None:
    error = find_backend("mine:Backend").error
    assert str(error) == f"{package / 'backend.toml'}: there is no declaration; write one; docs/backend-toml.md"
    assert str(find_backend("nowhere:Backend").error) == "nowhere:Backend: there is no module 'nowhere'"
    with pytest.raises(
        BackendNotFound, match="no backend 'mqtt'; installed are can, cyclone, reference, uorb, xrce, zenoh"
    ):
        find_backend("mqtt")


VARIANTS = """
[variants.alone]

[variants.routed]
connection = { ping = "round_trip", peer = "router", lease = "500 ms" }
"""


def test_a_variant_replaces_fields_of_the_connection_and_leaves_the_rest() -> None:
    declaration = load_declaration(Path("b.toml"), GOOD + VARIANTS)
    routed = declaration.in_variant("routed").connection
    assert (routed.ping, routed.peer, routed.lease.ns({})) == ("round_trip", "router", 500_000_000)
    assert (routed.absent, routed.reconnect) == ("not-yet", "no")
    assert declaration.in_variant("alone") is declaration


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        (
            '{ pinh = "no" }',
            "b.toml:36: unknown key 'pinh'; did you mean 'ping'?",
        ),
        (
            '{ ping = "no", absent = "never", because = "" }',
            'b.toml:36: ping = "no" without a reason; add because = ...',
        ),
    ],
)
def test_what_a_variant_says_is_checked_at_its_line(facts: str, message: str) -> None:
    with pytest.raises(FormatError) as error:
        load_declaration(Path("b.toml"), f"{GOOD}\n[variants.x]\nconnection = {facts}\n")
    assert str(error.value) == message


def test_the_title_of_a_variant_is_text() -> None:
    with pytest.raises(FormatError) as error:
        load_declaration(Path("b.toml"), f"{GOOD}\n[variants.x]\ntitle = 3\n")
    assert str(error.value) == "b.toml:36: title: 3 is not text"
