"""The tolerance study of a layout as files: figures that devices as built can be expected to reach."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.values import Metric
from mirrorcam.designs.tolerance_figure import tolerance_figure
from mirrorcam.optics.design.assess import monte_carlo
from mirrorcam.optics.design.assess.monte_carlo import Spread, Study
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances

SHARE_UNIT = "of the mean square departure"


def tolerance_metrics(study: Study) -> dict[str, Metric]:
    """The study, flat: tolerances, figures at them and at each accuracy (a factor on them), the share of each cause."""
    metrics = {f"tolerance.{name}": _of_tolerance(study.tolerances, name) for name in WORKMANSHIP}
    metrics["devices"] = Metric(value=study.devices, unit="drawn")
    for accuracy, spreads in study.spreads.items():
        at = "" if accuracy == 1.0 else f"at_{accuracy:g}x."
        for name, spread in spreads.items():
            metrics |= {f"{at}{name}.{column}": metric for column, metric in spread_columns(spread).items()}
        metrics[f"{at}hidden_mirrors"] = hidden_mirrors(study, accuracy)
    for cause, shares in study.shares.items():
        for name, share in shares.items():
            metrics[f"share.{cause.replace(' ', '_')}.{name}"] = Metric(value=share, unit=SHARE_UNIT)
    return metrics


def write_tolerance(layout: Layout, tolerances: Tolerances, out: Path) -> Study:
    """Study a layout at the depths of its spec; write tolerance.json and tolerance.png into `out`."""
    if layout.spec is None:
        raise ValueError("write_tolerance needs a layout with a spec, found none to take depths from")
    found = monte_carlo.study(layout, tolerances, sorted(layout.spec.depths_mm))
    write_metrics(out / "tolerance.json", tolerance_metrics(found))
    tolerance_figure(found, out / "tolerance.png")
    return found


def hidden_mirrors(study: Study, accuracy: float) -> Metric:
    """The share of devices in which a mirror hides another, at a factor on the tolerances."""
    return Metric(value=study.hidden[accuracy], unit="of the devices")


def spread_columns(spread: Spread) -> dict[str, Metric]:
    """Design value, quantiles and median of a figure over the devices, by the title of their column."""
    values = {"design": spread.nominal, "p5": spread.low, "median": spread.median, "p95": spread.high}
    return {column: Metric(value=value, unit=spread.unit) for column, value in values.items()}


def _of_tolerance(tolerances: Tolerances, name: str) -> Metric:
    return Metric(value=getattr(tolerances, name), unit="deg" if name.endswith("_deg") else "mm")
