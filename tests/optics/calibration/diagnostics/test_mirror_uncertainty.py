"""Sigmas of mirrors: against sampling, with the common motion separated from each mirror's own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import (
    common_motion,
    mirror_covariance,
    mirror_uncertainty,
    motions_of,
    normal_and_distance_sigmas,
    rigid_motion_derivatives,
    weak_directions,
)
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

LEVER_MM = 400.0
RANGE_MM = 400.0
NAMED = (
    "all mirrors together about x",
    "all mirrors together about y",
    "all mirrors away from the camera",
    "focal length",
    "principal point in x",
    "lens distortion k1",
    "mirror 1-0 about its y",
    "mirror 1-1 along its normal",
)


def with_covariance(layout: Layout, covariance: FloatArray) -> Layout:
    names = tuple(f"mirror {m} {axis}_mm" for m in range(len(layout.mirrors)) for axis in "xyz")
    return layout.replaced(uncertainty=Uncertainty(parameters=names, covariance=covariance))


def moved_as_one_body(layout: Layout, turn_rad: FloatArray, shift_mm: FloatArray) -> FloatArray:
    """Return virtual centres (3 m,) after a rigid motion of all mirrors, from points and normals."""
    middle = np.mean([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors], axis=0)
    rotation = Rotation.from_rotvec(turn_rad).as_matrix()
    centres = []
    for mirror in layout.mirrors:
        point = rotation @ (mirror.outline_in_rig_mm[0] - middle) + middle + shift_mm
        normal = rotation @ mirror.normal_in_rig
        centres.append(2.0 * (normal @ point) * normal)
    return np.concatenate(centres)


@pytest.mark.parametrize("k", range(6))
def test_rigid_motions_are_the_derivatives_of_moving_the_body(device: Layout, k: int) -> None:
    h = 1e-5
    step = h * np.eye(6)[k]
    ahead, back = (moved_as_one_body(device, sign * step[:3], sign * step[3:]) for sign in (1.0, -1.0))
    found = rigid_motion_derivatives(device)[:, k]
    np.testing.assert_allclose(found, (ahead - back) / (2 * h), atol=1e-6 * np.abs(found).max())


def test_a_rigid_motion_is_entirely_common(device: Layout) -> None:
    motions = rigid_motion_derivatives(device)
    np.testing.assert_allclose(common_motion(device, lever_mm=LEVER_MM) @ motions, np.eye(6), atol=1e-8)
    turn = np.radians(0.01) * motions[:, 0]
    found = mirror_uncertainty(with_covariance(device, np.outer(turn, turn)), lever_mm=LEVER_MM)
    np.testing.assert_allclose(found.common_rotation_deg, [0.01, 0.0, 0.0], atol=1e-8)
    np.testing.assert_allclose(found.common_shift_mm, 0.0, atol=1e-8)
    np.testing.assert_allclose(found.relative_normal_deg, 0.0, atol=1e-8)
    np.testing.assert_allclose(found.relative_distance_mm, 0.0, atol=1e-8)


def test_the_motion_of_one_mirror_is_not_common(device: Layout) -> None:
    covariance = np.zeros((12, 12))
    covariance[3:6, 3:6] = 1e-4 * np.eye(3)
    found = mirror_uncertainty(with_covariance(device, covariance), lever_mm=LEVER_MM)
    assert found.normal_deg.argmax() == 1
    assert (found.normal_deg[[0, 2, 3]] == 0.0).all()
    assert found.relative_normal_deg.argmax() == 1
    assert found.relative_normal_deg[1] > 0.3 * found.normal_deg[1]


def test_sigmas_match_sampling(calibrated: Layout) -> None:
    assert calibrated.uncertainty is not None
    covariance = mirror_covariance(calibrated.uncertainty)
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in calibrated.mirrors])
    tilts, distances = normal_and_distance_sigmas(centres, covariance)
    draws = np.random.default_rng(0).multivariate_normal(centres.ravel(), covariance, size=4000).reshape(-1, 4, 3)
    lengths = np.linalg.norm(draws, axis=2)
    np.testing.assert_allclose(np.std(lengths / 2.0, axis=0), distances, rtol=0.05)
    normals = -draws / lengths[:, :, None]
    for m in range(4):
        worst = np.sqrt(np.linalg.eigvalsh(np.cov(normals[:, m].T))[-1])
        assert worst == pytest.approx(tilts[m], rel=0.05)


def test_the_common_motion_is_less_certain_than_relative_ones(calibrated: Layout) -> None:
    """All views have similar directions, so that only the camera determines their common rotation."""
    found = mirror_uncertainty(calibrated, lever_mm=LEVER_MM)
    assert (found.relative_normal_deg < found.normal_deg).all()
    assert found.relative_normal_deg.max() < 0.7 * np.linalg.norm(found.common_rotation_deg)


def weak_along(layout: Layout, names: tuple[str, ...], amounts: tuple[float, ...]) -> Layout:
    """The layout with a covariance that is large along a sum of named motions and small elsewhere."""
    assert layout.uncertainty is not None
    motions = {motion.name: motion.change for motion in motions_of(layout)}
    change = np.sum([amount * motions[name] for name, amount in zip(names, amounts, strict=True)], axis=0)
    covariance = 1e-6 * layout.uncertainty.covariance + np.outer(change, change)
    return layout.replaced(uncertainty=Uncertainty(parameters=layout.uncertainty.parameters, covariance=covariance))


@pytest.mark.parametrize("name", NAMED)
def test_a_weak_motion_is_named_with_its_sigma(calibrated: Layout, name: str) -> None:
    weakest = weak_directions(weak_along(calibrated, (name,), (0.01,)), range_mm=RANGE_MM)[0]
    assert weakest.description == name
    assert weakest.fraction == pytest.approx(1.0, abs=1e-3)
    ((found, sigma, _),) = weakest.sigmas
    assert found == name
    assert sigma == pytest.approx(0.01, rel=1e-3)


def test_two_motions_that_compensate_each_other_are_named_together(calibrated: Layout) -> None:
    names = ("principal point in y", "all mirrors together about x")
    weakest = weak_directions(weak_along(calibrated, names, (1.0, 0.02)), range_mm=RANGE_MM)[0]
    assert set(weakest.description.split(" against ")) == set(names)
    sigmas = {name: sigma for name, sigma, _ in weakest.sigmas}
    assert sigmas == pytest.approx({names[0]: 1.0, names[1]: 0.02}, rel=1e-2)


def test_the_directions_of_a_calibration_are_named(calibrated: Layout) -> None:
    found = weak_directions(calibrated, range_mm=RANGE_MM, count=4)
    assert [w.separate_px for w in found] == sorted((w.separate_px for w in found), reverse=True)
    assert found[0].description.startswith("all mirrors ")
    assert found[0].fraction > 0.8
    assert found[0].combined_px < 0.8 * found[0].separate_px
