"""Texts of people on drawn pages: in glyphs that the font has, and no wider than their place."""

from __future__ import annotations

from collections.abc import Callable, Container

MISSING = "\N{REPLACEMENT CHARACTER}"


def drawable(text: str, glyphs: Container[int]) -> str:
    """Return a text with a mark in place of each character that the font lacks or that is not printable."""
    return "".join(char if char.isprintable() and ord(char) in glyphs else MISSING for char in text)


def fitted(text: str, width: float, width_of: Callable[[str], float]) -> str:
    """Return a text, cut and ended by "..." where it is wider than `width`."""
    kept, end = text, ""
    while kept and width_of(kept + end) > width:
        kept, end = kept[:-1], "..."
    return kept + end
