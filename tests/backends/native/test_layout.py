from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from nros_backends.native import layout
from nros_backends.native.abi import LAYOUT, MANDATORY, SLOTS
from nros_backends.native.elf import shared_library
from nros_backends.native.layout import check_headers
from nros_conformance.rmw.loading import LibraryError
from tests.backends.native.compiling import HEADERS, needs

SPEAKS = "nano-ros 0.5.0 (9a7a150)"


def test_sizes_and_offsets_are_those_of_the_boundary() -> None:
    sizes = {name.removeprefix("nros_rmw_").removesuffix("_t"): size for name, (size, _) in LAYOUT.items()}
    assert sizes == {
        "qos": 24, "session": 32, "publisher": 56, "subscription": 56, "service": 32, "client": 32,
        "publisher_options": 8, "subscription_options": 8, "liveliness_changed_status": 8, "count_status": 8,
        "vtable": 280,
    }  # fmt: skip
    assert LAYOUT["nros_rmw_qos_t"][1]["liveliness_lease_ms"] == 16
    assert LAYOUT["nros_rmw_publisher_t"][1]["backend_data"] == 48
    assert [SLOTS.index(slot) for slot in ("register_subscription_event", "register_publisher_event")] == [19, 20]
    assert SLOTS.index("ping_session") == 32
    assert MANDATORY[-1] == "destroy_client"


@needs("cc")
def test_headers_of_this_layout_are_accepted() -> None:
    assert check_headers([HEADERS]) == f"--headers {HEADERS} describes 11 structs and 71 fields just so"


@needs("cc")
@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("uint16_t depth;", "uint32_t depth;",
         "nros_rmw_qos_t.deadline_ms is at offset 12, in {speaks} it is at offset 8; what is compiled with these "
         "headers cannot be called"),
        ("nros_rmw_ret_t (*ping_session)", "void (*more)(void); nros_rmw_ret_t (*ping_session)",
         "nros_rmw_vtable_t.ping_session is at slot 33, in {speaks} it is at slot 32; what is compiled with these "
         "headers cannot be called"),
        ("uint8_t _reserved1[3];", "uint8_t _reserved1[8];",
         "nros_rmw_qos_t has 32 bytes, in {speaks} it has 24; what is compiled with these headers cannot be called"),
        ("(*has_data)", "(*has_sample)", "there is no field has_data; this adapter speaks {speaks}"),
    ],
)  # fmt: skip
def test_headers_of_another_layout_are_refused_by_field(old: str, new: str, text: str, tmp_path: Path) -> None:
    shutil.copytree(HEADERS, tmp_path / "include")
    header = tmp_path / "include" / layout.HEADER
    content = header.read_text(encoding="utf-8")
    assert old in content
    header.write_text(content.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(LibraryError) as caught:
        check_headers([tmp_path / "include"])
    plain = (
        str(caught.value).replace("\N{LEFT SINGLE QUOTATION MARK}", "'").replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    )
    assert plain == f"--headers {tmp_path}/include: {text.format(speaks=SPEAKS)}"


def test_folders_without_headers_are_refused(tmp_path: Path) -> None:
    for folder, text in ((tmp_path / "none", " is no directory"), (tmp_path, ": there is no nros/rmw_vtable.h in it")):
        with pytest.raises(LibraryError) as caught:
            check_headers([folder], compiler="cc")
        assert str(caught.value) == f"--headers {folder}{text}"


def test_without_a_compiler_it_is_said_that_headers_are_not_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert check_headers([HEADERS]) == (
        f"not by the headers: there is no C compiler (apt install gcc), so --headers {HEADERS} changes nothing"
    )


@needs("readelf")
@pytest.mark.parametrize(("machine", "name"), [("x86_64", "X86-64"), ("aarch64", "AArch64")])
def test_the_registry_is_a_shared_library_that_tools_understand(machine: str, name: str, tmp_path: Path) -> None:
    file = tmp_path / "registry.so"
    file.write_bytes(shared_library(("first", "second"), machine))
    read = subprocess.run(
        ["readelf", "-h", "-l", "-d", "-W", "-s", "-D", str(file)],
        capture_output=True, text=True, check=True, env={**os.environ, "LC_ALL": "C"},
    )  # fmt: skip
    assert read.stderr == ""
    for part in (name, "DYN (Shared object file)", "nros_registry.so", "GNU_STACK", " first", " second"):
        assert part in read.stdout
    assert "RWE" not in read.stdout
