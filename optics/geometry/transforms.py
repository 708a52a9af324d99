"""Rigid transforms as homogeneous matrices (4, 4), named `dst_from_src`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.values import FloatArray


def rigid(rotation: ArrayLike, translation: ArrayLike) -> FloatArray:
    """Rigid transforms (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3), which broadcast."""
    r, t = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    dst_from_src = np.zeros((*np.broadcast_shapes(r.shape[:-2], t.shape[:-1]), 4, 4))
    dst_from_src[..., :3, :3], dst_from_src[..., :3, 3], dst_from_src[..., 3, 3] = r, t, 1.0
    return dst_from_src


def inverse(dst_from_src: FloatArray) -> FloatArray:
    """Invert rigid transforms (..., 4, 4): src_from_dst."""
    rotation = np.swapaxes(dst_from_src[..., :3, :3], -1, -2)
    return rigid(rotation, -(rotation @ dst_from_src[..., :3, 3:])[..., 0])


def transform(dst_from_src: FloatArray, points_in_src: FloatArray) -> FloatArray:
    """Transform points (..., 3) from src to dst by a rigid transform (4, 4)."""
    return points_in_src @ dst_from_src[:3, :3].T + dst_from_src[:3, 3]
