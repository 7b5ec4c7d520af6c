"""Expectations about samples, known by their payload: received, conserved."""

from __future__ import annotations

from collections.abc import Sequence

from nros_conformance.formats.counts import many
from nros_conformance.judge.calls import told
from nros_conformance.judge.findings import Judged, clock, together, unless_blind
from nros_conformance.judge.index import Index
from nros_conformance.judge.intervals import INF, Interval, decide
from nros_conformance.judge.moments import window_start
from nros_conformance.judge.standing import excused
from nros_conformance.suite import schema
from nros_conformance.trace.records import Act, Message


def _named(act: Act) -> tuple[str, int]:
    return act.entity, int(act.args.get("sequence", act.index))


def _sample(identity: tuple[str, int]) -> str:
    return f"sample {identity[1]} of {identity[0]}"


# --- received -------------------------------------------------------------------------------------


def received(index: Index, expected: schema.Received | schema.ReceivedGiven) -> Judged:
    """Which samples of a label the takes of a subscription returned: in order of publishing, each once."""
    amount = {"all": "all samples", "none": "no sample"}.get(str(expected.is_)) or (
        many(expected.is_, "sample") if isinstance(expected.is_, int) else ""
    )
    wanted = f"{amount} of {expected.received}, in order and once"
    acts = [act for act in index.acts_of(expected.received) if act.op == "publish"]
    published = [act for act in acts if act.result == 0]
    if not published:
        why = (
            f"{expected.received} answered {told(acts[-1])}"
            if acts
            else f"there is no {expected.received} in the trace"
        )
        return Judged("none" if index.whole else "unclear", wanted, why)
    return together(
        _received(index, expected, entity, published)._replace(wanted=f"{wanted}, on {entity}")
        for entity in index.members(expected.of)
    )


def _received(
    index: Index, expected: schema.Received | schema.ReceivedGiven, entity: str, published: Sequence[Act]
) -> Judged:
    messages = [one for _, one in index.messages.get(entity, ()) if one.label == expected.received]
    disorder = _disorder(index, messages)
    if disorder is not None and expected.is_ != "none":
        return disorder
    sent = {_named(act) for act in published}
    came = {(one.publisher, one.sequence) for one in messages} & sent
    missing = [act for act in published if _named(act) not in came]
    number = len(published) - len(missing)
    wanted = {"all": len(published), "none": 0}.get(str(expected.is_), expected.is_)
    assert isinstance(wanted, int)
    if len(came) > wanted:
        late = messages[wanted]
        got = f"{many(len(came), 'sample')}, such as {_sample((late.publisher, late.sequence))} {clock(index, late.t)}"
        return Judged("fail", "", got, at=late.t)
    session = index.session_of(entity)
    if len(came) < wanted:
        due = missing[-1].end + index.late
        looked = _looked(index, entity) >= due
        first = _sample(_named(missing[0]))
        got = f"{number} of {len(published)}, {first} is missing" + (
            "" if looked else ", and nobody looked for it later"
        )
        judged = Judged(decide(looked and index.whole, True), "", got, at=missing[0].end, missing=True)
    elif wanted < len(published) and _looked(index, entity) < published[-1].end + index.late:
        judged = Judged("unclear", "", f"{number} of {len(published)}, and nobody looked for more later")
    else:
        judged = Judged("pass", "", f"{number} of {len(published)}")
    return unless_blind(index, session, judged)


def _disorder(index: Index, messages: Sequence[Message]) -> Judged | None:
    """A sample that came twice, or after one that its publisher sent later."""
    seen: set[tuple[str, int]] = set()
    last: dict[str, int] = {}
    for one in messages:
        identity = (one.publisher, one.sequence)
        what = f"{_sample(identity)} came"
        if identity in seen:
            return Judged("fail", "", f"{what} twice, the second time {clock(index, one.t)}", at=one.t)
        if one.sequence < last.get(one.publisher, one.sequence):
            got = f"{what} {clock(index, one.t)}, after sample {last[one.publisher]}"
            return Judged("fail", "", got, at=one.t)
        seen.add(identity)
        last[one.publisher] = one.sequence
    return None


