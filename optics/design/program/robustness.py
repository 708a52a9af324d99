"""Margins of a design against the tolerances of printing and gluing, linearised at its seed."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.seeds import Seed
from mirrorcam.optics.geometry.design_spec import DesignSpec

SAFE_SIGMAS = 3.0
"""Standard deviations by which sub-images of neighbours are kept apart: none of 200 devices is to miss that."""

SEED = 15

DEVICES = 8
"""Devices as built that a robust design counts, besides the design itself."""


def displacements(spec: DesignSpec, seed: Seed) -> FloatArray:
    """Standard deviation (n, sides, 2), as a vector, of where the corners of each sub-image lie, normalized.

    A corner (u, v) at the depth z moves by (n_xy - n_z (u, v)) s / z where its mirror moves by s along its normal n: it
    is shifted, and tilted about its middle by both angles.
    """
    centres = seed.centres @ spec.view_from_rig
    rays = np.concatenate([seed.corners, np.ones((*seed.corners.shape[:-1], 1))], axis=-1)
    depths = 0.5 * (centres**2).sum(axis=-1)[:, None] / (rays @ centres[..., None])[..., 0]
    corners = rays * depths[..., None]
    levers = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=-1)
    along = np.hypot(spec.robust_offset_mm / spec.scale_mm, levers * np.deg2rad(spec.robust_tilt_deg))
    normals = (centres / np.linalg.norm(centres, axis=-1, keepdims=True))[:, None]
    return np.asarray((normals[..., :2] - normals[..., 2:] * seed.corners) * (along / depths)[..., None])


def safe_gap(moved: FloatArray, across: FloatArray) -> float:
    """The gap, normalized, that leaves two sub-images apart as built.

    `moved` (2, sides, 2) are the displacements of both, `across` (2) is the unit vector from the first to the second.
    """
    return SAFE_SIGMAS * float(np.linalg.norm(np.abs(moved @ across).max(axis=1)))


def tilts(spec: DesignSpec, devices: int) -> FloatArray:
    """Tilts (1 + devices, mirrors, 2) about two axes in the plane of each mirror, radians; first of the design: none.

    The same draws at each call. Every other device has the opposite tilts of that before, so that effects of first
    order cancel in the mean.
    """
    mirrors = len(spec.arrangement.steps)
    drawn = np.random.default_rng(SEED).standard_normal(((devices + 1) // 2, mirrors, 2))
    both = np.stack([drawn, -drawn], axis=1).reshape(-1, mirrors, 2)[:devices]
    return np.concatenate([np.zeros((1, mirrors, 2)), np.deg2rad(spec.robust_tilt_deg) * both])
