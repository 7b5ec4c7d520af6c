"""A timeline as SVG: time runs downwards, a column for everybody who acts, what went wrong in red.

One row has one height however much time passes between two rows: the few milliseconds that matter would
vanish on a linear axis. The time stands beside each row.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

from nros_conformance.report.timeline import Row

ROW, COLUMN, TIME, MARGIN, LETTER = 20, 110, 80, 16, 6.7
"""Pixels: height of a row, width of a column and of the times, margin, width of a letter."""

_FORBIDDEN = re.compile("[^\\t\\n\\r\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")
_STYLE = (
    "text{font:11px ui-monospace,monospace;fill:#222}.head{font-weight:bold}.time{fill:#666;text-anchor:end}"
    ".lane{stroke:#ccc}.wrong{fill:#b00020}circle{fill:#3465a4}"
    "@media(prefers-color-scheme:dark){text{fill:#ddd}.time{fill:#999}.lane{stroke:#555}.wrong{fill:#ff6b81}}"
)


def svg(rows: Sequence[Row], origin: int, title: str) -> str:
    """The whole file. ``origin``: the time that is shown as 0, ns."""
    lanes = list(dict.fromkeys(row.who for row in rows))
    words = max((len(_words(row)) for row in rows), default=0)
    text_x = MARGIN + TIME + COLUMN * len(lanes)
    top = MARGIN + 3 * ROW
    width, height = text_x + words * LETTER + MARGIN, top + ROW * len(rows) + MARGIN
    root = ElementTree.Element(
        "svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {width:.0f} {height:.0f}",
        width=f"{width:.0f}", height=f"{height:.0f}",
    )  # fmt: skip
    ElementTree.SubElement(root, "title").text = _clean(title)
    ElementTree.SubElement(root, "style").text = _STYLE
    _text(root, MARGIN, MARGIN + ROW / 2, title, "head")
    _text(root, MARGIN + TIME - 12, top - ROW, "ms", "time")
    for number, lane in enumerate(lanes):
        x = MARGIN + TIME + COLUMN * number
        _text(root, x, top - ROW, lane, "head")
        _element(root, "line", "lane", x1=x + 6, y1=top - ROW / 2, x2=x + 6, y2=height - MARGIN)
    for number, row in enumerate(rows):
        y = top + ROW * number
        wrong = "wrong" if row.remark else ""
        _text(root, MARGIN + TIME - 12, y + 4, f"{(row.t - origin) / 1e6:.1f}", f"time {wrong}".strip())
        _element(root, "circle", wrong, cx=MARGIN + TIME + COLUMN * lanes.index(row.who) + 6, cy=y, r=4)
        _text(root, text_x, y + 4, _words(row), wrong)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _words(row: Row) -> str:
    return f"{row.what}  {row.remark}".rstrip()


def _text(root: ElementTree.Element, x: float, y: float, text: str, class_: str) -> None:
    _element(root, "text", class_, x=x, y=y).text = _clean(text)


def _element(root: ElementTree.Element, tag: str, class_: str, **numbers: float) -> ElementTree.Element:
    attributes = {name: f"{value:g}" for name, value in numbers.items()} | ({"class": class_} if class_ else {})
    return ElementTree.SubElement(root, tag, attributes)


def _clean(text: str) -> str:
    """Without the characters that XML 1.0 cannot hold."""
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
