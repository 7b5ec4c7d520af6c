"""Who waits for whom in a script: a step that in the end waits for itself can never begin."""

from __future__ import annotations

from collections.abc import Sequence

from nros_conformance.formats.places import Document, Path_
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.schema import Create, Cycle, Parallel, Repeat, Repeated, Scenario, Step
from nros_conformance.suite.walk import base_name, steps

_Node = tuple[Path_, str]
"""The ``begin`` or ``end`` of the step at a path; the path ``()`` is the whole script."""


def check_anchors(document: Document, scenario: Scenario) -> None:
    """Raise `FormatError` when steps wait for each other in a circle; the labels must be known ones."""
    waits = _Waits(scenario)
    waits.sequence(scenario.script, ("script",), ((), "begin"), ((), "end"))
    circle = _circle(waits.edges)
    if circle is None:
        return
    names: list[str] = []
    for path, _ in circle:
        name = waits.name(document, path)
        if not names or names[-1] != name:
            names.append(name)
    if len(names) > 1 and names[0] == names[-1]:
        names.pop()
    # The circle begins with a step that says ``at``: that one can be mended.
    moments = {waits.name(document, path): path for path, step in steps(scenario) if step.at is not None}
    first = next(index for index, name in enumerate(names) if name in moments)
    names = names[first:] + names[:first]
    raise document.error(
        (*moments[names[0]], "at"),
        f"at: the step waits for itself: {' -> '.join([*names, names[0]])}",
        "begin it at an earlier moment",
    )


class _Waits:
    """``edges[node]``: what has to happen before it."""

    def __init__(self, scenario: Scenario) -> None:
        self.edges: dict[_Node, list[_Node]] = {}
        self._steps = dict(steps(scenario))
        self._labels = {step.as_: path for path, step in self._steps.items() if step.as_ is not None}
        self._creating = {
            base_name(step.entity): path for path, step in self._steps.items() if isinstance(step, Create)
        }

    def sequence(self, script: Sequence[Step], path: Path_, before: _Node, after: _Node) -> None:
        """Steps one after the other: the first waits for ``before``, ``after`` waits for the last."""
        for index, step in enumerate(script):
            here = (*path, index)
            begin, end = (here, "begin"), (here, "end")
            self.edges[begin] = [before]
            if step.at is not None:
                self.edges[begin] += self._anchor(step.at)
            self.edges.setdefault(end, []).append(begin)
            if isinstance(step, Parallel):
                for number, branch in enumerate(step.parallel):
                    self.sequence(branch, (*here, "parallel", number), begin, end)
            if isinstance(step, Cycle | Repeat):
                self.sequence(step.script, (*here, "script"), begin, end)
            before = end
        self.edges.setdefault(after, []).append(before)

    def _anchor(self, moment: Moment) -> list[_Node]:
        if moment.label == "end":
            return [((), "end")]
        path = self._labels.get(moment.label)
        if path is None and moment.edge == "created":
            path = self._creating.get(base_name(moment.label))
        if path is None:
            return []
        step = self._steps[path]
        last = step.times - 1 if isinstance(step, Repeated) else 0
        whole = moment.index in (None, -1, last) and moment.edge != "begin"
        return [(path, "end" if whole else "begin")]

    def name(self, document: Document, path: Path_) -> str:
        """A step as an author knows it."""
        if not path:
            return "end"
        label = self._steps[path].as_
        line = document.line(path)
        return label or (f"the step in line {line}" if line else f"step {path[-1]}")


def _circle(edges: dict[_Node, list[_Node]]) -> list[_Node] | None:
    """A circle of nodes, each waiting for the next; None when there is none."""
    done: set[_Node] = set()
    for start in edges:
        trail: list[_Node] = []
        pending = [(start, iter(edges[start]))] if start not in done else []
        trail += [start] if pending else []
        while pending:
            node, before = pending[-1]
            following = next((one for one in before if one not in done), None)
            if following is None:
                done.add(node)
                pending.pop()
                trail.pop()
            elif following in trail:
                return trail[trail.index(following) :]
            else:
                trail.append(following)
                pending.append((following, iter(edges.get(following, ()))))
    return None
