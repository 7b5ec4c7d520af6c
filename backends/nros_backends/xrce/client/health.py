"""Whether the agent is there and knows the session, from what was heard of it and from probes.

An agent that restarts says nothing, and answers a session that it does not know with nothing either,
but for the in-session GET_INFO: its implementation status is 1 only for a session that it knows.
So silence is answered with such a probe, and a session is given up when probes stay unanswered.
"""

from __future__ import annotations

import enum

from nros_conformance.rmw.clock import NEVER

_QUIET = 4
"""A probe is sent after this part of the lease without a word from the agent..."""

_AGAIN = 8
"""...and again after this part of it without an answer."""

_SILENT = 2
"""The agent is gone when probes have stayed unanswered for this part of the lease. With `_QUIET` that
makes three quarters of it, and up to five probes."""


class State(enum.Enum):
    """What is known of the agent."""

    WELL = "well"
    SILENT = "silent"
    """It does not answer; it may yet, and then the session is well again."""
    FORGOTTEN = "forgotten"
    """It answered that it does not know this session; only a new session helps."""


class Health:
    """Bookkeeping over times that its user hands in. ``lease_ns``: in which a lost agent has to be noticed.

    Time in which nobody looks does not count against the agent: only unanswered probes do, and what
    has arrived has to be handed in before `look`.
    """

    def __init__(self, lease_ns: int, now_ns: int) -> None:
        self.lease_ns = lease_ns
        self.state = State.WELL
        self._heard_ns = now_ns
        self._asked_ns: int | None = None
        """When the first probe since the agent was heard last was sent."""
        self._probed_ns = now_ns

    def heard(self, at_ns: int) -> None:
        """A message came that only an agent which knows this session sends."""
        self._heard_ns = max(self._heard_ns, at_ns)
        self._asked_ns = None
        if self.state is State.SILENT:
            self.state = State.WELL

    def forgotten(self) -> None:
        """The agent said that it does not know this session."""
        self.state = State.FORGOTTEN

    def look(self, now_ns: int) -> bool:
        """Judge the silence up to now; whether a probe is to be sent, which is taken as sent."""
        if self.state is State.FORGOTTEN or now_ns < self._due_ns():
            return False
        if self._asked_ns is None:
            self._asked_ns = now_ns
        elif now_ns - self._asked_ns >= self.lease_ns // _SILENT:
            self.state = State.SILENT
        self._probed_ns = now_ns
        return True

    @property
    def next_due_ns(self) -> int:
        """When `look` wants to be called next."""
        return NEVER if self.state is State.FORGOTTEN else self._due_ns()

    def _due_ns(self) -> int:
        if self._asked_ns is None:
            return self._heard_ns + self.lease_ns // _QUIET
        due_ns = self._probed_ns + self.lease_ns // _AGAIN
        if self.state is State.WELL:
            due_ns = min(due_ns, self._asked_ns + self.lease_ns // _SILENT)
        return due_ns
