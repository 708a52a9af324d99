"""Write the figures and tables of the documents from docs/measured.json: `python -m docs.make_measured [--check]`.

`--take FILE...` first puts the records of files, which benchmarks write by `--json FILE`, into docs/measured.json.

In a document a comment stands on the line above a block, which ends with a blank line:

    <!-- table: KEY -->         a Markdown table: the table of the record KEY
    <!-- figures: KEY: a_px 3 b_percent -->     a paragraph or table: each of its numbers, in order

and near the top of a page:

    <!-- given: 300 mm, 18° -->                 numbers with units that are given where no comment is above them

Of the numbers of a paragraph, those that the comment names are figures of the record (`name*100`: times a hundred), and
those that it repeats are given: sizes, limits, parameters, figures of others. A figure is rounded to as many decimals
as the document quotes. Numbers in code, in links' targets, in texts of pictures and within words (C920, H.264) are none
of these. What stands between the marks of docs/gallery.md is written from docs/gallery.json.
"""

from __future__ import annotations

import argparse
import difflib
import re
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchmarks.records import ROOT, Record, Records
from docs import make_gallery
from mirrorcam.optics.base.files import write_text

MEASURED = ROOT / "docs" / "measured.json"
NUMBER = re.compile(
    r"(?<![\w.])(?<![\w)]-)(?:(?<![\w)])-)?"  # Not within a word; a minus is no hyphen or dash.
    r"(?:\d{1,3}(?:,\d{3})+(?!\d)|\d+|(?=\.\d))(?:\.\d+)?(?:e[+-]?\d+)?"
)
SKIPPED = re.compile(
    r"`[^`]*`|!\[[^]]*\]\([^)]*\)|\]\([^)]*\)|<!--.*?-->|https?://\S+|^ *\d+\.(?= )", flags=re.DOTALL | re.MULTILINE
)
GIVEN = re.compile(r"^<!--\s*given:(.*?)-->", flags=re.DOTALL | re.MULTILINE)
COMMENT = re.compile(r"\s*<!--\s*(figures|table)\b:?(.*?)\s*-->\s*", flags=re.DOTALL)
UNIT = re.compile(
    r"\s?(?:px|mm|µm|nm|°|deg|%|s|ms|min|minutes?|seconds?|hours?|h|frames?/s|/s|dB|[kMG]B|MiB|k?g|EUR|N|MPa|cm³|ml)"
    r"(?![\w-])|\s?grey levels"
)
Guard = Literal["all", "units", "tables"]
GUARDED: dict[str, Guard] = {
    "docs/measured.md": "all",
    "docs/idealisations.md": "all",
    "docs/elasticity.md": "all",
    "README.md": "units",
    "docs/cad.md": "units",
    "docs/calibration.md": "units",
    "docs/design.md": "units",
    "docs/leaderboard.md": "tables",
    "docs/live.md": "units",
    "docs/rendering.md": "units",
    "docs/scoring.md": "units",
    "docs/studio.md": "units",
    "docs/suites.md": "tables",
}
"""Pages, and which of their numbers must have a comment: all, those with a unit behind, or those in tables; of other
pages those with a unit behind."""
MADE = {"docs/gallery.md": make_gallery.as_recorded}
"""Pages with a part between marks that another program writes from a record of its own, and how it does."""
MADE_PART = re.compile(f"{re.escape(make_gallery.BEGIN)}.*?{re.escape(make_gallery.END)}", flags=re.DOTALL)


class Unmeasured(ValueError):
    """A document that does not agree with the records; the message has a line for each place."""


@dataclass(frozen=True)
class Block:
    """Lines of a document, `start` to before `stop`, and the comment above them, if there is one."""

    start: int
    stop: int
    kind: str = ""
    body: str = ""


