"""Libraries that are no backends, or not for this runtime: one clear sentence each, and no scenario is played."""

from __future__ import annotations

from pathlib import Path

import pytest

from nros_backends.native.elf import UnknownMachine, shared_library
from nros_backends.native.loader import load_library
from nros_backends.native.options import Options
from nros_backends.native.surveyor import survey
from nros_conformance.rmw.backtraces import find_debugger
from nros_conformance.rmw.loading import LibraryError, LibraryRequest
from tests.backends.native.compiling import Build

SPEAKS = "nano-ros 0.5.0 (9a7a150)"


def refusal(library: Path, **options: str) -> str:
    with pytest.raises(LibraryError) as caught:
        survey(Options(str(library), **options))  # type: ignore[arg-type]
    return str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(LibraryError) as caught:
        load_library(LibraryRequest(tmp_path / "libnowhere.so"))
    assert str(caught.value) == f"--native {tmp_path}/libnowhere.so: there is no such file"


def test_a_file_that_is_no_library(tmp_path: Path) -> None:
    file = tmp_path / "libtext.so"
    file.write_text("not a library, though long enough to have a header of one" * 4)
    assert refusal(file) == f"the library libtext.so cannot be loaded: {file}: invalid ELF header"


def test_a_library_that_registers_nothing(build: Build) -> None:
    assert refusal(build("nothing.c", name="nothing")) == (
        "libnothing.so is no nano-ros backend: loading it registered nothing, and it exports no "
        "nros_rmw_nothing_register(); does a constructor call nros_rmw_cffi_register_named()?"
    )


def test_a_library_that_needs_another_one(build: Build) -> None:
    library, host = build("needing.c", name="needing"), build("host.c", name="host")
    assert refusal(library) == (
        "the library libneeding.so needs the symbol orb_publish, which nothing here provides; name the library that "
        "does: --host-lib FILE"
    )
    with pytest.raises(LibraryError, match="is no nano-ros backend"):  # so it has been loaded
        survey(Options(str(library), host_libraries=(str(host),)))


def test_an_older_vtable(build: Build) -> None:
    assert refusal(build("older.c", name="older")) == (
        f"libolder.so: the vtable of 'older' (vtable) has 33 slots (264 bytes), {SPEAKS} has 35 (280 bytes): it was "
        f"compiled against an older layout; compile it against the headers of {SPEAKS}"
    )


def test_a_stripped_older_vtable_ends_where_a_slot_ought_to_be(build: Build) -> None:
    text = refusal(build("older.c", name="stripped", flags=("-s",)))
    assert "does not lead to code" in text or "is NULL" in text or "not in readable memory" in text


@pytest.mark.parametrize(
    ("wrong", "value", "text"),
    [
        ("2", "data", "slot 2, drive_io, of the vtable of 'slots' does not lead to code: it was compiled against "
                      f"another layout than that of {SPEAKS}"),
        ("34", "data", "slot 34, process_raw_in_place, of the vtable of 'slots' does not lead to code: it was compiled "
                       f"against another layout than that of {SPEAKS}"),
        ("9", "0", "slot 9, has_data, of the vtable of 'slots' is NULL; it is mandatory"),
    ],
)  # fmt: skip
def test_a_slot_that_cannot_be_called(wrong: str, value: str, text: str, build: Build) -> None:
    library = build("slots.c", name=f"slots_{wrong}_{value}", flags=(f"-DWRONG={wrong}", f"-DVALUE={value}"))
    assert refusal(library) == f"{library.name}: {text}"


def test_several_names_have_to_be_told_apart_and_a_wrong_one_is_answered_with_the_right_ones(build: Build) -> None:
    library = build("twice.c", name="one")
    assert refusal(library) == "libone.so registered 'one' and 'two'; say which: --name NAME"
    assert refusal(library, name="three") == (
        "libone.so is no nano-ros backend: loading it registered nothing, and it exports no nros_rmw_three_register(); "
        "does a constructor call nros_rmw_cffi_register_named()?"
    )
    assert refusal(library, name="one") == "libone.so: create_session answered CONNECTION_FAILED"


def test_a_name_that_the_registry_cannot_hold(loopback: Path) -> None:
    assert refusal(loopback, name="n" * 32) == f"--name {'n' * 32}: longer than 31 bytes"
    assert refusal(loopback, name="other") == "libloopback.so registered 'loopback', not 'other'; say: --name loopback"


def test_a_topic_hook_that_nobody_exports(loopback: Path) -> None:
    assert refusal(loopback, topic_hook="know_topic") == "--topic-hook know_topic: no library exports it"
    assert refusal(loopback, topic_hook="os.path:know") == (
        "--topic-hook os.path:know: module 'posixpath' has no attribute 'know'"
    )


def test_a_crash_in_create_session_is_told_with_its_place(build: Build) -> None:
    library = build("loopback.c", "CRASHES_IN_CREATE")
    with pytest.raises(LibraryError) as caught:
        survey(Options(str(library)))
    died, _, where = str(caught.value).partition(", in ")
    assert caught.value.broken
    assert died == f"{library.name}: create_session: the process died of SIGABRT"
    if find_debugger():
        assert where.startswith("create_session at loopback.c:")


def test_questions_that_crash_it_are_left_out_and_told(build: Build) -> None:
    answers, crashes = survey(Options(str(build("loopback.c", "CRASHES_IN_PUBLISH"))))
    assert set(answers.registering.values()) == {0}
    assert answers.discovery_ms is None
    assert [crash.partition(", in ")[0] for crash in crashes] == [
        "passing a sample within a session: the process died of SIGSEGV",
        "a second session, and passing a sample between the two: the process died of SIGSEGV",
    ]


def test_a_processor_whose_jumps_nobody_knows() -> None:
    with pytest.raises(UnknownMachine) as caught:
        shared_library(("f",), "pdp11")
    assert str(caught.value) == "compiled backends can be loaded on x86_64 and aarch64; this is pdp11"
