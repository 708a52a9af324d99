"""Fix the pages of the theme for keyboards, screen readers and narrow screens."""

from __future__ import annotations

import html
import re
from pathlib import Path

SIGNATURE = re.compile(r'<dt class="sig .*?</dt>', flags=re.DOTALL)
TABLE = re.compile(r"<table class=\"(.*?)</table>", flags=re.DOTALL)
CELL = re.compile(r"<t[dh]\b[^>]*>(.*?)</t[dh]>", flags=re.DOTALL)
TAG = re.compile(r"<[^>]+>")
MAX_COLUMNS = 3
"""Columns of a table that fits on a phone; the rows of wider ones become lists there (site.css)."""
LINES = {
    "<dl>": '<span class="sig-lines">',
    "</dl>": "</span>",
    "<dd>": '<span class="sig-line">',
    "</dd>": "</span>",
}
"""Parameters on separate lines are not definition lists."""
FIXES = {
    '<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    '<aside class="toc-drawer': '<aside aria-label="On this page" class="toc-drawer',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    '<th class="head"><p></p></th>': "<td></td>",
}
"""Headings get a level, landmarks a name, scrolling elements the keyboard focus, and empty headings are removed."""


def _lines(signature: re.Match[str]) -> str:
    text = signature[0]
    for tag, replacement in LINES.items():
        text = text.replace(tag, replacement)
    return text


def _with_labels(table: re.Match[str]) -> str:
    """A table whose cells carry the heading of their column."""
    head, end_of_head, body = table[1].partition("</thead>")
    labels = [html.escape(html.unescape(TAG.sub("", cell)).strip()) for cell in CELL.findall(head)]
    if len(labels) <= MAX_COLUMNS or not end_of_head:
        return table[0]
    rows = body.split("<tr")
    for number, row in enumerate(rows):
        parts = row.split("<td")
        rows[number] = parts[0] + "".join(
            f'<td data-label="{label}"{part}' for label, part in zip(labels, parts[1:], strict=False)
        )
    return f'<table class="labelled {head}{end_of_head}{"<tr".join(rows)}</table>'


def accessible(page: str) -> str:
    """The fixed HTML of a page."""
    for original, replacement in FIXES.items():
        page = page.replace(original, replacement)
    return TABLE.sub(_with_labels, SIGNATURE.sub(_lines, page))


def fix(folder: Path) -> None:
    """Fix all pages in a folder."""
    for path in folder.rglob("*.html"):
        path.write_text(accessible(path.read_text(encoding="utf-8")), encoding="utf-8")
