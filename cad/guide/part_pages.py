"""The guide's section for each purchased thing: what it is, where it goes, where to find it, and what may replace it.

Headings are the titles of the bill of materials, and their anchors lead to them from the steps and from the parts list.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from mirrorcam.cad.assembly.bill import Bom, BoughtLine, MirrorLine
from mirrorcam.core.names import anchor_of, markdown_text

_STEP = re.compile(r"^## (Step (\d+): .*)$", re.MULTILINE)


@dataclass(frozen=True)
class PartPage:
    """The section of a purchased thing: its title, and rows of a label and a text in Markdown."""

    title: str
    rows: tuple[tuple[str, str], ...]


def part_pages(bill: Bom, step_of: Mapping[str, int]) -> tuple[PartPage, ...]:
    """The sections of all purchased things but tools; `step_of` has the numbers of the guide's steps by their names."""
    lines: list[BoughtLine | MirrorLine] = [line for line in bill.bought if not line.is_tool]
    lines += bill.mirrors
    return tuple(PartPage(_title(line), tuple(_rows(line, bill, step_of))) for line in lines)


def page_link(bill: Bom, words: str) -> str:
    """The link to the section of the first purchased thing whose title contains the words; "" if there is none."""
    titles = [line.title for line in bill.bought if not line.is_tool and words in line.title]
    return f"#{anchor_of(titles[0])}" if titles else ""


def with_step_links(guide: str) -> str:
    """A guide in Markdown whose links to steps, such as (#step-6), lead to the anchors of their headings."""
    anchors = {number: anchor_of(heading) for heading, number in _STEP.findall(guide)}
    return re.sub(r"\(#step-(\d+)\)", lambda match: f"(#{anchors[match[1]]})", guide)


def _title(line: BoughtLine | MirrorLine) -> str:
    return line.title if isinstance(line, BoughtLine) else line.sheet


def _rows(line: BoughtLine | MirrorLine, bill: Bom, step_of: Mapping[str, int]) -> list[tuple[str, str]]:
    former = f" (shops also say {line.former})" if line.former else ""
    kind = "; ".join(text for text in (f"{line.standard}{former}", line.material) if text)
    steps = ", ".join(f"[step {step_of[name]}](#step-{step_of[name]})" for name in line.steps)
    if isinstance(line, BoughtLine):
        amount, use = "" if line.count is None else f"{line.count}", line.note
    else:
        amount, use = line.to_buy, f"{line.count} mirrors, {line.area_cm2:.1f} cm² in all"
    rows = [
        ("What it is", markdown_text(kind)),
        ("How many", markdown_text(amount)),
        ("Used for", markdown_text(use)),
        ("Used in", steps),
        ("Search for", markdown_text(line.search)),
        ("Sold by", markdown_text(line.supplier)),
        ("Price", markdown_text(_price(line, bill))),
        ("Instead", " ".join(line.instead)),
    ]
    return [(label, text) for label, text in rows if text]


def _price(line: BoughtLine | MirrorLine, bill: Bom) -> str:
    """The price that the bill assumes, with its month."""
    basis = f"{bill.currency}, estimated, as of {bill.prices_date}"
    if isinstance(line, MirrorLine):
        return f"{line.price:.2f} {basis}"
    if line.each is None:
        return "unknown"
    if line.price is None:
        return f"{line.each:.2f} {bill.currency} per kg, in the price of the printed parts, as of {bill.prices_date}"
    if line.count is None:
        return f"{line.each:.2f} {basis}, for a pack"
    return f"{line.each:.2f} {basis}" + (f"; {line.price:.2f} {bill.currency} for all" if line.count > 1 else "")
