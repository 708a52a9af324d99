"""Prior covariances of individual and common mirror motions, in the g calibrated parameters."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import rigid_motion_derivatives
from mirrorcam.optics.drift.matched_points import IntArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

COMMON_DEG, COMMON_MM, COMMON_SCALE = 0.5, 0.5, 0.01
"""Standard deviations of the common rotation, shift and scale of all mirrors, which a scene hardly determines."""


def centre_rows(names: tuple[str, ...], k: int) -> IntArray:
    """Indices (3,) of a mirror's virtual centre among the parameters."""
    return np.array([names.index(f"mirror {k} {axis}_mm") for axis in "xyz"])


def rotation_jacobian(layout: Layout, names: tuple[str, ...], k: int) -> FloatArray:
    """Derivatives (3, g) of a mirror's rotation vector w, rad, rig frame, with respect to the parameters.

    For the virtual centre c = -2 d n, w = n x dn, and the part of dn normal to n is -dc / (2 d).
    """
    mirror = layout.mirrors[k]
    n = mirror.normal_in_rig
    skew = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    jacobian = np.zeros((3, len(names)))
    jacobian[:, centre_rows(names, k)] = -skew / (2.0 * mirror.distance_mm)
    return jacobian


def centre_changes(mirror: Mirror) -> FloatArray:
    """Changes (3, 3) of the virtual centre, mm per rad; a row per rotation about the mirror's centre and a rig axis."""
    n, centre = mirror.normal_in_rig, mirror.outline_in_rig_mm.mean(axis=0)
    return np.array(
        [-2.0 * (axis @ np.cross(centre, n) * n + mirror.distance_mm * np.cross(axis, n)) for axis in np.eye(3)]
    )


def motion_covariance(mirror: Mirror, sigma_deg: float, sigma_mm: float) -> FloatArray:
    """Covariance (3, 3) of the virtual centre of a mirror that rotates about its centre and shifts along its normal."""
    n, changes = mirror.normal_in_rig, centre_changes(mirror)
    return np.asarray(np.deg2rad(sigma_deg) ** 2 * changes.T @ changes + (2.0 * sigma_mm) ** 2 * np.outer(n, n))


def hinged_covariance(mirror: Mirror, sigma_deg: float) -> FloatArray:
    """Covariance (3, 3) of the virtual centre of a mirror that rotates about a point on or near it.

    The mirror's centre shifts by about half its size times the rotation.
    """
    from_centre = mirror.outline_in_rig_mm - mirror.outline_in_rig_mm.mean(axis=0)
    return motion_covariance(
        mirror, sigma_deg, float(np.linalg.norm(from_centre, axis=1).mean()) * np.deg2rad(sigma_deg)
    )


def covariance_of_centres(blocks: dict[int, FloatArray], names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of the parameters from covariances (3, 3) of virtual centres by mirror index."""
    covariance = np.zeros((len(names),) * 2)
    for k, block in blocks.items():
        rows = centre_rows(names, k)
        covariance[np.ix_(rows, rows)] = block
    return covariance


def common_covariance(layout: Layout, names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of common rigid motions and a common scale of all mirrors."""
    motions, rows = common_motions(layout), all_centre_rows(layout, names)
    covariance = np.zeros((len(names),) * 2)
    covariance[np.ix_(rows, rows)] = motions @ motions.T
    return covariance


def common_motions(layout: Layout) -> FloatArray:
    """Changes (3 m, 7) of the virtual centres for one standard deviation of each common motion and the scale."""
    sigmas = np.array([np.deg2rad(COMMON_DEG)] * 3 + [COMMON_MM] * 3)
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    return np.column_stack([rigid_motion_derivatives(layout) * sigmas, COMMON_SCALE * centres.ravel()])


def all_centre_rows(layout: Layout, names: tuple[str, ...]) -> IntArray:
    """Indices (3 m,) of all virtual centres among the parameters."""
    return np.concatenate([centre_rows(names, k) for k in range(len(layout.mirrors))])


def calibration_covariance(layout: Layout, names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of the calibration; 0 for parameters that it does not contain."""
    covariance = np.zeros((len(names),) * 2)
    uncertainty = layout.uncertainty
    if uncertainty is not None:
        pairs = [(names.index(name), index) for index, name in enumerate(uncertainty.parameters) if name in names]
        rows, columns = np.array(pairs, dtype=np.int64).T
        covariance[np.ix_(rows, rows)] = uncertainty.covariance[np.ix_(columns, columns)]
    return covariance
