from __future__ import annotations

import pickle
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nros_conformance.formats.durations import QUANTITIES, UNITS_NS, Duration, DurationError, Period

MS = 1_000_000
VALUES = {"T": 130 * MS, "tolerance": 39 * MS, "connection_lease": 1000 * MS}


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("0", 0),
        (0, 0),
        (0.0, 0),
        ("15ns", 15),
        ("15us", 15_000),
        ("130ms", 130 * MS),
        (" 2 s ", 2000 * MS),
        ("1min", 60_000 * MS),
        ("1h", 3_600_000 * MS),
        ("2 * s", 2000 * MS),
        ("T", 130 * MS),
        ("3.5T", 455 * MS),
        ("3.5 T", 455 * MS),
        ("2 * connection_lease", 2000 * MS),
        ("3T + tolerance", 429 * MS),
        ("1T - 2ms", 128 * MS),
        ("-3600s", -3_600_000 * MS),
        ("+1T", 130 * MS),
        ("1T + 1T", 260 * MS),
        ("0.1T+0.2T", 39 * MS),
    ],
)
def test_what_durations_mean(text: str | int | float, ns: int) -> None:
    assert Duration.parse(text).ns(VALUES) == ns


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "an empty duration; write for example 130ms or 3.5T"),
        (3, "3 in '3' has no unit; write for example 3ms or 3T"),
        (1.5, "1.5 in '1.5' has no unit; write for example 1.5ms or 1.5T"),
        (True, "'True' is not a duration; write for example 130ms or 3.5T"),
        ([1], "'[1]' is not a duration; write for example 130ms or 3.5T"),
        ("ms", "'ms' in 'ms' has no number; write for example 1ms"),
        ("1T + ms", "'ms' in '1T + ms' has no number; write for example 1ms"),
        ("2sec", "unknown unit 'sec' in the duration '2sec'; did you mean 's'?"),
        (
            "2 * conection_lease",
            "unknown unit 'conection_lease' in the duration '2 * conection_lease'; did you mean 'connection_lease'?",
        ),
        ("1T +", "the duration '1T +' ends with '+'; something has to follow"),
        ("1T + * 2", "cannot read ' * 2' in the duration '1T + * 2'"),
        ("connection_lease * 2", "cannot read '* 2' in the duration 'connection_lease * 2'"),
        ("1T, 2T", "cannot read ', 2T' in the duration '1T, 2T'"),
        (".5T", "cannot read '.5T' in the duration '.5T'"),
        (
            "infinite",
            "unknown unit 'infinite' in the duration 'infinite'; known are ns, us, ms, s, min, h, T, tolerance, "
            "early, discovery_bound, connection_lease, hard_liveliness_timeout, hard_liveliness_grace",
        ),
    ],
)
def test_what_is_no_duration(text: str, message: str) -> None:
    with pytest.raises(DurationError) as caught:
        Duration.parse(text)
    assert str(caught.value) == message


def test_only_a_period_may_be_infinite() -> None:
    assert Period.parse("infinite").is_infinite
    assert not Period.parse("1T").is_infinite
    assert isinstance(Period.parse("1T"), Period)


def test_a_duration_knows_what_it_depends_on() -> None:
    assert Duration.parse("3T + tolerance - 2ms").names == {"T", "tolerance"}
    with pytest.raises(KeyError, match="tolerance"):
        Duration.parse("3T + tolerance").ns({"T": 1})


def test_durations_are_values() -> None:
    one = Duration.parse("1T")
    assert one == Duration.parse(" 1T ")
    assert one != Duration.parse("1 T")
    assert str(one) == "1T"
    assert repr(one) == "Duration('1T')"
    assert len({one, Duration.parse("1T")}) == 1
    assert pickle.loads(pickle.dumps(one)) == one


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["+", "-"]),
            st.decimals(0, 1000, places=3),
            st.sampled_from([*UNITS_NS, *QUANTITIES]),
        ),
        min_size=1,
    )
)
def test_a_sum_is_the_sum_of_its_terms(terms: list[tuple[str, object, str]]) -> None:
    quantities = {name: 1_000_000 * place for place, name in enumerate(QUANTITIES, 3)}
    text = " ".join(f"{sign} {factor} {unit}" for sign, factor, unit in terms)
    exact = [Fraction(f"{sign}{factor}") * (UNITS_NS | quantities)[unit] for sign, factor, unit in terms]
    assert Duration.parse(text).ns(quantities) == int(sum(exact))
