"""Rays from the rim of the pupil, followed to a mirror: an oracle of the pixels whose whole pupil it serves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror

RAYS = 48


def unvignetted(mirror: Mirror, chief: FloatArray, pupil: Pupil) -> NDArray[np.bool_]:
    """Mask (n,) of chief rays (n, 2) to points in focus to which all rays from the rim are reflected by a mirror."""
    angles = 2.0 * np.pi * np.arange(RAYS) / RAYS
    rim = pupil.radius_mm * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(RAYS)])
    rays = np.column_stack([chief, np.ones(len(chief))])[:, None] - rim / pupil.focus_mm
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    _, leaves, *_ = trace_via_mirror(mirror, rays, None, np.broadcast_to(rim, rays.shape))
    return np.asarray(np.isfinite(leaves).all(axis=(1, 2)))
