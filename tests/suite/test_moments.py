from __future__ import annotations

import pickle
import re

import pytest

from nros_conformance.formats.durations import Duration, DurationError
from nros_conformance.suite.moments import MOMENT_PATTERN, Moment


@pytest.mark.parametrize(
    ("text", "label", "kind", "index", "edge", "offset"),
    [
        ("start", "start", None, None, None, "0"),
        ("data", "data", None, None, None, "0"),
        ("data.first", "data", None, 0, None, "0"),
        ("data.last", "data", None, -1, None, "0"),
        ("data[2].end", "data", None, 2, "end", "0"),
        ("data[-2]", "data", None, -2, None, "0"),
        ("gone.begin", "gone", None, None, "begin", "0"),
        ("listener.created", "listener", None, None, "created", "0"),
        ("start.settled", "start", None, None, "settled", "0"),
        ("listener.LivelinessChanged", "listener", "LivelinessChanged", None, None, "0"),
        ("listener.LivelinessChanged[0]", "listener", "LivelinessChanged", 0, None, "0"),
        ("listener.MessageLost.last.end", "listener", "MessageLost", -1, "end", "0"),
        ("crowd[1].created", "crowd[1]", None, None, "created", "0"),
        ("crowd[1].LivelinessLost[0]", "crowd[1]", "LivelinessLost", 0, None, "0"),
        ("data.last + 0.95T", "data", None, -1, None, "+ 0.95T"),
        ("gone - 2 * connection_lease + 1ms", "gone", None, None, None, "- 2 * connection_lease + 1ms"),
        ("a-b", "a-b", None, None, None, "0"),
    ],
)
def test_what_moments_mean(
    text: str, label: str, kind: str | None, index: int | None, edge: str | None, offset: str
) -> None:
    moment = Moment.parse(f" {text} ")
    assert (moment.label, moment.kind, moment.index, moment.edge) == (label, kind, index, edge)
    assert moment.offset == Duration.parse(offset)
    assert re.search(MOMENT_PATTERN, text)


@pytest.mark.parametrize("text", ["", "data.lst", "2T", "data.first.last", "data[x]", "data * 2", "data.end.begin"])
def test_what_is_no_moment(text: str) -> None:
    with pytest.raises(DurationError) as caught:
        Moment.parse(text)
    expected = f"cannot read the moment {text!r}; write for example data.last, start or gone.end + 2T"
    assert str(caught.value) == expected
    assert not re.search(MOMENT_PATTERN, text)


def test_a_number_is_no_moment() -> None:
    with pytest.raises(DurationError, match="cannot read the moment '5'"):
        Moment.parse(5)


def test_the_offset_is_a_duration() -> None:
    with pytest.raises(DurationError) as caught:
        Moment.parse("data + 2")
    assert str(caught.value) == "2 in '+ 2' has no unit; write for example 2ms or 2T"


def test_moments_are_values() -> None:
    one = Moment.parse("data.last + 1T")
    assert one == Moment.parse("data.last + 1T ")
    assert str(one) == "data.last + 1T"
    assert repr(one) == "Moment('data.last + 1T')"
    assert len({one, Moment.parse("data.last + 1T")}) == 1
    assert pickle.loads(pickle.dumps(one)).offset == one.offset
