"""Figures of merit against closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from shapely import Polygon

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import NOT_FINITE, FloatArray
from mirrorcam.optics.design.assess.layout_metrics import (
    MAX_DEPTH_MM,
    MIN_DEPTH_MM,
    depth_range_mm,
    evaluate,
    fitted_grid,
    grid_error,
)
from mirrorcam.optics.design.program.seeds import faceted_parabola, mirrors_of
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import library
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.sub_images import common_region, fields_of_view
from tests.nightly import a_few
from tests.optics.seeing_mirrors import DEPTH_MM, mirror_seeing, two_rectangles


@pytest.fixture(name="two_rectangles")
def _two_rectangles() -> Layout:
    return two_rectangles()


def grid_layout(shifts_mm: FloatArray) -> Layout:
    """Four small mirrors whose virtual centres are 40 mm x 30 mm apart, each shifted by (4, 3) mm in the rig."""
    spec = DesignSpec(rows=2, cols=2)
    centres = np.array([[x, -80.0, z] for z in (95.0, 65.0) for x in (-20.0, 20.0)])
    quad = 0.03 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = np.array([quad + np.array([u, v]) for v in (0.2, -0.2) for u in (-0.3, 0.3)])
    mirrors = mirrors_of(spec, (centres + shifts_mm) @ spec.view_from_rig.T, corners)
    return Layout(rows=2, cols=2, camera=spec.camera, mirrors=mirrors)


def test_overlap_and_efficiency_of_two_rectangles(two_rectangles: Layout) -> None:
    region, footprints = common_region(two_rectangles, DEPTH_MM)
    assert [seen.area for seen in footprints] == pytest.approx([70.0 * 85.0, 70.0 * 70.0])
    assert region.symmetric_difference(Polygon([(-20, -90), (30, -90), (30, -105), (-20, -105)])).area < 1e-6
    metrics = evaluate(two_rectangles, [DEPTH_MM])
    assert metrics["overlap_iou_300mm"].value == pytest.approx(750.0 / (4900.0 + 5950.0 - 750.0))
    pixels = 750.0 * 1360.38**2 * (1.0 / 380.0**2 + 1.0 / 400.0**2)
    assert metrics["pixel_efficiency_300mm"].value == pytest.approx(pixels / (1920 * 1080))


def test_field_of_view_is_the_angle_of_the_common_region(two_rectangles: Layout) -> None:
    metrics = evaluate(two_rectangles, [DEPTH_MM])
    across = np.degrees(np.arctan(30.0 / 390.0) + np.arctan(20.0 / 390.0))
    upwards = np.degrees(np.arctan(15.0 / 390.0) - np.arctan(0.0))
    assert metrics["fov_x_deg"].value == pytest.approx(across)
    assert metrics["fov_y_deg"].value == pytest.approx(upwards)


def test_views_without_a_common_region_score_zero() -> None:
    upper, lower = mirror_seeing((-40, 30, 110, 160), 80.0), mirror_seeing((-20, 50, 20, 105), 100.0)
    metrics = evaluate(Layout(rows=2, cols=1, camera=Camera.c920(), mirrors=(lower, upper)), [DEPTH_MM])
    assert metrics["pixel_efficiency_300mm"].value == 0.0
    assert metrics["overlap_iou_300mm"].value == 0.0
    assert metrics["fov_x_deg"].value == 0.0


def test_one_mirror_sees_all_that_it_sees() -> None:
    layout = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror_seeing((-40, 40, 60, 120), 80.0),))
    metrics = evaluate(layout, [DEPTH_MM])
    assert metrics["overlap_iou_300mm"].value == pytest.approx(1.0)
    assert metrics["pixel_efficiency_300mm"].value == pytest.approx(80 * 60 * (1360.38 / 380) ** 2 / (1920 * 1080))
    assert metrics["grid_error"].value == 0.0
    assert "smallest_gap_mm" not in metrics


def test_a_perfect_grid_has_no_error() -> None:
    layout = grid_layout(np.zeros((4, 3)))
    assert grid_error(layout) < 1e-12
    metrics = evaluate(layout, [DEPTH_MM])
    assert metrics["baseline_x_mm"].value == pytest.approx(40.0)
    assert metrics["baseline_y_mm"].value == pytest.approx(30.0)


def test_grid_error_of_one_view_out_of_the_plane() -> None:
    shifts = np.zeros((4, 3))
    shifts[1, 1] = 6.0
    # The best plane takes a quarter of the shift: residuals 3/4 of it once and 1/4 three times.
    assert grid_error(grid_layout(shifts)) == pytest.approx(6.0 * np.sqrt(12.0 / 64.0) / np.sqrt(40.0 * 30.0))


def test_grid_error_takes_the_best_rectangular_grid() -> None:
    shifts = np.random.default_rng(3).normal(0.0, 3.0, (4, 3))
    layout = grid_layout(shifts)
    columns, rows = np.tile([-0.5, 0.5], 2), np.repeat([-0.5, 0.5], 2)
    zero, one = np.zeros(4), np.ones(4)
    design = np.concatenate(
        [
            np.column_stack([one, zero, zero, columns, zero]),
            np.column_stack([zero, one, zero, zero, rows]),
            np.column_stack([zero, zero, one, zero, zero]),
        ]
    )
    centres = layout.virtual_centres_in_view_mm.reshape(4, 3).T.ravel()
    solution, _, _, _ = np.linalg.lstsq(design, centres, rcond=None)
    rms = np.sqrt(np.sum((design @ solution - centres) ** 2) / 4)
    assert grid_error(layout) == pytest.approx(rms / np.sqrt(solution[3] * solution[4]))
    assert_allclose(fitted_grid(layout)[1], solution[3:])


def test_grid_error_is_the_same_at_any_scale() -> None:
    errors = [grid_error(faceted_parabola(DesignSpec(scale_mm=s, spacing_mm=s / 80))) for s in (40.0, 80.0)]
    assert errors[0] == pytest.approx(errors[1], abs=1e-3)


def test_coincident_views_do_not_form_a_grid(two_rectangles: Layout) -> None:
    with pytest.raises(InputError, match="apart along an axis of the grid"):
        grid_error(two_rectangles.replaced(rows=1, cols=2))


def test_a_depth_nearer_than_the_mirrors_is_refused() -> None:
    layout = faceted_parabola(DesignSpec(fold_deg=90.0))
    with pytest.raises(InputError, match=r"depth 20 mm is nearer than the mirrors, which reach 47\.\d mm"):
        evaluate(layout, [20.0])


def two_views(spacing_mm: float, half_tangent: float) -> Layout:
    """Views 40 mm up, `spacing_mm` apart, that see the same square of the plane y = 300 mm, 380 mm before them."""
    half_mm = 380.0 * half_tangent
    square = (-half_mm, half_mm, 80.0 - half_mm, 80.0 + half_mm)
    mirrors = tuple(mirror_seeing(square, 80.0, side * spacing_mm / 2.0) for side in (-1.0, 1.0))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=mirrors)


def test_depth_range_of_two_views_that_meet() -> None:
    # Fields of upright views are rectangles at every depth: their overlap, and the number of pixels that see it, follow
    # from intervals.
    heights, (low, high, half) = (70.0, 100.0), (80.0, 100.0, 30.0)
    mirrors = tuple(mirror_seeing((-half, half, low, high), height) for height in reversed(heights))
    layout = Layout(rows=2, cols=1, camera=Camera.c920(), mirrors=mirrors)

    def share(depth_mm: float) -> float:
        fields = [(h, (depth_mm + h) / (DEPTH_MM + h)) for h in heights]
        across = 2.0 * min(half * wider for _, wider in fields)
        upwards = min(h + (high - h) * w for h, w in fields) - max(h + (low - h) * w for h, w in fields)
        return max(upwards, 0.0) * across * sum(1.0 / (depth_mm + h) ** 2 for h in heights)

    nearest, farthest = (
        brentq(lambda depth_mm: share(depth_mm) - share(DEPTH_MM) / 2.0, *between, xtol=1e-6)
        for between in ((120.0, 299.0), (301.0, 2000.0))
    )
    metrics = evaluate(layout, [DEPTH_MM])
    assert metrics["depth_nearest_mm"].value == pytest.approx(nearest, rel=2e-4)
    assert metrics["depth_farthest_mm"].value == pytest.approx(farthest, rel=2e-4)
    assert 150.0 < nearest < 280.0 < 350.0 < farthest < 1000.0
    assert metrics["depth_farthest_mm"].unit == "mm"


def test_depth_range_is_around_the_best_working_depth() -> None:
    alone, beside = (evaluate(two_views(60.0, 0.05), depths) for depths in ([DEPTH_MM], [DEPTH_MM, 250.0]))
    for name in ("depth_nearest_mm", "depth_farthest_mm"):
        assert beside[name] == alone[name]


def test_a_depth_range_without_end_says_so() -> None:
    # The fields separate by b (1 - D / 380) and are 2 a D wide, a / b > 1 / 380: at infinity half is still common.
    metrics = evaluate(two_views(60.0, 0.18), [DEPTH_MM])
    assert (metrics["depth_farthest_mm"].value, metrics["depth_farthest_mm"].unit) == (MAX_DEPTH_MM, "mm or more")
    assert metrics["depth_nearest_mm"].value < 150.0


def test_a_depth_range_ends_at_the_mirrors() -> None:
    layout = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror_seeing((-40, 40, 60, 120), 80.0),))
    reach_mm = float(layout.mirrors[0].outline_in_rig_mm[:, 1].max())
    assert evaluate(layout, [DEPTH_MM])["depth_nearest_mm"].value == pytest.approx(reach_mm, rel=1e-5)


def test_views_without_a_common_region_have_no_depth_range() -> None:
    upper, lower = mirror_seeing((-40, 30, 110, 160), 80.0), mirror_seeing((-20, 50, 20, 105), 100.0)
    metrics = evaluate(Layout(rows=2, cols=1, camera=Camera.c920(), mirrors=(lower, upper)), [DEPTH_MM])
    assert not [name for name in metrics if name.startswith("depth_nearest") or name.startswith("depth_farthest")]


def test_disparity_and_depth_resolution_of_a_grid() -> None:
    metrics = evaluate(grid_layout(np.zeros((4, 3))), [DEPTH_MM, 500.0])
    f = 1360.38
    assert metrics["disparity_s_300mm"].value == pytest.approx(f * 40.0 / 380.0)
    assert metrics["disparity_t_500mm"].value == pytest.approx(f * 30.0 / 580.0)
    assert metrics["depth_resolution_300mm"].value == pytest.approx(380.0**2 / (f * 40.0))
    assert metrics["depth_resolution_fine_500mm"].value == pytest.approx(0.25 * 580.0**2 / (f * 40.0))


def test_disparity_is_how_far_a_point_moves_from_view_to_view() -> None:
    # Relative to infinity (here: 10^7 mm), in parallel views, as the project defines it.
    layout = grid_layout(np.zeros((4, 3)))
    metrics = evaluate(layout, [DEPTH_MM])
    left, right = layout.virtual_centres_in_view_mm[1]
    shifts = []
    for depth_mm in (DEPTH_MM, 1e7):
        point = np.array([7.0, -90.0, depth_mm])
        pixels = [1360.38 * (point - c)[:2] / (point - c)[2] for c in (left, right)]
        shifts.append(pixels[0][0] - pixels[1][0])
    assert metrics["disparity_s_300mm"].value == pytest.approx(shifts[0] - shifts[1], rel=1e-4)
    # One more pixel of disparity over the full baseline is one depth resolution nearer, to first order.
    nearer = evaluate(layout, [DEPTH_MM - metrics["depth_resolution_fine_300mm"].value])
    gained = (
        next(m.value for n, m in nearer.items() if n.startswith("disparity_s")) - metrics["disparity_s_300mm"].value
    )
    assert gained == pytest.approx(0.25, rel=0.01)


def test_a_single_view_determines_no_depth() -> None:
    layout = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror_seeing((-40, 40, 60, 120), 80.0),))
    of_depth = ("disparity", "resolution", "depth_sigma")
    assert not [name for name in evaluate(layout, [DEPTH_MM]) if name.startswith(of_depth) or "disparity" in name]


def test_sizes_of_mirrors() -> None:
    corners = np.array([[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 12.0, 12.0], [-5.0, 12.0, 12.0]])
    mirror = Mirror(virtual_centre_in_rig_mm=[0.0, -80.0, 80.0], outline_in_rig_mm=corners + np.array([0, 0, 80.0]))
    metrics = evaluate(Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror,)), [DEPTH_MM])
    found = [metrics[name].value for name in ("shortest_edge_mm", "longest_edge_mm", "smallest_area_mm2")]
    assert found == pytest.approx([10.0, 12.0 * np.sqrt(2), 120.0 * np.sqrt(2)])
    assert metrics["largest_area_mm2"].value == metrics["smallest_area_mm2"].value


def test_second_surface_mirrors_score_as_what_they_look_like() -> None:
    plain = faceted_parabola(DesignSpec(rows=2, cols=2, spacing_mm=3.0, fold_deg=90.0))

    def behind(thickness_mm: float) -> Layout:
        second = [
            Mirror.second_surface(
                m.virtual_centre_in_rig_mm, m.outline_in_rig_mm, thickness_mm=thickness_mm, refractive_index=1.49
            )
            for m in plain.mirrors
        ]
        return plain.replaced(mirrors=tuple(second))

    before, thin, thick = (evaluate(layout, [DEPTH_MM]) for layout in (plain, behind(0.01), behind(3.0)))
    assert "slab_stray_mm" not in before
    for name in ("grid_error", "baseline_x_mm", "baseline_y_mm", "disparity_s_300mm"):
        assert thick[name].value == pytest.approx(before[name].value, rel=1e-9), name
    assert thin["pixel_efficiency_300mm"].value == pytest.approx(before["pixel_efficiency_300mm"].value, abs=2e-3)
    # The rim of a second-surface mirror shows nothing, and its light is offset.
    assert thick["pixel_efficiency_300mm"].value < before["pixel_efficiency_300mm"].value - 0.02
    assert 0.05 < thick["slab_stray_mm"].value < 1.0
    distance_mm = DEPTH_MM - float(plain.virtual_centres_in_rig_mm[:, 1].max())
    assert thick["slab_stray_px"].value == pytest.approx(1360.38 * thick["slab_stray_mm"].value / distance_mm)


def test_a_depth_range_ends_before_the_pupil_if_mirrors_fold_light_past_it() -> None:
    # At this fold and scale the mirrors lie behind the pupil along the views, and their views overlap from there on.
    spec = DesignSpec(rows=1, cols=2, scale_mm=400.0, fold_deg=150.0, tradeoff=0.0)
    layout = faceted_parabola(spec)
    views = fields_of_view(layout)
    assert views.mirror_depth_mm < 0.0
    found = depth_range_mm(views, [2.0, 3.0])
    assert found is not None
    assert found[0] == MIN_DEPTH_MM


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", a_few(6, [name for name, profile in library().items() if profile.optics is not None]))
def test_figures_of_every_camera_near_its_mirrors_are_finite_or_none_with_a_reason(name: str) -> None:
    """Near the camera, lenses that are focused farther away blur the views until contrasts underflow."""
    for scale_mm in (40.0, 80.0):
        for depth_mm in (1.2 * scale_mm, 1.7 * scale_mm, 3.0 * scale_mm):
            camera = library()[name].camera
            layout = faceted_parabola(
                DesignSpec(camera=camera, rows=1, cols=2, scale_mm=scale_mm, depths_mm=(depth_mm,))
            )
            for figure, metric in evaluate(layout, (depth_mm,)).items():
                assert metric.known, (scale_mm, depth_mm, figure)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("focus_mm", [20.0, 500.0, 1e6])
@pytest.mark.parametrize("aperture_mm", [0.1, 2.0, 8.0])
def test_figures_of_any_focus_are_finite_or_none_with_a_reason(aperture_mm: float, focus_mm: float) -> None:
    camera = Camera.c920().replaced(aperture_mm=aperture_mm, focus_mm=focus_mm)
    layout = faceted_parabola(DesignSpec(camera=camera, rows=1, cols=2, scale_mm=40.0, depths_mm=(60.0, 100.0)))
    for figure, metric in evaluate(layout, (60.0, 100.0)).items():
        assert metric.known or metric.reason != NOT_FINITE, figure
        assert figure.startswith("depth_sigma") or metric.known, figure


def test_halves_of_one_mirror_have_no_grid_error_and_all_other_figures() -> None:
    """Two outlines on one plane have one virtual centre."""
    layout = two_rectangles()
    first = layout.mirrors[0]
    a, b, c, d = first.outline_in_rig_mm
    sides = (
        np.array([a, 0.6 * a + 0.4 * b, 0.6 * d + 0.4 * c, d]),
        np.array([0.4 * a + 0.6 * b, b, c, 0.4 * d + 0.6 * c]),
    )
    halves = layout.replaced(mirrors=tuple(first.replaced(outline_in_rig_mm=side) for side in sides))
    figures = evaluate(halves, (DEPTH_MM,))
    assert not figures["grid_error"].known
    assert "apart along an axis of the grid" in figures["grid_error"].reason
    assert figures["pixel_efficiency_300mm"].known
