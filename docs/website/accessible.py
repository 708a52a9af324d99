"""Fix the accessibility of the theme for keyboards and screen readers."""

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


def accessible(html: str) -> str:
    """The fixed HTML of a page."""
    for original, replacement in FIXES.items():
        html = html.replace(original, replacement)
    return SIGNATURE.sub(_lines, html)


def fix(folder: Path) -> None:
    """Fix all pages in a folder."""
    for path in folder.rglob("*.html"):
        path.write_text(accessible(path.read_text(encoding="utf-8")), encoding="utf-8")
