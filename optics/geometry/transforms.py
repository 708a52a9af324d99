"""Rigid transforms, named `dst_from_src`."""

from __future__ import annotations

from mirrorcam.optics.base.values import FloatArray


def transform(dst_from_src: FloatArray, points_in_src: FloatArray) -> FloatArray:
    """Points (..., 3) in dst of points (..., 3) in src, by a rigid 4x4."""
    return points_in_src @ dst_from_src[:3, :3].T + dst_from_src[:3, 3]
