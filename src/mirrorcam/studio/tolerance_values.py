"""What devices as built can be expected to reach, as values; `tolerance_bars` finds them."""

from __future__ import annotations

from mirrorcam.core.values import Value


class ToleranceBar(Value):
    """One figure: of the design, and the range of 90 % of the devices with their median."""

    label: str
    design: float
    low: float
    median: float
    high: float
    text: str


class ToleranceBars(Value):
    """All figures of a study, and what was assumed."""

    assumed: str
    hidden: float
    bars: list[ToleranceBar]
