"""Mirrors as component-first arrays: one column per point, for the mirror that images it; arrays broadcast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class MirrorArrays:
    """The mirrors in which points (3, n) are imaged; n may be 1 if all points are imaged in one mirror.

    Attributes
    ----------
    centre_mm : virtual centres (3, n) of the reflecting planes.
    centroid_mm : means (3, n) of the outlines' corners.
    thickness_mm : thickness (n,) of the plate in front of the reflecting surface; 0 for first-surface mirrors.
    refractive_index : refractive index (n,) of the plate.
    curvature_per_m : curvatures (3, n): xx, yy and xy; see `Mirror`.
    """

    centre_mm: FloatArray
    centroid_mm: FloatArray
    thickness_mm: FloatArray
    refractive_index: FloatArray
    curvature_per_m: FloatArray


@dataclass(frozen=True)
class ImageDerivatives:
    """Derivatives of k functions of each point's image.

    Attributes
    ----------
    point : derivatives (k, 3, n) with respect to the point.
    centre : derivatives (k, 3, n) with respect to the virtual centre.
    thickness : derivatives (k, n) with respect to the thickness.
    curvature : derivatives (k, 3, n) with respect to the curvature, or (k, 0, n) for mirrors treated as flat.
    """

    point: FloatArray
    centre: FloatArray
    thickness: FloatArray
    curvature: FloatArray


class MirrorImages(Protocol):
    """Images of points and their derivatives."""

    @property
    def image_mm(self) -> FloatArray:
        """Images (3, n) of the points, exact in their directions from the pupil; NaN where there is none."""
        ...

    def vjp(self, d_image: FloatArray) -> ImageDerivatives:
        """Vector-Jacobian product: pull derivatives (k, 3, n) with respect to the image back to the inputs."""
        ...


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products over the second-to-last axis, which has three components."""
    return np.asarray(a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :] + a[..., 2, :] * b[..., 2, :])


def plane_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axes x and y (3, n) of planes with unit normals (3, n); see `Mirror.rig_from_plane`."""
    x_axis = np.array([[1.0], [0.0], [0.0]]) - normal[0] * normal
    along_x = np.sqrt(dot(x_axis, x_axis)) < 1e-6
    if along_x.any():
        x_axis = np.where(along_x, np.cross([[0.0], [1.0], [0.0]], normal, axis=0), x_axis)
    x_axis = x_axis / np.sqrt(dot(x_axis, x_axis))
    return x_axis, np.cross(normal, x_axis, axis=0)


def plane_of(centre_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normals (3, n) and distances (n,) from the pupil, mm, of the planes of virtual centres (3, n)."""
    length = np.sqrt(dot(centre_mm, centre_mm))
    return -centre_mm / length, length / 2.0


def plane_vjp(d_normal: FloatArray, d_distance: FloatArray, plane: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Pull derivatives with respect to normal (k, 3, n) and distance (k, n) back to the virtual centre (k, 3, n)."""
    normal, distance_mm = plane
    tangential = d_normal - dot(d_normal, normal)[:, None] * normal
    return np.asarray(tangential / (-2.0 * distance_mm) - 0.5 * d_distance[:, None] * normal)
