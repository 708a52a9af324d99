"""Errors that corners of a view share, against the dense pseudo-inverse of derivatives by finite differences."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.calibration.solver.shared_errors import SHARED_PX, shared_covariance
from tests.optics.calibration.solver.scenes import Scene, small_scene
from tests.optics.calibration.solver.test_plates_and_curvature import built


def shared_fields(of: Scene) -> FloatArray:
    """Errors (2 n, k) px of all corners: six in each mirror."""
    seen, columns = of.clean, []
    for mirror in range(len(of.layout.mirrors)):
        own = seen.view == mirror
        at = (seen.pixels - seen.pixels[own].mean(axis=0)) / seen.pixels[own].std(axis=0)
        for field in (np.ones(len(seen)), at[:, 0], at[:, 1]):
            of_view = np.where(own, field, 0.0)[:, None]
            columns += [(axis * of_view).ravel() for axis in np.eye(2)]
    return SHARED_PX * np.array(columns).T


def test_the_covariance_is_that_of_fits_to_corners_with_shared_errors() -> None:
    scene = built("sheet")
    expected = np.linalg.lstsq(scene.jacobian, shared_fields(scene), rcond=None)[0][: len(scene.free)]
    found = shared_covariance(scene.truth, scene.clean, scene.model)
    size = np.sqrt(np.diag(expected @ expected.T))
    np.testing.assert_allclose(found / np.outer(size, size), expected @ expected.T / np.outer(size, size), atol=2e-3)


def test_it_is_part_of_the_covariance_of_a_fit_and_does_not_average_out() -> None:
    scene = built("sheet")
    seen, _ = scene.noisy(0)
    solution = fit(scene.truth, seen, scene.model)
    shared = shared_covariance(solution.estimate, seen.where(solution.inliers), scene.model)
    assert np.linalg.eigvalsh(solution.covariance - shared).min() > 0.0
    direct = scene.clean.view == DIRECT
    half = scene.clean.where(direct | (scene.clean.corner % 2 == 0))
    fewer = shared_covariance(scene.truth, half, scene.model)
    whole = shared_covariance(scene.truth, scene.clean, scene.model)
    assert 0.8 < np.median(np.sqrt(np.diag(fewer) / np.diag(whole))) < 1.25


def test_corners_in_first_surface_mirrors_share_nothing() -> None:
    scene = small_scene()
    assert not shared_covariance(scene.truth, scene.clean, scene.model).any()
