"""Expectations about what calls answered and how long they took."""

from __future__ import annotations

from nros_conformance.formats.counts import many
from nros_conformance.judge.callbacks import not_made
from nros_conformance.judge.findings import Judged, clock, code_words, milliseconds
from nros_conformance.judge.index import CALLS, Index
from nros_conformance.judge.intervals import Interval, decide
from nros_conformance.rmw.codes import PUBLISHED_ERRORS, ReturnCode
from nros_conformance.suite import schema
from nros_conformance.suite.policies import unsupported
from nros_conformance.trace.records import Act


class UnknownAnswer(ValueError):
    """A suite asks for an answer that there is not."""


def fits(act: Act, words: list[str]) -> bool:
    """Whether the answer of a call is one of these. Raises `UnknownAnswer`."""
    return any(_fits(act, word) for word in words)


def _fits(act: Act, word: str) -> bool:
    result = None if act.raised else act.result
    if word in ("true", "false"):
        return result is (word == "true")
    counts = act.op == "take"
    number = result if isinstance(result, int) and not isinstance(result, bool) else None
    if word == "ANY_ERROR":
        return number in PUBLISHED_ERRORS
    if word == "DATA":
        return counts and number is not None and number > 0
    if word not in ReturnCode.__members__:
        raise UnknownAnswer(f"there is no answer {word}; see the return codes, ANY_ERROR, true, false and DATA")
    if counts and number == 0:
        return word == "NO_DATA"
    return number == ReturnCode[word]


def told(act: Act) -> str:
    """The answer of a call for people: ``UNSUPPORTED (-5)``, ``true``, ``3 samples``."""
    if act.raised:
        return f"raised: {act.raised}"
    if isinstance(act.result, bool):
        return str(act.result).lower()
    if not isinstance(act.result, int):
        return "nothing" if act.result is None else repr(act.result)
    if act.op == "take" and act.result >= 0:
        return many(act.result, "sample")
    return code_words(act.result)


def returns(index: Index, expected: schema.Returns) -> Judged:
    """What the actions of a label answered; of an entity's name: what creating it answered."""
    words = " or ".join(expected.is_)
    wanted = f"{'one of ' if expected.some else ''}{expected.returns} answers {words}"
    acts = index.acts_of(expected.returns) or _creations(index, expected.returns)
    if not acts:
        return not_made(index, expected.returns)._replace(wanted=wanted)
    right = [act for act in acts if fits(act, expected.is_)]
    wrong = [act for act in acts if not fits(act, expected.is_)]
    if expected.some:
        if right:
            return Judged("pass", wanted, told(right[0]), at=right[0].begin)
        return Judged(decide(index.whole, True), wanted, _answers(acts), at=acts[-1].begin)
    if wrong:
        which = f"{expected.returns}[{wrong[0].index}] answered " if len(acts) > 1 else ""
        return Judged("fail", wanted, which + told(wrong[0]), at=wrong[0].begin)
    return Judged("pass", wanted, _answers(acts), at=acts[0].begin)


def _creations(index: Index, entity: str) -> list[Act]:
    return [
        Act(
            label=entity, index=number, op="create", session=state.session, entity=state.entity,
            due=state.begin, begin=state.begin, end=state.end, result=state.code,
        )
        for number, (_, state) in enumerate(index.states)
        if state.what in ("created", "refused") and state.entity in index.members(entity) and state.entity
    ]  # fmt: skip


def _answers(acts: list[Act]) -> str:
    return ", ".join(dict.fromkeys(told(act) for act in acts))


def agrees(index: Index, expected: schema.Agrees) -> Judged:
    """``supports_event`` was true exactly where registering answered OK, pair by pair."""
    wanted = f"{expected.agrees} is true exactly when {expected.with_} answers OK"
    asked, registered = index.acts_of(expected.agrees), index.acts_of(expected.with_)
    for label, acts in ((expected.agrees, asked), (expected.with_, registered)):
        if not acts:
            return not_made(index, label)._replace(wanted=wanted)
    pairs = list(zip(asked, registered, strict=False))
    for before, after in pairs:
        if (before.result is True) != (after.result == 0 and after.result is not False and not after.raised):
            got = f"{expected.agrees} {told(before)}, {expected.with_} {told(after)}"
            return Judged("fail", wanted, got, at=after.begin)
    if len(asked) != len(registered):
        got = f"{len(asked)} answers of {expected.agrees}, {len(registered)} of {expected.with_}"
        return Judged("none" if index.whole else "unclear", wanted, got)
    got = f"{expected.agrees} {_answers(asked)}, {expected.with_} {_answers(registered)}"
    return Judged("pass", wanted, got, at=registered[0].begin)


