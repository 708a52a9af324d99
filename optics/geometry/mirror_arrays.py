"""Mirrors as arrays, component first: a column for each point that is seen in one; quantities broadcast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class MirrorArrays:
    """The mirrors that points (3, n) are seen in; n may be 1 for one mirror of all points.

    Attributes
    ----------
    centre_mm
        Virtual centres (3, n) of the reflecting planes.
    middle_mm
        Means (3, n) of the outlines' corners.
    thickness_mm
        Thickness (n,) of the plate before the reflecting surface; 0 of first-surface mirrors.
    refractive_index
        Refractive index (n,) of the plate.
    curvature_per_m
        Curvature (3, n): xx, yy and xy; see `Mirror`.
    """

    centre_mm: FloatArray
    middle_mm: FloatArray
    thickness_mm: FloatArray
    refractive_index: FloatArray
    curvature_per_m: FloatArray


@dataclass(frozen=True)
class ImageDerivatives:
    """Derivatives of a values, each of one point's image.

    Attributes
    ----------
    point
        By the point (a, 3, n).
    centre
        By the virtual centre (a, 3, n).
    thickness
        By the thickness (a, n).
    curvature
        By the curvature (a, 3, n), or (a, 0, n) of mirrors that are taken as flat.
    """

    point: FloatArray
    centre: FloatArray
    thickness: FloatArray
    curvature: FloatArray


class MirrorImages(Protocol):
    """Images of points and their derivatives."""

    @property
    def image_mm(self) -> FloatArray:
        """Images (3, n), where the points appear to the pupil; NaN where there is none."""
        ...

    def vjp(self, by_image: FloatArray) -> ImageDerivatives:
        """Vector-Jacobian products: derivatives of a values from those by the image (a, 3, n)."""
        ...


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products over the last but one axis, which has three components."""
    return np.asarray(a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :] + a[..., 2, :] * b[..., 2, :])


def plane_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axes x and y (3, n) of planes with unit normals (3, n), see `Mirror.rig_from_plane`."""
    x_axis = np.array([[1.0], [0.0], [0.0]]) - normal[0] * normal
    along_x = np.sqrt(dot(x_axis, x_axis)) < 1e-6
    if along_x.any():
        x_axis = np.where(along_x, np.cross([[0.0], [1.0], [0.0]], normal, axis=0), x_axis)
    x_axis = x_axis / np.sqrt(dot(x_axis, x_axis))
    return x_axis, np.cross(normal, x_axis, axis=0)


def plane_of(centre_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normal (3, n) and distance (n,) from the pupil, mm, of the planes of virtual centres (3, n)."""
    length = np.sqrt(dot(centre_mm, centre_mm))
    return -centre_mm / length, length / 2.0


def plane_vjp(by_normal: FloatArray, by_distance: FloatArray, plane: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Derivatives (a, 3, n) by the virtual centre from those by the normal (a, 3, n) and the distance (a, n)."""
    normal, distance_mm = plane
    across = by_normal - dot(by_normal, normal)[:, None] * normal
    return np.asarray(across / (-2.0 * distance_mm) - 0.5 * by_distance[:, None] * normal)
