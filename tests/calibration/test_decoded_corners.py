"""Errors of corners in decoded views, predicted from a covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.calibration.decoded_corners import DecodedCorners, error_derivatives
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    grid_points,
    points_at_pixels,
    project_points,
    uncertainty_of,
)
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.sound_calibration import sound_calibration

FOCAL_PX, RANGE_MM = 900.0, 400.0


def decoded_px(layout: Layout, view: int, pixels: FloatArray, view_from_rig: FloatArray) -> FloatArray:
    """Positions (n, 2) in a decoded view of what sensor pixels (n, 2) show."""
    offset = points_at_pixels(layout, view, pixels, RANGE_MM) - layout.mirrors[view].virtual_centre_in_rig_mm
    offset = offset @ view_from_rig.T
    return np.asarray(FOCAL_PX * offset[:, :2] / offset[:, 2:])


def changed(layout: Layout, parameter: str, step: float) -> Layout:
    """A layout with one parameter of its covariance changed."""
    camera = layout.camera
    if parameter in camera.intrinsic_names:
        change = step * (np.array(camera.intrinsic_names) == parameter)
        return layout.replaced(camera=camera.with_intrinsics(camera.intrinsics + change))
    _, number, axis = parameter.split()
    mirror = layout.mirrors[int(number)]
    centre = mirror.virtual_centre_in_rig_mm + step * np.eye(3)["xyz".index(axis[0])]
    mirrors = [tilted_to(mirror, centre) if k == int(number) else m for k, m in enumerate(layout.mirrors)]
    return layout.replaced(mirrors=tuple(mirrors))


def test_errors_of_parameters_show_in_decoded_views_as_predicted() -> None:
    layout, view = sound_calibration().layout, 1
    pixels, points = grid_points(layout, view, RANGE_MM)
    pixels, points = pixels[::7], points[::7]
    centre = layout.mirrors[view].virtual_centre_in_rig_mm
    turn = Rotation.align_vectors([[0.1, -0.2, 1.0]], [(points - centre).mean(axis=0)])[0].as_matrix()
    d_rotation, d_parameter, d_frame = error_derivatives(layout, view, points, centre, FOCAL_PX, turn)
    before = decoded_px(layout, view, pixels, turn)
    for k, parameter in enumerate(uncertainty_of(layout).parameters):
        step = 1e-3 if parameter.endswith(("_mm", "_px")) else 1e-6
        after = decoded_px(changed(layout, parameter, step), view, pixels, turn)
        np.testing.assert_allclose((after - before) / step, d_parameter[..., k], 2e-3, 2e-3, err_msg=parameter)
    for axis in range(2):
        after = decoded_px(layout, view, pixels + 1e-3 * np.eye(2)[axis], turn)
        np.testing.assert_allclose((after - before) / 1e-3, d_frame[..., axis], rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(project_points(layout, view, points).pixels, pixels, atol=1e-6)
    moved = (points - centre) @ Rotation.from_rotvec([0.0, 1e-6, 0.0]).as_matrix().T @ turn.T
    after = FOCAL_PX * moved[:, :2] / moved[:, 2:]
    np.testing.assert_allclose((before - after) / 1e-6, d_rotation[..., 1], rtol=1e-3, atol=1e-2)


def test_a_rotation_of_the_rig_is_no_error() -> None:
    random = np.random.default_rng(0)
    d_rotation, noise = random.normal(size=(50, 2, 3)), 0.01 * random.normal(size=(50, 2))
    products = np.zeros((4, 4))
    same = np.tile(np.eye(2), (50, 1, 1))
    still, turned = (
        DecodedCorners(errors, d_rotation, same, products) for errors in (noise, noise + d_rotation @ [3.0, -2.0, 1.0])
    )
    np.testing.assert_allclose(turned.distances_px(), still.distances_px(), atol=1e-12)


@pytest.mark.parametrize("corner_sigma_px", [0.0, 0.5])
def test_the_bound_is_exceeded_as_often_as_stated(corner_sigma_px: float) -> None:
    random = np.random.default_rng(1)
    d_rotation, d_parameter = random.normal(size=(200, 2, 3)), random.normal(size=(200, 2, 6))
    d_frame = 1.3 * np.tile(Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()[:2, :2], (200, 1, 1))
    root = np.diag([2.0, 1.0, 0.7, 0.5, 0.2, 0.1]) @ random.normal(size=(6, 6))
    columns = np.concatenate([d_rotation, d_parameter], axis=2).reshape(-1, 9)
    rms = []
    for _ in range(2000):
        noise = np.einsum("nij,nj->ni", d_frame, corner_sigma_px * random.normal(size=(200, 2)))
        errors = d_parameter @ (root @ random.normal(size=6)) + noise
        drawn = DecodedCorners(errors, d_rotation, d_frame, columns.T @ columns)
        rms.append(float(np.sqrt(np.mean(drawn.distances_px() ** 2))))
    sigma_px, limit_px = drawn.bound_px(root @ root.T, corner_sigma_px, 0.05)
    assert np.sqrt(np.mean(np.square(rms))) == pytest.approx(sigma_px, rel=0.05)
    assert 0.035 < np.mean(np.array(rms) > limit_px) < 0.065