def admitted(index: Index, expected: schema.Admitted) -> Judged:
    """Creating the entity answered INCOMPATIBLE_QOS if the declaration says that a policy is unsupported, else OK."""
    name = expected.admitted
    qos = index.scenario.entities[name.partition("[")[0]].qos
    lacking = unsupported(qos, index.header.declares.get("unsupported") or ())
    answer = ReturnCode.INCOMPATIBLE_QOS if lacking else ReturnCode.OK
    wanted = f"creating {name} answers {answer.name}" + (f" for {' and '.join(lacking)}" if lacking else "")
    creations = _creations(index, name)
    if not creations:
        return Judged("none" if index.whole else "unclear", wanted, f"{name} was not created")
    wrong = next((act for act in creations if act.result != answer), None)
    deciding = wrong or creations[0]
    return Judged("fail" if wrong else "pass", wanted, told(deciding), at=deciding.begin)


def measured(index: Index, expected: schema.Measured) -> Judged:
    """By how much a quantity, such as the processor time of the process in ns, grew between two measurements."""
    most = expected.at_most.ns(index.quantities)
    wanted = f"{expected.measured} grows by at most {expected.at_most} from {expected.from_} to {expected.to}"
    values: list[float] = []
    for label in (expected.from_, expected.to):
        found = [one for one in index.measures if (one.label, one.what) == (label, expected.measured)]
        if not found:
            return not_made(index, label)._replace(wanted=wanted)
        values.append(found[-1].value)
    grown = round(values[1] - values[0])
    return Judged(decide(grown > most, False), wanted, milliseconds(grown), grown - most)


def counted(index: Index, expected: schema.Counted) -> Judged:
    """A number that was measured, or by how much it is more than at another measurement."""
    since = f" more than at {expected.since}" if expected.since is not None else ""
    bounds = [f"{expected.is_}"] if expected.is_ is not None else []
    bounds += [f"at least {expected.at_least}"] if expected.at_least is not None else []
    bounds += [f"at most {expected.at_most}"] if expected.at_most is not None else []
    wanted = f"{expected.counted} is {' and '.join(bounds)}{since}"
    values: list[int] = []
    for label in (expected.counted, expected.since):
        if label is None:
            continue
        found = [one for one in index.measures if one.label == label]
        if not found and index.acts_of(label):
            return Judged("none", wanted, "the peer cannot be asked")
        if not found:
            return not_made(index, label)._replace(wanted=wanted)
        values.append(int(found[-1].value))
    number = values[0] - (values[1] if since else 0)
    least = expected.is_ if expected.is_ is not None else expected.at_least
    most = expected.is_ if expected.is_ is not None else expected.at_most
    wrong = (least is not None and number < least) or (most is not None and number > most)
    at = index.acts_of(expected.counted)[-1].begin
    return Judged("fail" if wrong else "pass", wanted, str(number), at=at)


def takes(index: Index, expected: schema.Takes) -> Judged:
    """How long each call took: as measured, less at most the time its thread waited for a processor."""
    most = expected.at_most.ns(index.quantities) if expected.at_most is not None else None
    least = expected.at_least.ns(index.quantities) if expected.at_least is not None else None
    bounds = [f"at least {expected.at_least}"] if least is not None else []
    bounds += [f"at most {expected.at_most}"] if most is not None else []
    wanted = f"each call of {expected.takes} takes {' and '.join(bounds)}"
    placed = index.acts.get(expected.takes)
    if not placed:
        return not_made(index, expected.takes)._replace(wanted=wanted)
    doubt: Judged | None = None
    measured: list[int] = []
    for position, act in placed:
        took = _duration(index, position, act)
        measured.append(took.hi)
        where = f"{expected.takes}[{act.index}] {clock(index, act.begin)} took {milliseconds(took.hi)}"
        if most is not None and took.hi > most:
            judged = Judged(decide(took.lo > most, True), wanted, where, took.hi - most, act.end)
        elif least is not None and took.lo < least:
            judged = Judged(
                decide(took.hi < least, True), wanted, where, (took.hi if took.hi < least else took.lo) - least, act.end
            )
        else:
            continue
        if judged.outcome == "fail":
            return judged
        waited = f", of which it may have waited {milliseconds(took.hi - took.lo)} for a processor"
        doubt = doubt or judged._replace(got=where + waited)
    ends = dict.fromkeys((milliseconds(min(measured)), milliseconds(max(measured))))
    return doubt or Judged("pass", wanted, " to ".join(ends), at=placed[0][1].begin)


def _duration(index: Index, position: int, act: Act) -> Interval:
    took, wait = act.end - act.begin, act.wait
    if act.session and act.op in CALLS:
        wait = max((spin.end - spin.sure for spin in index.inside(position, act)[2]), default=wait)
    return Interval(max(took - wait, 0), took)
