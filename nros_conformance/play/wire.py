"""What the harness and its worker processes say to each other: one JSON object a line."""

from __future__ import annotations

from typing import TypeAlias

import msgspec
from msgspec import Struct

from nros_conformance.play.plan import Plan


class Job(Struct, frozen=True, tag="job"):
    """To the worker, once: play these, at most ``concurrency`` at a time."""

    plans: list[Plan]
    concurrency: int
    virtual: bool


class Started(Struct, frozen=True, tag="started"):
    """This play has begun."""

    key: str


class Finished(Struct, frozen=True, tag="finished"):
    """This play has ended, its trace is complete; ``outcome`` as in the `End` record."""

    key: str
    outcome: str
    seconds: float


class Beat(Struct, frozen=True, tag="beat"):
    """The worker's interpreter still runs."""


class Broken(Struct, frozen=True, tag="broken"):
    """The worker cannot play at all, and why."""

    detail: str


Report: TypeAlias = Started | Finished | Beat | Broken

_ENCODER = msgspec.json.Encoder()
_JOB = msgspec.json.Decoder(Job)
_REPORT: msgspec.json.Decoder[Report] = msgspec.json.Decoder(Report)


def encode(message: Job | Report) -> bytes:
    """One line."""
    return _ENCODER.encode(message) + b"\n"


def decode_job(line: bytes) -> Job:
    """A `Job` from its line."""
    return _JOB.decode(line)


def decode_report(line: bytes) -> Report:
    """What a worker said."""
    return _REPORT.decode(line)
