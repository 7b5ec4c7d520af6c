from __future__ import annotations

import threading

import pytest

from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.driving import Driving

Calls = list[tuple[int, int | None]]


@pytest.mark.parametrize(("timeout_ms", "until_ms"), [(30, 130), (0, 100), (-5, 100)])
def test_the_loop_is_told_until_when_and_a_negative_timeout_is_none(timeout_ms: int, until_ms: int) -> None:
    calls: Calls = []
    driving = Driving(VirtualClock(100 * MS))
    assert driving.drive(timeout_ms, 3, lambda *told: calls.append(told)) == ReturnCode.OK
    assert calls == [(until_ms * MS, 3)]


@pytest.mark.parametrize(("timeout_ms", "cap"), [(None, None), ("1", None), (0.5, None), (0, -1), (0, "1"), (0, 0.5)])
def test_what_is_no_number_is_refused_and_nothing_is_driven(timeout_ms: int, cap: int) -> None:
    calls: Calls = []
    assert Driving(VirtualClock()).drive(timeout_ms, cap, lambda *told: calls.append(told)) == (
        ReturnCode.INVALID_ARGUMENT
    )
    assert calls == []


def test_a_callback_that_drives_would_block_and_the_next_call_does_not() -> None:
    driving, codes = Driving(VirtualClock()), list[int]()
    driving.drive(0, None, lambda *_: codes.append(driving.drive(0, None, lambda *_: None)))
    codes.append(driving.drive(0, None, lambda *_: None))
    assert codes == [ReturnCode.WOULD_BLOCK, ReturnCode.OK]


def test_an_error_of_the_loop_goes_on_to_the_driver_and_leaves_the_session_drivable() -> None:
    driving = Driving(VirtualClock())
    with pytest.raises(ZeroDivisionError):
        driving.drive(0, None, lambda *_: 1 // 0)
    assert driving.drive(0, None, lambda *_: None) == ReturnCode.OK


def test_the_end_waits_for_a_driver_on_another_thread() -> None:
    driving, order = Driving(MonotonicClock()), list[str]()
    began, leave = threading.Event(), threading.Event()

    def loop(*_: object) -> None:
        began.set()
        leave.wait()
        order.append("left")

    driver = threading.Thread(target=driving.drive, args=(0, None, loop))
    driver.start()
    began.wait()
    seen = [driving.under_way]
    assert driving.drive(0, None, loop) == ReturnCode.WOULD_BLOCK
    threading.Timer(0.02, leave.set).start()
    with driving.ended():
        order.append("ended")
        assert driving.drive(0, None, loop) == ReturnCode.WOULD_BLOCK
    driver.join()
    assert [*seen, driving.under_way] == [True, False]
    assert order == ["left", "ended"]


def test_the_end_from_a_callback_waits_for_nobody() -> None:
    driving, order = Driving(VirtualClock()), list[str]()

    def loop(*_: object) -> None:
        with driving.ended():
            order.append("ended")

    assert driving.drive(0, None, loop) == ReturnCode.OK
    assert order == ["ended"]
