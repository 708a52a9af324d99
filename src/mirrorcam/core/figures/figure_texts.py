"""Format metrics for people: values, units, limits and names, alike on pages and in the terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby

from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.values import Metric

TIMES = "\N{MULTIPLICATION SIGN}"
SIGMA = "\N{GREEK SMALL LETTER SIGMA}"
NONE = "none"
MAX_FURTHER_DIGITS = 9
ROUNDING = 1e-9
SMALLEST_DECIMAL = 1e-5
"""Values below it are written with an exponent."""
TINY, MAX_RATIO = 1e-3, 100.0
"""Values are written with equal decimals if the largest is at least `TINY` and their ratio at most `MAX_RATIO`."""
UNIT_ENDINGS = ("mm", "mm2", "mm3", "cm3", "um", "px", "deg", "g")
SYMBOLS = {"1": "", "deg": "°"}
"""Units that follow their value without a space."""
SIGNS = {
    "1": "",
    "um": "\N{MICRO SIGN}m",
    **{f"{length}2": f"{length}\N{SUPERSCRIPT TWO}" for length in ("mm", "cm")},
    **{f"{length}3": f"{length}\N{SUPERSCRIPT THREE}" for length in ("mm", "cm")},
}
"""Printed forms of the units in files."""
WORDS = {
    **{"fov": "field of view", "iou": "", "rms": "RMS", "p95": "95 % quantile"},
    **{"bom": "parts list", "stl": "STL", "step": "STEP", "3mf": "3MF", "dxf": "DXF"},
}
_FILE_FIRST = re.compile(r"\S*[._/\\]\w|(?:[^\s:]+ ){1,3}[^\s:]*\.\w{2,4}(?: frames? \d+)?:")
_FRAME = re.compile(r"(.*) frame (\d+)")
NUMBER_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def count_text(count: int, noun: str) -> str:
    """Return a count with its noun: "1 frame", "2 frames"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def grouped_names(names: Iterable[str]) -> str:
    """List names of pictures in one line, with the frames of a video grouped: "a.jpg, clip.mp4 frames 7, 9"."""
    parts = []
    for video, group in groupby((_FRAME.fullmatch(name) or name for name in names), key=_video):
        members = list(group)
        if video is None:
            parts += [str(member) for member in members]
        else:
            numbers = [member[2] for member in members if isinstance(member, re.Match)]
            parts.append(f"{video} frame{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}")
    return ", ".join(parts)


def _video(name: re.Match[str] | str) -> str | None:
    return None if isinstance(name, str) else name[1]


def number_word(count: int) -> str:
    """Return a small number as a word, a larger one in digits."""
    return NUMBER_WORDS[count] if count < len(NUMBER_WORDS) else str(count)


def figure_text(value: float, digits: int = 4) -> str:
    """Format a value with a few significant digits: two if it is below 1e-4, all if above 1000; NaN is "none"."""
    if math.isnan(value):
        return NONE
    if abs(value) >= 1000:
        return f"{value:.0f}"
    if value == 0 or abs(value) >= 1e-4:
        return f"{value:.{digits}g}"
    text = f"{value:.1e}"
    return f"{float(text):.{1 - int(text[-3:])}f}" if abs(value) >= SMALLEST_DECIMAL else text.replace("e-0", "e-")


def equal_decimals(values: Sequence[float], digits: int = 4) -> list[str]:
    """Format values of one figure with equal decimals: as many as the largest needs for its significant digits."""
    sizes = [abs(value) for value in values if value != 0 and not math.isnan(value)]
    # Tiny, infinite or very different values are formatted separately.
    if not sizes or max(sizes) < TINY or not max(sizes) <= MAX_RATIO * min(sizes) < math.inf:
        return [figure_text(value, digits) for value in values]
    decimals = max(0, digits - 1 - math.floor(math.log10(float(f"{max(sizes):.{digits - 1}e}"))))
    texts = [f"{value:.{decimals}f}" for value in values if not math.isnan(value)]
    while decimals > 0 and all(text.endswith("0") for text in texts):
        texts, decimals = [text[:-1].rstrip(".") for text in texts], decimals - 1
    remaining = iter(texts)
    return [NONE if math.isnan(value) else next(remaining) for value in values]


def sigma_text(sigma: float) -> str:
    """Format a standard deviation with two significant digits, also 0.0020; a rounding error is 0."""
    if abs(sigma) < ROUNDING:
        return "0"
    decimals = sigma_decimals(sigma)
    return figure_text(sigma, 2) if decimals is None else f"{sigma:.{decimals}f}"


