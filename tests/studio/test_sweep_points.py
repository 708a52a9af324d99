"""Designs of a sweep as points, and which of them no other beats."""

from __future__ import annotations

from mirrorcam.core.values import Metric
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.page import sweep_points


def outcome(scale_mm: float, grid_error: float, share: float, nearest_mm: float, fov_deg: float) -> Outcome:
    values = {
        "grid_error": grid_error,
        "pixel_efficiency_300mm": share,
        "pixel_efficiency_500mm": share,
        "fov_x_deg": fov_deg,
        "fov_y_deg": fov_deg,
        "depth_nearest_mm": nearest_mm,
        "depth_farthest_mm": 1000.0,
    }
    metrics = {name: Metric(value=value, unit="1") for name, value in values.items()}
    return Outcome(spec=DesignSpec(scale_mm=scale_mm), status="solved", metrics=metrics)


def test_each_plot_has_its_front() -> None:
    points = sweep_points(
        [outcome(60, 0.05, 0.6, 200.0, 30.0), outcome(80, 0.06, 0.5, 100.0, 20.0), outcome(90, 0.07, 0.4, 250.0, 10.0)]
    )
    assert [point.best for point in points] == [["field", "grid"], ["field"], []]
    assert points[0].title == "3 x 3, 60 mm, trade-off 0.3"
    assert points[1].depth_per_m == 9.0
    assert points[0].efficiency == 0.6


def test_a_design_without_a_figure_is_not_a_point() -> None:
    bare = Outcome(spec=DesignSpec(), status="solved", metrics={"grid_error": Metric(value=0.1, unit="1")})
    assert sweep_points([bare]) == []
