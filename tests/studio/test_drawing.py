"""What is drawn of a design is what its layout says."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon, intersection_all

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import common_region, fields_of_view
from mirrorcam.studio.drawing import design_drawing, tolerance_bars

SPEC = DesignSpec()


def test_rays_lead_to_the_fields_that_views_have_at_any_depth(default_layout: Layout) -> None:
    rays = design_drawing(default_layout, SPEC, "exact").rays
    points, directions = np.array(rays.points_mm), np.array(rays.directions)
    views = fields_of_view(default_layout, default_layout.camera.pupil)
    for depth_mm in (150.0, 400.0, 1000.0):
        corners = (points + (depth_mm - points[:, 2:]) * directions)[:, :2]
        region, footprints = views.common_region(depth_mm)
        drawn = [Polygon(corners[np.array(rays.mirror) == k]) for k in range(9)]
        for mine, theirs in zip(drawn, footprints, strict=True):
            assert mine.symmetric_difference(theirs).area < 1e-3 * theirs.area
        assert intersection_all(drawn).area == pytest.approx(region.area, rel=2e-3)


def test_outlines_and_the_common_field_lie_where_the_layout_has_them(default_layout: Layout) -> None:
    drawing = design_drawing(default_layout, SPEC, "exact")
    for k, mirror in enumerate(drawing.mirrors):
        outline = Polygon(default_layout.outline_px(k))
        assert Polygon(mirror.outline_px).symmetric_difference(outline).area < 1e-3 * outline.area
        assert Polygon(mirror.usable_px).within(outline.buffer(0.2))
        for outlines in drawing.common_px:
            assert Polygon(outlines[k]).within(Polygon(mirror.usable_px).buffer(0.5))
    assert common_region(default_layout, 300.0)[0].area > 0


def test_chief_rays_run_from_the_pupil_over_their_mirror_to_the_scene(default_layout: Layout) -> None:
    for mirror in design_drawing(default_layout, SPEC, "exact").mirrors:
        start, met, end = np.array(mirror.chief_mm)
        face = np.array(mirror.solid_mm)[:4]
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        assert np.abs((met - face[0]) @ normal / np.linalg.norm(normal)) < 0.05
        np.testing.assert_array_equal(start, 0.0)
        assert end[2] > met[2]


def test_curves_pass_through_the_figures_at_the_working_depths(default_layout: Layout) -> None:
    curves = design_drawing(default_layout, SPEC, "exact").curves
    figures = evaluate(default_layout, (300.0, 500.0))
    for depth_mm in (300, 500):
        for values, name in (
            (curves.usable, f"usable_efficiency_{depth_mm}mm"),
            (curves.resolution_mm, f"depth_resolution_{depth_mm}mm"),
            (curves.sigma_mm, f"depth_sigma_{depth_mm}mm"),
        ):
            there = np.interp(depth_mm, curves.depths_mm, [value or 0.0 for value in values])
            assert there == pytest.approx(figures[name].value, rel=0.03), name


def test_a_figure_that_is_none_is_drawn_with_its_reason(default_layout: Layout) -> None:
    none = Metric(value=float("nan"), unit="mm", reason="too blurred")
    figures = evaluate(default_layout, (300.0, 500.0)) | {"depth_sigma_300mm": none}
    drawing = design_drawing(default_layout.replaced(metrics=figures), SPEC, "exact")
    drawn = {
        figure["name"]: figure for group in drawing.model_dump(mode="json")["figures"].values() for figure in group
    }
    assert {name: drawn["depth_sigma_300mm"][name] for name in ("text", "value", "reason")} == {
        **{"text": "none", "value": None, "reason": "too blurred"}
    }
    assert drawn["depth_sigma_500mm"]["reason"] == ""


def test_a_preview_is_drawn_without_checks_and_coarser(default_layout: Layout) -> None:
    bare = default_layout.replaced(metrics={}, verdict={})
    exact, preview = (design_drawing(bare, SPEC, kind) for kind in ("exact", "preview"))
    assert len(exact.verdict) == 14
    assert preview.verdict == []
    assert len(preview.curves.depths_mm) < len(exact.curves.depths_mm)
    assert preview.figures.keys() == exact.figures.keys()
    for group, figures in exact.figures.items():
        for figure, rough in zip(figures, preview.figures[group], strict=True):
            if figure.name.startswith("depth_sigma"):
                assert rough.value == pytest.approx(figure.value, rel=0.02)
            else:
                assert rough == figure


def test_a_depth_before_the_mirrors_is_refused(fold_90_layout: Layout) -> None:
    with pytest.raises(InputError, match="nearer than the mirrors"):
        design_drawing(fold_90_layout.replaced(metrics={}), DesignSpec(depths_mm=(1.0,)), "preview")


def test_the_body_of_a_camera_is_drawn_only_where_it_is_known(default_layout: Layout) -> None:
    assert len(design_drawing(default_layout, SPEC, "preview").body_mm) == 8
    bare = default_layout.replaced(camera=default_layout.camera.replaced(body_mm=None))
    assert design_drawing(bare, SPEC, "preview").body_mm == []


@pytest.mark.slow
def test_bars_lie_around_their_median(default_layout: Layout) -> None:
    found = tolerance_bars(default_layout.replaced(spec=DesignSpec()))
    assert "0.3" in found.assumed
    assert 0.0 <= found.hidden <= 1.0
    labels = [bar.label for bar in found.bars]
    assert len(set(labels)) == len(labels) > 10
    for bar in found.bars:
        assert bar.low <= bar.median <= bar.high
        assert " to " in bar.text
