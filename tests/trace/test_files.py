from __future__ import annotations

import threading
from pathlib import Path

import pytest

from nros_conformance.formats.places import FormatError
from nros_conformance.trace.files import TraceWriter, read_trace
from nros_conformance.trace.records import (
    Act,
    AnyRecord,
    Blind,
    End,
    Event,
    FaultRecord,
    Header,
    Matched,
    Measure,
    Message,
    Registered,
    Spin,
    State,
    Trace,
)

HEADER = Header(
    scenario={"id": "a.b", "title": "t", "entities": {}, "script": [], "expect": []}, suite="a", backend="reference",
    clock="virtual", quantities={"T": 130_000_000, "tolerance": 0, "early": 0}, start=17,
)  # fmt: skip
RECORDS: tuple[AnyRecord, ...] = (
    State(entity="", session="sub", what="created", begin=1, end=2),
    Registered(
        registration="listener/MessageLost",
        entity="listener",
        session="sub",
        kind=2,
        supports=True,
        code=0,
        begin=1,
        end=2,
    ),
    Matched(publisher="talker", subscription="listener", begin=1, end=2, how="adapter"),
    Act(label="data", op="publish", entity="talker", args={"sequence": 1}, due=3, begin=4, end=5, result=0),
    Spin(session="sub", begin=5, end=9, sure=8, calls=3, gap=1, longest=2),
    Event(
        registration="listener/MessageLost", kind=2, entity="listener", session="sub", thread=1, driver=1, spin=4,
        inside_drive=True, t=10, wait=1, status={"total_count": 1, "total_count_change": 1},
    ),
    Message(session="sub", entity="listener", t=11, publisher="talker", sequence=1, label="data", size=20),
    FaultRecord(label="gone", fault="crash", of="pub", begin=12, end=13),
    Blind(begin=13, end=14),
    Measure(label="m", what="threads", value=3.0, begin=14, end=15),
    End(outcome="done", t=16),
)  # fmt: skip


def write(path: Path, *records: AnyRecord) -> None:
    with TraceWriter(path) as writer:
        writer.write(HEADER)
        for record in records:
            writer.write(record)


def the_error(path: Path) -> str:
    with pytest.raises(FormatError) as caught:
        read_trace(path)
    return str(caught.value).replace(str(path), "FILE")


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "traces" / "a.b.1.jsonl"
    write(file, *RECORDS)
    assert read_trace(file) == Trace(HEADER, RECORDS)
    assert read_trace(file).end == RECORDS[-1]
    assert len(file.read_text().splitlines()) == len(RECORDS) + 1


def test_every_record_is_on_disk_before_the_writer_is_closed(tmp_path: Path) -> None:
    file = tmp_path / "t.jsonl"
    writer = TraceWriter(file)
    writer.write(HEADER)
    for number, record in enumerate(RECORDS, 1):
        writer.write(record)
        assert len(read_trace(file).records) == number
    writer.close()
    writer.close()