def sigma_decimals(sigma: float) -> int | None:
    """Return the decimals of a standard deviation with two significant digits; None for 0, NaN and tiny values."""
    if not 1e-4 <= sigma < float("inf"):
        return None
    return max(0, 1 - math.floor(math.log10(float(f"{sigma:.1e}"))))


def unit_text(unit: str) -> str:
    """Return the printed form of a unit: mm² for mm2."""
    return SIGNS.get(unit, unit)


def value_text(metric: Metric, value: float | None = None, digits: int = 4) -> str:
    """Format a metric's value, or another value in its unit, with the unit; a fraction as a percentage.

    A value just past its limit gets enough digits to differ from it. For an unknown value, return the reason.
    """
    if value is None and not metric.known:
        return f"{NONE}: {metric.reason}"
    number = metric.value if value is None else value
    extra_digits = digits_past_limit(metric, digits) - digits
    if metric.unit.startswith("of the "):
        return f"{number:.{1 + extra_digits}%}"
    return _with_unit(figure_text(number, digits + extra_digits), metric.unit)


def digits_past_limit(metric: Metric, digits: int) -> int:
    """Return enough digits to distinguish a metric from a limit that it exceeds; otherwise `digits`."""
    if metric.limit is None or metric.passed:
        return digits
    is_fraction = metric.unit.startswith("of the ")
    for extra_digits in range(MAX_FURTHER_DIGITS):
        texts = [
            f"{value:.{1 + extra_digits}%}" if is_fraction else figure_text(value, digits + extra_digits)
            for value in (metric.value, metric.limit)
        ]
        if texts[0] != texts[1]:
            return digits + extra_digits
    return digits


def values_text(metrics: Sequence[Metric]) -> list[str]:
    """Format values of one figure as `value_text` does, with equal decimals."""
    units = {metric.unit for metric in metrics}
    if len(units) != 1 or min(units).startswith("of the ") or not all(metric.known for metric in metrics):
        return [value_text(metric) for metric in metrics]
    return [_with_unit(text, min(units)) for text in equal_decimals([metric.value for metric in metrics])]


def _with_unit(text: str, unit: str) -> str:
    return f"{text}{SYMBOLS.get(unit, f' {unit_text(unit)}')}".rstrip()


def limit_sign(metric: Metric) -> str:
    """Return the sign between a metric and its limit if it passes."""
    return "\N{LESS-THAN OR EQUAL TO}" if metric.lower_is_better else "\N{GREATER-THAN OR EQUAL TO}"


def limit_text(metric: Metric, *, with_unit: bool = True) -> str:
    """Format the limit of a metric with its sign; empty without a limit."""
    if metric.limit is None:
        return ""
    number = value_text(metric, metric.limit) if with_unit else figure_text(metric.limit, digits_past_limit(metric, 4))
    return f"{limit_sign(metric)} {number}"


def label_text(name: str, labels: Mapping[str, str] = LABELS) -> str:
    """Return the label of a metric, without its unit.

    It is taken from `labels`, or else from the words of the name. The object comes first ("mount: "), the depth last.
    """
    if name in labels:
        return labels[name]
    *objects, figure = re.split(r"\.(?=[a-z]|3mf)", name)
    at_depth = re.search(r"_([0-9][0-9.e+-]*)mm$", figure)
    stem = figure[: at_depth.start()] if at_depth else figure
    label = labels.get(stem) or _words(stem)
    return ": ".join([*map(_words, objects), f"{label} at {at_depth[1]} mm" if at_depth else label])


def _words(name: str) -> str:
    """Return the words of a name, without the unit at its end."""
    words = name.split("_")
    if len(words) > 1 and words[-1] in UNIT_ENDINGS:
        words = words[:-1]
    return " ".join(word for word in (WORDS.get(word, word) for word in words) if word)


def sentence_case(text: str) -> str:
    """Capitalise the first letter of a text, unless it begins with the name of a file."""
    return text if _FILE_FIRST.match(text) else text[:1].upper() + text[1:]


def fraction_of_limit(metric: Metric) -> float:
    """Return the used fraction of a metric's limit: at most 1 if it passes, infinite if the metric is unknown."""
    if metric.limit is None:
        raise ValueError("metric without a limit")
    if not metric.known:
        return math.inf
    used, allowed = (metric.value, metric.limit) if metric.lower_is_better else (metric.limit, metric.value)
    return abs(used / allowed) if allowed else (0.0 if used == allowed else float("inf"))
