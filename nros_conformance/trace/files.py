"""Trace files: JSON Lines, one record a line, the header first, the end last (``docs/trace-format.md``)."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, TypeAlias

import msgspec

from nros_conformance.formats.places import FormatError
from nros_conformance.trace.records import FORMAT, AnyRecord, End, Header, Trace

if TYPE_CHECKING:
    from typing_extensions import Self  # in typing from 3.11 on

Line: TypeAlias = Header | AnyRecord

_AGAIN = "play the scenario again"


class TraceWriter:
    """Writes records to a file, each one handed to the operating system before `write` returns.

    So a killed process loses at most the record that it was writing. Threads may share a writer.
    ``append`` goes on with a file, as when the end of a crashed play is noted; a torn last line of
    its former writer is removed first. Raises OSError.
    """

    def __init__(self, path: Path, *, append: bool = False) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        if append:
            _mend(path)
        self._encoder = msgspec.json.Encoder()
        self._file = path.open("ab" if append else "wb", buffering=0)

    def write(self, record: Line) -> None:
        """Write one record. Raises OSError when the disk is full, TypeError for a value that JSON has no form for."""
        line = self._encoder.encode(record) + b"\n"
        # One system call a line, so that lines of different threads do not mix; a full disk shortens it.
        if self._file.write(line) != len(line):
            raise OSError(f"{self.path}: a record could only be written in part; is the disk full?")

    def close(self) -> None:
        """Close the file; a second call is harmless."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _mend(path: Path) -> None:
    """Cut off a last line without an end."""
    if not path.exists():
        return
    content = path.read_bytes()
    if content and not content.endswith(b"\n"):
        with path.open("r+b") as file:
            file.truncate(content.rfind(b"\n") + 1)


def read_trace(path: Path) -> Trace:
    """Read a trace. Raises `FormatError`, which names file, line and what to do.

    A last line that its writer did not finish is left out: the trace then has no ``end``.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(path, None, f"cannot be read: {error.strerror}", "play the scenario again") from None
    if not content:
        raise FormatError(path, None, "the trace is empty", _AGAIN)
    lines = content.split(b"\n")
    torn = lines.pop()  # what follows the last line end
    header = _header(path, lines[0] if lines else torn)
    decoder = msgspec.json.Decoder(AnyRecord)
    records: list[AnyRecord] = []
    for number, line in enumerate(lines[1:], 2):
        if records and isinstance(records[-1], End):
            raise FormatError(path, number, "there is something behind the end of the trace", _AGAIN)
        records.append(_record(path, number, line, decoder))
    if torn and lines and not (records and isinstance(records[-1], End)):
        with contextlib.suppress(msgspec.DecodeError):  # its writer was killed while it wrote
            records.append(decoder.decode(torn))
    return Trace(header, tuple(records))


def _header(path: Path, line: bytes) -> Header:
    try:
        return _checked(path, msgspec.json.decode(line, type=Header))
    except msgspec.ValidationError as error:
        version = _format_of(line)
        if version not in (None, FORMAT):
            raise _other_format(path, version) from None
        raise FormatError(path, 1, f"the first line is no header of a trace: {_plain(error)}", _AGAIN) from None
    except msgspec.DecodeError:
        raise FormatError(path, 1, "the header of the trace is not complete", _AGAIN) from None


def _checked(path: Path, header: Header) -> Header:
    if header.format != FORMAT:
        raise _other_format(path, header.format)
    return header


def _other_format(path: Path, version: object) -> FormatError:
    return FormatError(
        path, 1, f"trace format {version}, and this is a reader of format {FORMAT}",
        "judge it with the nros-conformance that wrote it",
    )  # fmt: skip


def _format_of(line: bytes) -> object:
    """The format that a header of another version states, None if there is no telling."""
    data = msgspec.json.decode(line)
    return data.get("format", FORMAT) if isinstance(data, dict) and data.get("rec") == "header" else None


def _record(path: Path, number: int, line: bytes, decoder: msgspec.json.Decoder[AnyRecord]) -> AnyRecord:
    try:
        return decoder.decode(line)
    except msgspec.ValidationError as error:
        raise FormatError(path, number, f"not a record of a trace: {_plain(error)}", _AGAIN) from None
    except msgspec.DecodeError:
        raise FormatError(path, number, "a damaged line in the middle of the trace", _AGAIN) from None


def _plain(error: msgspec.ValidationError) -> str:
    text = str(error)
    return text[0].lower() + text[1:]
