"""The designs of a sweep as points of two plots: what is gained for what is lost."""

from __future__ import annotations

from collections.abc import Sequence

from mirrorcam.core.values import Value
from mirrorcam.optics.design.spec_grid import Outcome, pareto_front, summary_figures
from mirrorcam.optics.geometry.design_spec import DesignSpec


class SweepPoint(Value):
    """A solved design of a sweep: its request and the figures that it is compared by.

    `best` names the plots, "field" and "grid", in which no other design is better in both figures.
    """

    title: str
    spec: DesignSpec
    field_deg: float
    depth_per_m: float
    grid_error: float
    efficiency: float
    best: list[str]


def sweep_points(outcomes: Sequence[Outcome]) -> list[SweepPoint]:
    """The points of solved designs, in their order; those without a figure, such as of a single depth, are left out."""
    found = []
    for outcome in outcomes:
        figures = summary_figures(outcome)
        across, deep, share = (
            figures[name] for name in ("fov_diagonal_deg", "depth_of_field_per_m", "pixel_efficiency_mean")
        )
        error = outcome.metrics.get("grid_error")
        if across is None or deep is None or share is None or error is None or not error.known:
            continue
        spec = outcome.spec
        found.append(
            SweepPoint(
                title=f"{spec.arrangement.text}, {spec.scale_mm:g} mm, trade-off {spec.tradeoff:g}",
                spec=spec,
                field_deg=across,
                depth_per_m=deep,
                grid_error=error.value,
                efficiency=share,
                best=[],
            )
        )
    fronts = {
        "field": pareto_front([(point.field_deg, point.depth_per_m) for point in found]),
        "grid": pareto_front([(-point.grid_error, point.efficiency) for point in found]),
    }
    return [
        point.replaced(best=[name for name, front in fronts.items() if number in front])
        for number, point in enumerate(found)
    ]
