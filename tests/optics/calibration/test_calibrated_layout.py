"""Nominal mirrors moved to the planes that a calibration found."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.calibrated_layout import as_estimated, moved_to
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout


def test_a_mirror_moves_to_a_measured_plane_as_a_rigid_body(default_layout: Layout) -> None:
    nominal = default_layout.mirrors[0]
    target = nominal.virtual_centre_in_rig_mm + np.array([0.4, -0.3, 0.5])
    moved = moved_to(nominal, target)
    np.testing.assert_allclose(moved.virtual_centre_in_rig_mm, target, atol=1e-9)

    def sides(outline: FloatArray) -> FloatArray:
        return np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1)

    np.testing.assert_allclose(sides(moved.outline_in_rig_mm), sides(nominal.outline_in_rig_mm), atol=1e-9)
    assert np.abs(moved.outline_in_rig_mm - nominal.outline_in_rig_mm).max() < 2.0


def test_a_layout_as_estimated_has_the_camera_planes_and_curvatures_and_no_figures(default_layout: Layout) -> None:
    camera = default_layout.camera.replaced(fx_px=1300.0)
    estimate = Estimate.of(camera, default_layout.mirrors, np.zeros((0, 4, 4)))
    curved = Estimate(
        camera,
        1.01 * estimate.virtual_centres_in_rig_mm,
        estimate.rig_from_board,
        curvature_per_m=np.full((9, 3), 0.01),
    )
    found = as_estimated(default_layout, curved)
    assert (found.kind, found.camera, found.metrics, found.verdict) == ("calibrated", camera, {}, {})
    for mirror, nominal in zip(found.mirrors, default_layout.mirrors, strict=True):
        np.testing.assert_allclose(mirror.virtual_centre_in_rig_mm, 1.01 * nominal.virtual_centre_in_rig_mm)
        np.testing.assert_allclose(mirror.curvature_per_m, 0.01)
