"""What a drive_io is charged with: not what the harness does meanwhile."""

from __future__ import annotations

from typing import Any, cast

from nros_conformance.play.driver import Command, Driver
from nros_conformance.rmw.backend import Session
from nros_conformance.rmw.clock import MS, VirtualClock
from nros_conformance.trace.records import Act, AnyRecord, Spin


def test_a_callback_is_no_time_of_the_backends_but_for_the_calls_that_it_makes() -> None:
    clock, records = VirtualClock(), list[AnyRecord]()
    driver = Driver("sub", clock, records.append, lambda outcome, detail: None)

    def work(ms: int) -> int:
        clock.wait(None, clock.now_ns() + ms * MS)
        return 0

    class Drives:
        def drive_io(self, timeout_ms: int) -> int:
            work(2)
            with driver.callback():
                work(30)
                driver.execute(Command(clock, clock.now_ns(), lambda: work(5), op="take", label="inner"))
                work(10)
            return 0

    driver.thread, driver.session = clock.task_id(), cast(Session, Drives())
    driver.drive(0)
    driver.drive(0)
    driver.flush()
    spins = [record for record in records if isinstance(record, Spin)]
    assert [(one.longest // MS, one.wait // MS) for one in spins] == [(47, 40)] * 2
    assert [one.end - one.begin for one in records if isinstance(one, Act)] == [5 * MS, 5 * MS]


def test_what_was_waited_when_the_callback_before_returned_is_known() -> None:
    clock, seen = VirtualClock(), list[int]()
    driver = Driver("sub", clock, lambda record: None, lambda outcome, detail: None)

    class Drives:
        def drive_io(self, timeout_ms: int) -> int:
            for ms in (30, 20):
                seen.append(driver.wait_at_callback // MS)
                with driver.callback(), driver.callback():
                    clock.wait(None, clock.now_ns() + ms * MS)
            seen.append(driver.wait_at_callback // MS)
            return 0

    driver.thread, driver.session = clock.task_id(), cast(Session, Drives())
    driver.drive(0)
    driver.drive(0)
    assert seen == [0, 30, 50] * 2


def test_a_drive_of_the_script_lasts_as_long_as_the_call() -> None:
    clock = VirtualClock()

    def write(record: Any) -> None:
        clock.wait(None, clock.now_ns() + 20 * MS)
        records.append(record)

    records = list[AnyRecord]()
    driver = Driver("sub", clock, write, lambda outcome, detail: None)

    class Drives:
        def drive_io(self, timeout_ms: int) -> int:
            clock.wait(None, clock.now_ns() + 7 * MS)
            driver.keep(Spin(session="other", begin=0, end=0, sure=0, code=0))
            return 0

    driver.thread, driver.session = clock.task_id(), cast(Session, Drives())
    driver.execute(Command(clock, clock.now_ns(), lambda: driver.drive(0), op="drive", label="call"))
    (act,) = [record for record in records if isinstance(record, Act)]
    assert act.end - act.begin == 7 * MS


def test_drives_are_longer_while_nobody_has_a_call_to_make() -> None:
    clock, asked = VirtualClock(), list[int]()
    driver = Driver("sub", clock, lambda record: None, lambda outcome, detail: None)

    class Drives:
        def drive_io(self, timeout_ms: int) -> int:
            asked.append(timeout_ms)
            clock.wait(None, clock.now_ns() + timeout_ms * MS)
            return 0

    def drive_for(ms: int) -> list[int]:
        asked.clear()
        clock.wait(None, clock.now_ns() + ms * MS)
        return list(asked)

    def play() -> tuple[list[int], ...]:
        driver.session = cast(Session, Drives())
        driver.resume()
        usual = drive_for(35)
        driver.calm_until = clock.now_ns() + 103 * MS  # a drive goes on for 5
        calm = drive_for(105)
        driver.calm_until = clock.now_ns() + 100 * MS
        driver.after_drive.append(lambda: None)
        takes = drive_for(100)
        driver.pause()
        driver.stop()
        return usual, calm, takes

    usual, calm, takes = clock.run(play)
    assert usual == [10, 10, 10, 10]
    assert calm == [30, 30, 20, 10, 10]  # the last one is a usual one, and goes on when it is over
    assert takes == [10] * len(takes)
