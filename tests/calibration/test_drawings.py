"""Drawings of a calibration's report: every mark is at its value, and red exactly where it should be."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.calibration.drawings import (
    board_distances,
    board_tilts,
    coverage_map,
    depth_sigmas,
    projection_sigmas,
    residual_histogram,
    residual_needles,
)
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.view_statistics import ViewFigures, board_normals, view_figures
from mirrorcam.optics.calibration.solver.observations import DIRECT
from tests.optics.calibration.sound_calibration import NOISE_PX, sound_calibration


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return sound_calibration()


@pytest.fixture(scope="module")
def views(calibration: Calibration) -> list[ViewFigures]:
    """Those of the mirrors."""
    return [view for view in view_figures(calibration) if view.view != DIRECT]


@pytest.fixture(scope="module")
def diagnostics(calibration: Calibration) -> Diagnostics:
    assert calibration.diagnostics is not None
    return calibration.diagnostics


def marks(drawing: str, style: str) -> list[ET.Element]:
    """The elements of a drawing that have a class; the drawing must be well-formed."""
    return [each for each in ET.fromstring(drawing).iter() if style in each.get("class", "").split()]


def corners(polygon: ET.Element) -> np.ndarray:
    return np.array([[float(number) for number in pair.split(",")] for pair in polygon.get("points", "").split()])


def test_needles_are_red_where_residuals_agree(calibration: Calibration, views: list[ViewFigures]) -> None:
    sound = residual_needles(calibration, views)
    assert len(marks(sound, "outline")) == len(views)
    assert len(marks(sound, "bad")) < 0.05 * len(marks(sound, "needle"))
    shifted = calibration.residuals_px + np.where(calibration.observations.view == 1, 4.0 * NOISE_PX, 0.0)[:, None]
    drawing = residual_needles(replace(calibration, residuals_px=shifted), views)
    red = marks(drawing, "bad")
    assert len(red) > 0.5 * len(marks(drawing, "needle")) / len(views)
    (left, top), (right, bottom) = (f(corners(marks(drawing, "outline")[1]), axis=0) for f in (np.min, np.max))
    inside = [left <= x <= right and top <= y <= bottom for x, y in (corners(needle)[0] for needle in red)]
    assert np.mean(inside) > 0.9


def test_needles_point_along_the_mean_residual(calibration: Calibration, views: list[ViewFigures]) -> None:
    towards = np.broadcast_to([3.0, -4.0], calibration.residuals_px.shape)
    drawing = residual_needles(replace(calibration, residuals_px=towards), views)
    needles = np.array([corners(needle) for needle in marks(drawing, "needle")])
    along = needles[:, 2] - needles[:, :2].mean(axis=1)
    directions = along / np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(directions, np.broadcast_to([0.6, -0.8], along.shape), atol=0.01)


def test_the_histogram_counts_inliers_in_standard_deviations(calibration: Calibration) -> None:
    noisier = replace(calibration.observations, sigma_px=2.0 * calibration.observations.sigma_px)
    doubled = residual_histogram(calibration), residual_histogram(replace(calibration, observations=noisier))
    widths = [np.ptp(corners(marks(drawing, "normal")[0])[:, 0]) for drawing in doubled]
    assert widths[0] == pytest.approx(widths[1])  # the normal distribution stays
    tops = [corners(marks(drawing, "steps")[0])[:, 1] for drawing in doubled]
    assert (tops[1] < tops[1].max()).sum() < (tops[0] < tops[0].max()).sum()  # residuals are half as many sigmas
    inliers = calibration.inliers.copy()
    inliers[::20] = False
    without = replace(calibration, inliers=inliers)
    spoiled = np.where(inliers[:, None], calibration.residuals_px, 3.0 * NOISE_PX)
    drawing = residual_histogram(replace(without, residuals_px=spoiled))
    assert drawing == residual_histogram(without) != doubled[0]


def test_cells_without_a_corner_are_red_and_others_darken(calibration: Calibration, views: list[ViewFigures]) -> None:
    counts = np.zeros_like(views[0].cell_counts)
    counts[:3] = (1, 20, 400)
    sparse = [replace(views[0], cell_counts=counts), *views[1:]]
    drawing = coverage_map(calibration.layout, sparse)
    cells = marks(drawing, "cell")
    assert len(cells) == sum(len(view.cell_counts) for view in views)
    empty = [cell for cell in cells if "none" in cell.get("class", "").split()]
    assert len(empty) == sum(int((view.cell_counts == 0).sum()) for view in sparse)
    darkness = [float(cell.get("fill-opacity", "nan")) for cell in cells[:3]]
    assert darkness == sorted(darkness)
    assert darkness[0] < darkness[2]
    assert f"mirror 0-0: {3 / len(counts):.0%}" in drawing
    assert all(f">{words}<" in drawing for words in ("no corner in the cell", "1 corner", "400 corners"))
    assert len(re.findall("<clipPath", drawing)) == len(views)


def test_each_frame_is_a_dot_in_the_direction_of_its_tilt(calibration: Calibration) -> None:
    dots = marks(board_tilts(calibration), "dot")
    assert len(dots) == len(calibration.rig_from_board)
    assert len({(dot.get("cx"), dot.get("cy")) for dot in dots}) == len(dots)
    normals, _ = board_normals(calibration)
    for axis, name in enumerate(("cx", "cy")):  # right and down in the drawing as in the picture
        along = [float(dot.get(name, "nan")) for dot in dots]
        assert np.corrcoef(along, normals[:, axis])[0, 1] > 0.95
    poses = calibration.rig_from_board.copy()
    poses[:, :3, :3] = poses[0, :3, :3]
    alike = marks(board_tilts(replace(calibration, rig_from_board=poses)), "dot")
    mirrored = {(dot.get("cx"), dot.get("cy")) for dot in alike if dot.get("class") == "dot"}
    assert len(mirrored) == 1


def test_distances_grow_to_the_right_a_row_for_each_view(views: list[ViewFigures]) -> None:
    dots = marks(board_distances(views), "dot")
    assert len(dots) == sum(len(view.distances_mm) for view in views)
    assert len({dot.get("cy") for dot in dots}) == len(views)
    across = np.array([float(dot.get("cx", "nan")) for dot in dots])
    distances = np.concatenate([view.distances_mm for view in views])
    slope, offset = np.polyfit(distances, across, 1)
    assert slope > 0.0
    np.testing.assert_allclose(slope * distances + offset, across, atol=0.01)


def test_shades_grow_with_the_sigma_and_are_cut_at_the_view(
    calibration: Calibration, views: list[ViewFigures], diagnostics: Diagnostics
) -> None:
    maps = [one for one in diagnostics.projection if one.view != DIRECT]
    values = [np.linspace(0.0, 1.0, len(one.pixels)) for one in maps]
    drawing = projection_sigmas(calibration.layout, views, maps, values, 1.0, name="of-test")
    shades = [float(shade.get("fill-opacity", "nan")) for shade in marks(drawing, "shade")]
    np.testing.assert_allclose(shades, 0.04 + 0.9 * np.concatenate(values), atol=0.006)
    for one in maps:
        assert f'<clipPath id="of-test-{one.view}">' in drawing
        assert f"mirror {calibration.layout.mirror_names[one.view]}: 0.5" in drawing
    still = projection_sigmas(calibration.layout, views, maps, [0.0 * value for value in values], 1.0, name="of-test")
    assert still.count("reference") == len(maps)


def test_depth_is_least_sure_in_total_and_unknown_ranges_are_left_out(diagnostics: Diagnostics) -> None:
    depth, range_mm = diagnostics.depth, diagnostics.range_mm
    drawing = depth_sigmas(depth, range_mm)
    heights = {name: corners(marks(drawing, name)[0])[:, 1] for name in ("both", "matching", "calibration")}
    assert (heights["both"] <= np.minimum(heights["matching"], heights["calibration"]) + 0.01).all()
    assert len(marks(drawing, "here")) == 1
    assert not marks(depth_sigmas(depth, 2.0 * float(depth.range_mm[-1])), "here")
    unknown = depth.calibration_mm.copy()
    unknown[-2:] = np.nan
    shorter = depth_sigmas(replace(depth, calibration_mm=unknown), range_mm)
    assert len(corners(marks(shorter, "both")[0])) == np.isfinite(depth.total_mm).sum() - 2
    assert "nan" not in shorter