def test_threads_share_a_writer(tmp_path: Path) -> None:
    file = tmp_path / "t.jsonl"
    with TraceWriter(file) as writer:
        writer.write(HEADER)
        spin = Spin(session="s" * 500, begin=1, end=2, sure=2)

        def fifty() -> None:
            for _ in range(50):
                writer.write(spin)

        threads = [threading.Thread(target=fifty) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert read_trace(file).records == (spin,) * 200


def test_a_writer_begins_anew_unless_told_to_append(tmp_path: Path) -> None:
    file = tmp_path / "t.jsonl"
    write(file, *RECORDS)
    write(file, RECORDS[0])
    assert read_trace(file).records == RECORDS[:1]
    with TraceWriter(file, append=True) as writer:
        writer.write(RECORDS[1])
    assert read_trace(file).records == RECORDS[:2]


@pytest.mark.parametrize("kept", [1, 20, 60])
def test_a_torn_last_line_is_left_out(tmp_path: Path, kept: int) -> None:
    file = tmp_path / "t.jsonl"
    write(file, *RECORDS[:-1])
    before = file.read_bytes()
    write(file, *RECORDS)
    file.write_bytes(file.read_bytes()[: len(before) + min(kept, 25)])
    assert read_trace(file) == Trace(HEADER, RECORDS[:-1])
    assert read_trace(file).end is None


def test_a_last_line_that_lacks_only_its_line_end_counts(tmp_path: Path) -> None:
    file = tmp_path / "t.jsonl"
    write(file, *RECORDS)
    file.write_bytes(file.read_bytes()[:-1])
    assert read_trace(file) == Trace(HEADER, RECORDS)


def test_the_end_of_a_crashed_play_is_appended_after_its_torn_line(tmp_path: Path) -> None:
    file = tmp_path / "t.jsonl"
    write(file, *RECORDS[:3])
    with file.open("ab") as stream:
        stream.write(b'{"rec":"spin","sess')
    with TraceWriter(file, append=True) as writer:
        writer.write(End(outcome="crash", t=99))
    assert read_trace(file).records == (*RECORDS[:3], End(outcome="crash", t=99))


def test_keys_of_later_versions_are_ignored(tmp_path: Path) -> None:
    file = tmp_path / "t.jsonl"
    write(file)
    with file.open("ab") as stream:
        stream.write(b'{"rec":"end","outcome":"done","t":5,"mood":"good"}\n')
    assert read_trace(file).end == End(outcome="done", t=5)


def test_a_missing_file(tmp_path: Path) -> None:
    error = "FILE: cannot be read: No such file or directory; play the scenario again"
    assert the_error(tmp_path / "none.jsonl") == error


HEAD = b'{"rec":"header","scenario":{},"suite":"a","backend":"b","clock":"real","quantities":{},"start":0'


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (b"", "FILE: the trace is empty; play the scenario again"),
        (HEAD[:40], "FILE:1: the header of the trace is not complete; play the scenario again"),
        (
            b'{"rec":"end","outcome":"done","t":5}\n',
            "FILE:1: the first line is no header of a trace: invalid value 'end' - at `$.rec`; "
            "play the scenario again",
        ),
        (
            b'["header"]\n',
            "FILE:1: the first line is no header of a trace: expected `object`, got `array`; play the scenario again",
        ),
        (
            HEAD + b',"format":2}\n',
            "FILE:1: trace format 2, and this is a reader of format 1; "
            "judge it with the nros-conformance that wrote it",
        ),
        (
            b'{"rec":"header","format":3}\n',
            "FILE:1: trace format 3, and this is a reader of format 1; "
            "judge it with the nros-conformance that wrote it",
        ),
        (
            HEAD + b'}\n{"rec":"end","outcome":\n{"rec":"end","outcome":"done","t":5}\n',
            "FILE:2: a damaged line in the middle of the trace; play the scenario again",
        ),
        (
            HEAD + b'}\n{"rec":"dance","t":5}\n',
            "FILE:2: not a record of a trace: invalid value 'dance' - at `$.rec`; play the scenario again",
        ),
        (
            HEAD + b'}\n{"rec":"end","outcome":"done"}\n',
            "FILE:2: not a record of a trace: object missing required field `t`; play the scenario again",
        ),
        (
            HEAD + b'}\n{"rec":"end","outcome":"done","t":5}\n{"rec":"blind","begin":1,"end":2}\n',
            "FILE:3: there is something behind the end of the trace; play the scenario again",
        ),
    ],
    ids=["empty", "torn header", "no header", "no object", "later", "later and other", "torn", "unknown", "incomplete",
         "more"],
)  # fmt: skip
def test_a_broken_file_says_where_what_and_what_to_do(tmp_path: Path, content: bytes, error: str) -> None:
    file = tmp_path / "t.jsonl"
    file.write_bytes(content)
    assert the_error(file) == error
