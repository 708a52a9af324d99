"""SVG drawings in a page, coloured by its style sheet, and so legible in dark mode, too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from markupsafe import Markup

from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class Scale:
    """A linear map of values from low to high to a drawing's coordinates from start to end."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self, count: int = 5) -> list[float]:
        """Return about `count` ticks within the scale, spaced by 1, 2 or 5 times a power of ten."""
        rough = (self.high - self.low) / count
        power = 10.0 ** np.floor(np.log10(rough))
        step = power * min((1.0, 2.0, 5.0, 10.0), key=lambda factor: abs(factor * power - rough))
        first, last = np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9)
        return [float(step * number) for number in np.arange(first, last + 1)]


def coordinate(value: float) -> str:
    """Format a coordinate with two decimals, without trailing zeros."""
    return f"{value:.2f}".rstrip("0").rstrip(".") or "0"


def points(pairs: Iterable[Sequence[float] | FloatArray]) -> str:
    """Return the `points` attribute of a polygon or polyline."""
    return " ".join(f"{coordinate(float(x))},{coordinate(float(y))}" for x, y in pairs)


def drawing(width: float, height: float, body: str, label: str) -> Markup:
    """Return a drawing of at most its width, which shrinks with the page; `label` describes it."""
    size = f'viewBox="0 0 {coordinate(width)} {coordinate(height)}" style="max-width:{coordinate(width)}px"'
    return Markup(f'<svg {size} role="img" aria-label="{escape(label)}">{body}</svg>')


def text(x: float, y: float, words: str, *, anchor: str = "middle", style: str = "", vertical: bool = False) -> str:
    """Return a text at a position; if `vertical`, it reads upwards."""
    position = f'x="{coordinate(x)}" y="{coordinate(y)}"'
    rotation = f' transform="rotate(-90 {coordinate(x)} {coordinate(y)})"' if vertical else ""
    style_class = f' class="{style}"' if style else ""
    return f'<text {position} text-anchor="{anchor}"{style_class}{rotation}>{escape(words)}</text>'


def line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    """Return a straight line with a class of the style sheet."""
    ends = zip(("x1", "y1", "x2", "y2"), (x1, y1, x2, y2), strict=True)
    position = " ".join(f'{name}="{coordinate(value)}"' for name, value in ends)
    return f'<line {position} class="{style}"/>'


def tick_text(value: float) -> str:
    """Format the value of a tick without rounding errors."""
    return f"{round(value, 10) + 0.0:g}".replace("-", "\N{MINUS SIGN}")


def axes(x: Scale, y: Scale, x_label: str, y_label: str, *, x_ticks: int = 6, y_ticks: int = 5) -> str:
    """Return grid lines, ticks and labels of both axes; the ends of the scales are the corners of the plot."""
    parts = []
    for value in y.ticks(y_ticks):
        parts.append(line(x.start, y(value), x.end, y(value), "grid"))
        parts.append(text(x.start - 8, y(value) + 4, tick_text(value), anchor="end", style="tick"))
    for value in x.ticks(x_ticks):
        parts.append(line(x(value), y.start, x(value), y.start + 5, "axis"))
        parts.append(text(x(value), y.start + 20, tick_text(value), style="tick"))
    parts.append(line(x.start, y.start, x.end, y.start, "axis"))
    parts.append(text((x.start + x.end) / 2, y.start + 40, x_label, style="name"))
    parts.append(text(x.start - 44, (y.start + y.end) / 2, y_label, style="name", vertical=True))
    return "".join(parts)
