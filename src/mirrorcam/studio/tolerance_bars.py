"""What devices as built can be expected to reach, as bars: the figures of many devices drawn at random."""

from __future__ import annotations

from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.figures.figure_texts import label_text, sentence_case, value_text
from mirrorcam.core.values import Metric
from mirrorcam.optics.design.assess.monte_carlo import study
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.studio.tolerance_values import ToleranceBar, ToleranceBars


def tolerance_bars(layout: Layout) -> ToleranceBars:
    """The figures of devices built by hand, at the depths of the layout's spec. Raises InputError as `study`."""
    if layout.spec is None:
        raise ValueError("a layout without a spec, expected one that was designed")
    tolerances = Tolerances.hobby()
    found = study(layout, tolerances, sorted(layout.spec.depths_mm))
    bars = []
    for name, spread in found.spreads[1.0].items():
        ends = [value_text(Metric(value=value, unit=spread.unit)) for value in (spread.low, spread.high)]
        bars.append(
            ToleranceBar(
                label=sentence_case(label_text(name, LABELS)),
                design=spread.nominal,
                low=spread.low,
                median=spread.median,
                high=spread.high,
                text=f"{ends[0]} to {ends[1]}",
            )
        )
    assumed = f"{found.devices} devices, standard deviations of {tolerances.workmanship}; 90 % of them lie in the bar"
    return ToleranceBars(assumed=assumed, hidden=found.hidden[1.0], bars=bars)
