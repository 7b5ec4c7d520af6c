"""Plain scenario data as typed values: the head of a step, given or expectation says what it is."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher
from typing import Any

from msgspec import structs

from nros_conformance.formats.places import Document, Path_, nearest
from nros_conformance.suite.schema import (
    DOINGS,
    EXPECTATIONS,
    GIVENS,
    STEPS,
    AnyOf,
    Base,
    Cycle,
    Expectation,
    Parallel,
    Repeat,
    Scenario,
    Step,
)


def read_scenario(document: Document) -> Scenario:
    """The whole document as a scenario without parameters. Raises `FormatError`.

    Beside what `Scenario` says, a step may be a bare word (``settle`` for ``{do: settle}``), answers may
    be the plain words ``true`` and ``false``, and inside of ``any_of`` what is left out of ``proves`` is
    what stands outside.
    """
    scenario = document.read(Scenario)
    return structs.replace(
        scenario,
        script=[_step(document, item, ("script", i)) for i, item in enumerate(scenario.script)],
        react=[
            structs.replace(
                reaction,
                script=[_step(document, item, ("react", r, "script", i)) for i, item in enumerate(reaction.script)],
            )
            for r, reaction in enumerate(scenario.react)
        ],
        given=[_given(document, item, ("given", i)) for i, item in enumerate(scenario.given)],
        expect=[_expectation(document, item, ("expect", i)) for i, item in enumerate(scenario.expect)],
    )


def _step(document: Document, raw: Any, path: Path_) -> Step:
    if isinstance(raw, str):
        raw = {"do": raw}
    head = _head(document, raw, path, "a step", (*STEPS, "do"))
    if head == "do":
        doing = raw["do"]
        if not isinstance(doing, str) or doing not in DOINGS:
            raise document.error((*path, "do"), f"do: unknown value {doing!r}", nearest(str(doing), list(DOINGS)))
        return document.read(DOINGS[doing], raw, path)
    step = document.read(STEPS[head], raw, path)
    if isinstance(step, Parallel):
        branches = [
            [_step(document, item, (*path, "parallel", b, i)) for i, item in enumerate(branch)]
            for b, branch in enumerate(step.parallel)
        ]
        return structs.replace(step, parallel=branches)
    if isinstance(step, Cycle):
        script = [_step(document, item, (*path, "script", i)) for i, item in enumerate(step.script)]
        return structs.replace(step, script=script)
    if isinstance(step, Repeat):
        turns = [_step(document, item, (*path, "script", i)) for i, item in enumerate(step.script)]
        return structs.replace(step, script=turns)
    return step


def _given(document: Document, raw: Any, path: Path_) -> Base:
    head = _head(document, raw, path, "a given", GIVENS)
    return document.read(GIVENS[head], _answers(raw, head), path)


def _expectation(document: Document, raw: Any, path: Path_) -> Expectation:
    head = _head(document, raw, path, "an expectation", EXPECTATIONS)
    expectation = document.read(EXPECTATIONS[head], _answers(raw, head), path)
    if isinstance(expectation, AnyOf):
        groups = [
            [
                _expectation(document, _proving(item, expectation.proves), (*path, "any_of", g, i))
                for i, item in enumerate(group)
            ]
            for g, group in enumerate(expectation.any_of)
        ]
        return structs.replace(expectation, any_of=groups)
    return expectation


def _proving(raw: Any, proves: str | list[str]) -> Any:
    return {"proves": proves, **raw} if isinstance(raw, dict) else raw


def _answers(raw: dict[str, Any], head: str) -> dict[str, Any]:
    """YAML's true and false are answers like ``OK``: words."""
    answers = raw.get("is")
    if head in ("returns", "cycles") and isinstance(answers, list):
        return {**raw, "is": [str(word).lower() if isinstance(word, bool) else word for word in answers]}
    return raw


def _head(document: Document, raw: Any, path: Path_, what: str, heads: Iterable[str]) -> str:
    if not isinstance(raw, dict):
        raise document.error(path, f"{raw!r} is not {what}", f"{what} is a mapping with one of {', '.join(heads)}")
    found: list[str] = [key for key in raw if key in heads]
    if len(found) == 1:
        return found[0]
    if found:
        raise document.error((*path, found[1]), f"{what} with several heads: {', '.join(found)}", "write one for each")
    if not raw:
        raise document.error(path, f"{what} that says nothing", f"{what} has one of {', '.join(heads)}")
    # The head is usually written first, but a near miss elsewhere is the better guess.
    word: str = max(raw, key=lambda key: max(_likeness(key, head) for head in heads))
    if not any(_likeness(word, head) >= 0.6 for head in heads):
        word = next(iter(raw))
    raise document.error((*path, word), f"unknown head {word!r} of {what}", nearest(word, list(heads)))


def _likeness(word: str, other: str) -> float:
    return SequenceMatcher(None, other, word).ratio()