def pages() -> list[Path]:
    """Every document that may quote figures."""
    named = [ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY")]
    found = [page for folder in ("docs", "examples", "ros2") for page in sorted((ROOT / folder).rglob("*.md"))]
    return [page for page in (*named, *found) if page.is_file()]


def blocks(lines: Sequence[str]) -> Iterator[Block]:
    """Paragraphs, lists and tables of a document, without its code and headings."""
    at, kind, body = 0, "", ""
    while at < len(lines):
        line = lines[at].strip()
        stop = at + 1
        if line.startswith("```"):
            stop = next((n + 1 for n in range(at + 1, len(lines)) if lines[n].strip().startswith("```")), len(lines))
        elif _is_comment(lines[at]):
            stop = next((n + 1 for n in range(at, len(lines)) if lines[n].rstrip().endswith("-->")), len(lines))
            found = COMMENT.fullmatch("\n".join(lines[at:stop]))
            kind, body = (found[1], found[2].strip()) if found else ("", "")
            at = stop
            continue
        elif line and not line.startswith("#"):
            stop = next((n for n in range(at, len(lines)) if not lines[n].strip() or _begins(lines[n])), len(lines))
            if kind or not all(each.startswith("    ") for each in lines[at:stop]):
                yield Block(at, stop, kind, body)
        at, kind, body = stop, "", ""


def _begins(line: str) -> bool:
    return line.strip().startswith(("```", "#")) or _is_comment(line)


def _is_comment(line: str) -> bool:
    return line.strip().startswith("<!--") and not line.startswith("    ")  # Indented so far it is code.


def numbers(text: str) -> list[re.Match[str]]:
    """The numbers of a text, but those in code, targets of links, comments and words."""
    return list(NUMBER.finditer(SKIPPED.sub(lambda found: re.sub(r"[^\n]", "_", found[0]), text)))


def quoted(value: float, like: str) -> str:
    """A figure with as many decimals, and in the form, of a number in a document."""
    mantissa, exponent, _ = like.partition("e")
    decimals = len(mantissa.partition(".")[2])
    text = f"{value:{',' if ',' in like else ''}.{decimals}{'e' if exponent else 'f'}}"
    text = re.sub(r"e([+-])0*(\d)", lambda found: f"e{found[1].strip('+')}{found[2]}", text)
    return re.sub(r"^(-?)0\.", r"\1.", text) if like.lstrip("-").startswith(".") else text


def _figures(body: str, records: Records) -> Iterator[str | float]:
    """What a comment says of each number: a figure, or the text of a given one."""
    record: Record | None = None
    for token in body.split():
        if token.endswith(":"):
            if token[:-1] not in records.records:
                raise Unmeasured(f"no record {token[:-1]!r} in {MEASURED.name}")
            record = records.records[token[:-1]]
        elif NUMBER.fullmatch(token):
            yield token
        else:
            name, _, times = token.partition("*")
            if record is None or name not in record.values:
                raise Unmeasured(f"{name!r} is no figure of the record before it")
            yield record.values[name].value * float(times or 1)


def written(text: str, records: Records) -> tuple[str, list[str]]:
    """A document with figures and tables from the records, and what is wrong with it, a line for each place."""
    lines = text.split("\n")
    wrong: list[str] = []
    for block in reversed([block for block in blocks(lines) if block.kind]):
        part = "\n".join(lines[block.start : block.stop])
        try:
            part = _table(part, block.body, records) if block.kind == "table" else _paragraph(part, block.body, records)
        except Unmeasured as error:
            wrong.insert(0, f"{block.start + 1}: {error}")
        lines[block.start : block.stop] = part.split("\n")
    return "\n".join(lines), wrong


def _table(text: str, key: str, records: Records) -> str:
    record = records.records.get(key)
    if record is None or record.table is None:
        raise Unmeasured(f"no table {key!r} in {MEASURED.name}")
    return textwrap.indent(record.table.markdown(), text[: len(text) - len(text.lstrip())])


def _paragraph(text: str, body: str, records: Records) -> str:
    found, said = numbers(text), list(_figures(body, records))
    if len(found) != len(said):
        raise Unmeasured(f"{len(found)} numbers, but the comment above names {len(said)}")
    for number, figure in reversed(list(zip(found, said, strict=True))):
        if isinstance(figure, str) and figure != number[0]:
            raise Unmeasured(f"{number[0]} where the comment above has {figure} as given")
        new = figure if isinstance(figure, str) else quoted(figure, number[0])
        text = text[: number.start()] + new + text[number.end() :]
    return text


def unowned(text: str, where: Guard = "all") -> list[str]:
    """The numbers without a comment above their block, with their lines, and what is given but not among them.

    All of them, or only those with a unit behind ("units"), or only those in tables.
    """
    lines, found, given, seen = text.split("\n"), [], _given(text), set()
    for block in blocks(lines):
        part = "\n".join(lines[block.start : block.stop])
        if block.kind or (where == "tables" and not part.lstrip().startswith("|")):
            continue
        for number in numbers(part):
            unit = UNIT.match(part, number.end())
            quantity = _joined(number[0] + unit[0]) if unit else ""
            seen.add(quantity)
            if quantity not in given and (unit or where != "units"):
                n = block.start + part.count("\n", 0, number.start())
                found.append(f"{n + 1}: {number[0]} without a comment that says what it is: {lines[n].strip()[:80]}")
    return found + [
        f"{n}: {quantity} is given, but stands nowhere" for quantity, n in given.items() if quantity not in seen
    ]


def _given(text: str) -> dict[str, int]:
    """The quantities that a page says are given, without spaces, and the lines of the comments."""
    return {
        _joined(quantity): 1 + text.count("\n", 0, comment.start())
        for comment in GIVEN.finditer(text)
        for quantity in re.split(r",\s", comment[1])
    }


def _joined(quantity: str) -> str:
    return re.sub(r"\s", "", quantity)


def unused(texts: Sequence[str], records: Records) -> list[str]:
    """Keys of records that no document quotes."""
    bodies = [block.body for text in texts for block in blocks(text.split("\n")) if block.kind]
    quoted_keys = {token.rstrip(":") for body in bodies for token in body.split()}
    return sorted(records.records.keys() - quoted_keys)


def amiss(records: Records) -> list[str]:
    """A line for each place where a document says something else than the records, or a number has no comment."""
    found, texts = [], []
    for page in pages():
        name, text = page.relative_to(ROOT).as_posix(), page.read_text(encoding="utf-8")
        new, wrong = _rewritten(name, text, records)
        by_hand = MADE_PART.sub(lambda part: "\n" * part[0].count("\n"), text) if name in MADE else text
        wrong += unowned(by_hand, GUARDED.get(name, "units"))
        if new != text:
            differ = difflib.unified_diff(
                text.split("\n"), new.split("\n"), "as it is", "as measured", lineterm="", n=0
            )
            wrong += [f" differs from {MEASURED.name}:", *differ]
        found += [f"{name}:{line}" if line[0] not in "+-@" else f"  {line}" for line in wrong]
        texts.append(text)
    return found + [f"{MEASURED.name}: no document quotes {key!r}" for key in unused(texts, records)]


def write(records: Records) -> None:
    """Write figures and tables of every document from the records."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        new, _ = _rewritten(page.relative_to(ROOT).as_posix(), text, records)
        if new != text:
            write_text(page, new)


def _rewritten(name: str, text: str, records: Records) -> tuple[str, list[str]]:
    """A page by its name, with what the records and other programs' records have for it, and what is wrong with it."""
    new, wrong = written(text, records)
    return MADE[name](new) if name in MADE else new, wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Write every document, or with `--check` nothing, and say what is amiss."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--take", type=Path, nargs="+", default=[], metavar="FILE", help="records to put in first")
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 where something would change")
    options = parser.parse_args(arguments)
    records = Records.load(MEASURED)
    for path in options.take:
        records = records.with_records(Records.load(path).records)
    if not options.check:
        if options.take:
            records.save(MEASURED)
        write(records)
    found = amiss(records)
    print("\n".join(found), file=sys.stderr, end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
