"""Repeated calibrations of simulated corners, and their errors against the Cramér-Rao bound."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import Observations
from tests.optics.calibration.solver.scenes import SIGMA_PX, Scene, disturbed, small_scene, start_from


@dataclass(frozen=True)
class Trials:
    """Errors (t, g) of the globals in trials and of the linear estimate from the same noise, and claims (t, g, g)."""

    scene: Scene
    errors: FloatArray
    linear: FloatArray
    claims: FloatArray
    with_outliers: FloatArray

    @property
    def mirrors(self) -> slice:
        """Indices of the virtual centres among the free globals."""
        return slice(9, 36)


def spoiled(observations: Observations, seed: int) -> Observations:
    """The corners with one in a hundred off by 20 sigma."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0.0, 2.0 * np.pi, len(observations))
    bad = random.random(len(observations)) < 0.01
    shift = 20.0 * SIGMA_PX * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return replace(observations, pixels=observations.pixels + bad[:, None] * shift)


def run_trials(count: int, *, outliers: int) -> Trials:
    scene = small_scene()
    errors, linear, claims, with_outliers = [], [], [], []
    for seed in range(count):
        seen, noise = scene.noisy(seed)
        solution = fit(scene.truth, seen, scene.model)
        errors.append(scene.errors(solution.estimate))
        linear.append(scene.linear @ noise.ravel())
        claims.append(solution.covariance)
        if seed < outliers:
            found = fit(scene.truth, spoiled(seen, 1000 + seed), scene.model)
            with_outliers.append(scene.errors(found.estimate))
    return Trials(scene, np.array(errors), np.array(linear), np.array(claims), np.array(with_outliers))


def normals_and_distances(trials: Trials, errors: FloatArray) -> FloatArray:
    """Errors (t, m, 3) of each mirror: its normal in two directions, rad, and its distance, mm, to first order."""
    parts = []
    for mirror, centre in enumerate(trials.scene.truth.virtual_centres_in_rig_mm):
        axes = trials.scene.layout.mirrors[mirror].rig_from_plane[:3, :3]
        change = errors[:, trials.mirrors][:, 3 * mirror : 3 * mirror + 3] @ axes
        parts.append(change * [1.0 / np.linalg.norm(centre), 1.0 / np.linalg.norm(centre), 0.5])
    return np.stack(parts, axis=1)


def over_bound(trials: Trials, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squared error (t, m) of each mirror's normal and of its distance, over the bound."""
    basis = normals_and_distances(trials, np.asarray(np.linalg.cholesky(trials.scene.bound).T, dtype=np.float64))
    variance = np.sum(basis**2, axis=0)
    found = normals_and_distances(trials, errors) ** 2
    return found[:, :, :2].sum(axis=2) / variance[:, :2].sum(axis=1), found[:, :, 2] / variance[:, 2]


def converges(scene: Scene, seed: int, *, tilt_deg: float, offset_mm: float) -> bool:
    """Return whether a fit finds the same minimum from wrong mirrors and lens as from the true ones."""
    seen, _ = scene.noisy(seed)
    nominal = scene.layout.camera.replaced(distortion=np.zeros(5))
    wrong = disturbed(scene.layout, seed, tilt_deg=tilt_deg, offset_mm=offset_mm)
    found = fit(start_from(nominal, wrong, seen, scene.model.board), seen, scene.model)
    best = fit(scene.truth, seen, scene.model)
    costs = [float(np.sum(solution.residuals**2)) for solution in (found, best)]
    return bool(np.isclose(costs[0], costs[1], rtol=1e-6))
