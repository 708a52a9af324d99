"""What the theme leaves to be mended, so that pages can be read by keyboard and screen reader."""

from __future__ import annotations

import re
from pathlib import Path

SIGNATURE = re.compile(r'<dt class="sig .*?</dt>', flags=re.DOTALL)
LINES = {
    "<dl>": '<span class="sig-lines">',
    "</dl>": "</span>",
    "<dd>": '<span class="sig-line">',
    "</dd>": "</span>",
}
"""Parameters on lines of their own are no definitions."""
MENDED = {
    '<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    '<aside class="toc-drawer': '<aside aria-label="On this page" class="toc-drawer',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    '<th class="head"><p></p></th>': "<td></td>",
}
"""Headings have a level, landmarks a name, what scrolls can be reached by the keyboard, and no heading is empty."""


def _lines(signature: re.Match[str]) -> str:
    text = signature[0]
    for tag, instead in LINES.items():
        text = text.replace(tag, instead)
    return text


def accessible(html: str) -> str:
    """The HTML of a page, mended."""
    for found, instead in MENDED.items():
        html = html.replace(found, instead)
    return SIGNATURE.sub(_lines, html)


def mend(folder: Path) -> None:
    """Mend all pages in a folder."""
    for path in folder.rglob("*.html"):
        path.write_text(accessible(path.read_text(encoding="utf-8")), encoding="utf-8")
