"""Plays the client's half of a recorded conversation to our agent, on a clock of its own."""

from __future__ import annotations

from nros_backends.xrce.agent.core import TICK_NS, Agent, Outgoing
from nros_backends.xrce.wire import Message, decode
from nros_backends.xrce.wire.messages import GetInfo, Heartbeat
from tests.backends.xrce.captures import Conversation, Datagram

TICKS = (Heartbeat, GetInfo)
"""What the agent sends on its ticks."""
LATENCY_NS = 200_000
"""From the recorded agent's tick to the recording of what it sent: 0.1 to 0.3 ms."""


def replay(conversation: Conversation) -> list[Datagram]:
    """What our agent sends, in the form of the recording.

    Our agent ticks when the recorded one did: its period of 200 ms and a little is taken from the recording.
    """
    start, period = _ticks(conversation)
    agent = None if conversation.name.endswith("_no_agent") else Agent(start, tick_ns=period)
    events = list(conversation.events)
    sent: list[Datagram] = []
    now = 0

    def put(outgoing: list[Outgoing]) -> None:
        sent.extend(Datagram(now, False, payload, "", peer, False) for payload, (_, peer) in outgoing)

    def run(until: int) -> None:
        nonlocal now
        while agent is not None and (due := agent.wakeup_ns(now)) is not None and due <= until:
            now = due
            put(agent.advance(now))
        now = until

    for datagram in conversation.datagrams:
        while events and events[0].at_ns <= datagram.at_ns:
            event = events.pop(0)
            if "agent" in event.text:
                run(event.at_ns)
                agent = Agent(start, tick_ns=period) if "start" in event.text else None
        run(datagram.at_ns)
        if agent is not None and datagram.to_agent and not datagram.dropped:
            put(agent.receive(datagram.payload, ("client", datagram.peer), now))
    return sent


def _ticks(conversation: Conversation) -> tuple[int, int]:
    """Phase and period of the recorded agent's ticks."""
    seen = [
        one.at_ns - LATENCY_NS
        for one in conversation.datagrams
        if not one.to_agent and isinstance(decode(one.payload).submessages[0], TICKS)
    ]
    if not seen:  # no tick of its own found anything to do
        return conversation.datagrams[-1].at_ns + 1 - 10 * TICK_NS, 10 * TICK_NS
    count = round((seen[-1] - seen[0]) / TICK_NS)
    period = (seen[-1] - seen[0]) // count if count else TICK_NS
    return seen[0] % period - period, period


def by_stream(datagrams: list[Datagram]) -> dict[tuple[int, int, str], list[Message]]:
    """Messages in order, by client endpoint, stream and (on stream 0) kind."""
    found: dict[tuple[int, int, str], list[Message]] = {}
    for datagram in datagrams:
        message = decode(datagram.payload)
        stream = message.header.stream
        kind = type(message.submessages[0]).__name__ if stream == 0 else ""
        found.setdefault((datagram.peer, stream, kind), []).append(message)
    return found
