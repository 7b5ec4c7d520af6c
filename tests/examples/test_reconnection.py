from __future__ import annotations

from nros_backends.reference import ReferenceBackend
from nros_backends.uorb import UorbBackend
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.codes import ReturnCode, RmwError
from tests.examples.test_examples import play, printed, run


class ForgetsOnce(ReferenceBackend):
    """Creates one session and no other."""

    made = False

    def create_session(self, options: SessionOptions):  # type: ignore[no-untyped-def]
        if self.made:
            raise RmwError(ReturnCode.CONNECTION_FAILED, "the slot is taken")
        self.made = True
        return super().create_session(options)


def test_the_readme_shows_what_the_example_prints() -> None:
    worked, lines, took_ms = play("reconnection", ReferenceBackend)
    assert worked
    assert lines == printed("reconnection.py")
    assert took_ms < 3_000


def test_without_a_ping_there_is_nothing_to_show() -> None:
    worked, lines, _ = play("reconnection", UorbBackend)
    assert not worked
    assert lines == ["ping: unsupported, this backend has no agent to lose"]


def test_a_client_that_does_not_come_back_has_failed() -> None:
    worked, lines, _ = play("reconnection", ForgetsOnce)
    assert not worked
    assert lines.count("client: data flows") == 1
    assert "failed: connected 1 times" in lines


def test_it_runs_as_a_command() -> None:
    done = run("reconnection")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2] == "worked: connected 3 times"