def _looked(index: Index, entity: str) -> int:
    """When the samples that had arrived were last taken out: the end of the last drive_io before it, -INF for never.

    A take that stopped at its limit left samples behind.
    """
    drives = index.drives_of(entity)
    spec = index.scenario.entities.get(entity.partition("[")[0])
    best = -INF
    for position, act in index.all_acts:
        if act.op != "take" or act.entity != entity:
            continue
        limit = act.args.get("max")
        if limit is None or not isinstance(act.result, int) or act.result < limit:
            best = max(best, drives.surely(position, act.begin))
    if spec is not None and spec.take == "always":
        best = max(best, drives.surely())
    taken = index.messages.get(entity, ())
    spun = [position for position, message in taken if message.callback]
    return max(best, drives.surely() if spun else -INF)


# --- conserved ------------------------------------------------------------------------------------


def conserved(index: Index, expected: schema.Conserved) -> Judged:
    """Received plus lost is published, from ``since`` to the last sample received of each publisher.

    What was published after it may be reported as lost already, and need not be.
    """
    since = window_start(index, expected.since)
    publishers = index.members(expected.from_)
    return together(
        _conserved(index, expected, entity, publishers, since) for entity in index.members(expected.conserved)
    )


def _conserved(
    index: Index, expected: schema.Conserved, entity: str, publishers: Sequence[str], since: Interval
) -> Judged:
    wanted = f"received + lost = published by {' and '.join(publishers)} on {entity}"
    wanted += f" since {expected.since}" if expected.since.text != "start" else ""
    excuse = excused(index, entity, "MessageLost", needs_event=True)
    if excuse is not None:
        return excuse._replace(wanted=wanted)
    stranger = next((publisher for publisher in publishers if not _met(index, publisher, entity)), None)
    if stranger is not None:
        return Judged("unclear", wanted, f"{stranger} and {entity} had not met within the discovery bound")
    published, uncertain = _published(index, publishers, since)
    if uncertain:
        return Judged("unclear", wanted, f"{_sample(min(uncertain))} was perhaps published before {expected.since}")
    taken = [
        (place, (one.publisher, one.sequence), one.t)
        for place, one in index.messages.get(entity, ())
        if (one.publisher, one.sequence) in published
    ]
    if not taken:
        return Judged("none" if index.whole else "unclear", wanted, "no sample was received")
    came = {identity for _, identity, _ in taken}
    last: dict[str, int] = {}
    for publisher, sequence in came:
        last[publisher] = max(sequence, last.get(publisher, sequence))
    missing = published - came
    gaps = sum(sequence < last.get(publisher, -1) for publisher, sequence in missing)
    events = index.events_of(entity, "MessageLost")
    sure = sum(seen.change for seen in events if seen.when.lo > since.hi)
    possible = sum(seen.change for seen in events if seen.when.hi >= since.lo)
    place, _, t = taken[-1]
    got = f"{len(came)} received + {possible} lost, {len(came) + gaps} published"
    judged = Judged("pass", wanted, got, at=t)
    if possible > len(missing):
        judged = Judged(
            decide(sure > len(missing) and index.whole, True), wanted, got, at=t, surplus=possible - len(missing)
        )
    elif sure < gaps:
        driven = index.drives_of(entity).surely(after=place) >= t + index.late
        got += "" if driven else ", and nobody drove it after the last take"
        judged = Judged(
            decide(possible < gaps and driven and index.whole, True), wanted, got, at=t,
            surplus=sure - gaps, missing=True,
        )  # fmt: skip
    return unless_blind(index, index.session_of(entity), judged)


def _met(index: Index, publisher: str, entity: str) -> bool:
    """Whether they had met for certain when a ``settle`` was over, if there was one: MSL-001 counts since then."""
    found = [one for one in index.matched if (one.publisher, one.subscription) == (publisher, entity)]
    return not found or any(one.how != "timeout" for one in found)


def _published(
    index: Index, publishers: Sequence[str], since: Interval
) -> tuple[set[tuple[str, int]], set[tuple[str, int]]]:
    """Samples published certainly, and perhaps, since then. What answered an error was not published."""
    surely: set[tuple[str, int]] = set()
    perhaps: set[tuple[str, int]] = set()
    for _, act in index.all_acts:
        if act.op != "publish" or act.entity not in publishers or act.result != 0:
            continue
        if act.begin >= since.hi:
            surely.add(_named(act))
        elif act.end >= since.lo:
            perhaps.add(_named(act))
    return surely, perhaps
