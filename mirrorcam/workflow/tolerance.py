"""`mirrorcam design --tolerance`: what a maker can expect, as figures for programs and tables for people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mirrorcam.console.progress import print_metrics, say
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances

if TYPE_CHECKING:
    from mirrorcam.optics.design.assess.monte_carlo import Spread, Study

SHARE_UNIT = "of the mean square departure"


def tolerance_metrics(study: Study) -> dict[str, Metric]:
    """The study, flat: tolerances, figures at them and at each accuracy (a factor on them), the share of each cause."""
    metrics = {f"tolerance.{name}": _of_tolerance(study.tolerances, name) for name in WORKMANSHIP}
    metrics["devices"] = Metric(value=study.devices, unit="drawn")
    for accuracy, spreads in study.spreads.items():
        at = "" if accuracy == 1.0 else f"at_{accuracy:g}x."
        for name, spread in spreads.items():
            metrics |= {f"{at}{name}.{column}": metric for column, metric in _columns(spread).items()}
        metrics[f"{at}hidden_mirrors"] = Metric(value=study.hidden[accuracy], unit="of the devices")
    for cause, shares in study.shares.items():
        for name, share in shares.items():
            metrics[f"share.{cause.replace(' ', '_')}.{name}"] = Metric(value=share, unit=SHARE_UNIT)
    return metrics


def write_tolerance(layout: Layout, tolerances: Tolerances, out: Path) -> Study:
    """Study a layout at the depths of its spec; write tolerance.json and tolerance.png into `out`."""
    from mirrorcam.figures.tolerance_figure import tolerance_figure
    from mirrorcam.optics.base.files import write_metrics
    from mirrorcam.optics.design.assess.monte_carlo import study

    if layout.spec is None:
        raise ValueError("write_tolerance needs a layout with a spec, found none to take depths from")
    found = study(layout, tolerances, sorted(layout.spec.depths_mm))
    tolerance_figure(found, out / "tolerance.png")
    write_metrics(out / "tolerance.json", tolerance_metrics(found))
    return found


def print_tolerance(study: Study) -> None:
    """Three tables: figures at the tolerances, medians over accuracy, and which tolerance does what."""
    say("tolerance", f"{study.devices} devices, standard deviations: {study.tolerances.workmanship}")
    columns: dict[str, dict[str, Metric]] = {}
    for name, spread in study.spreads[1.0].items():
        for column, metric in _columns(spread).items():
            columns.setdefault(column, {})[name] = metric
    columns["median"]["hidden_mirrors"] = Metric(value=study.hidden[1.0], unit="of the devices")
    print_metrics(columns)
    say("tolerance", "medians at so many times these tolerances:")
    medians = {
        f"{accuracy:g}x": {name: Metric(value=s.median, unit=s.unit) for name, s in spreads.items()}
        | {"hidden_mirrors": Metric(value=study.hidden[accuracy], unit="of the devices")}
        for accuracy, spreads in study.spreads.items()
    }
    print_metrics(medians)
    if study.shares:
        say("tolerance", "what the departures from the design hang on (share of their mean square, one at a time):")
        print_metrics(
            {
                cause: {name: Metric(value=round(100.0 * share), unit="%") for name, share in shares.items()}
                for cause, shares in study.shares.items()
            }
        )


def _columns(spread: Spread) -> dict[str, Metric]:
    values = {"design": spread.nominal, "p5": spread.low, "median": spread.median, "p95": spread.high}
    return {column: Metric(value=value, unit=spread.unit) for column, value in values.items()}


def _of_tolerance(tolerances: Tolerances, name: str) -> Metric:
    return Metric(value=getattr(tolerances, name), unit="deg" if name.endswith("_deg") else "mm")
