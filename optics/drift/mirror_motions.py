"""Prior covariances of mirror motions, individual and common, in the calibrated parameters (g)."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import rigid_motion_derivatives
from mirrorcam.optics.drift.matched_points import IntArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

COMMON_DEG, COMMON_MM, COMMON_SCALE = 0.5, 0.5, 0.01
"""Standard deviations of the common motion of all mirrors, which a scene hardly determines."""


def mirror_rows(names: tuple[str, ...], k: int) -> IntArray:
    """Indices (3,) of a mirror's virtual centre among the parameters."""
    return np.array([names.index(f"mirror {k} {axis}_mm") for axis in "xyz"])


def turn_of_centre(layout: Layout, names: tuple[str, ...], k: int) -> FloatArray:
    """Derivatives (3, g) of a mirror's rotation, rad: with c = -2 d n, dn = -dc / |c| across n, and w = n x dn."""
    mirror = layout.mirrors[k]
    n = mirror.normal_in_rig
    skew = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    turn = np.zeros((3, len(names)))
    turn[:, mirror_rows(names, k)] = -skew / (2.0 * mirror.distance_mm)
    return turn


def turns_about_middle(mirror: Mirror) -> FloatArray:
    """Changes (3, 3) of the virtual centre, mm per rad, for rotations about the mirror's centre and the rig's axes."""
    n, middle = mirror.normal_in_rig, mirror.outline_in_rig_mm.mean(axis=0)
    return np.array(
        [-2.0 * (axis @ np.cross(middle, n) * n + mirror.distance_mm * np.cross(axis, n)) for axis in np.eye(3)]
    )


def own_motion(mirror: Mirror, turn_deg: float, shift_mm: float) -> FloatArray:
    """Covariance (3, 3) of the virtual centre of a mirror that turns about its centre and shifts along its normal."""
    n, turns = mirror.normal_in_rig, turns_about_middle(mirror)
    return np.asarray(np.deg2rad(turn_deg) ** 2 * turns.T @ turns + (2.0 * shift_mm) ** 2 * np.outer(n, n))


def hinged_motion(mirror: Mirror, turn_deg: float) -> FloatArray:
    """Covariance (3, 3) of the virtual centre of a mirror that turns about a point on or near it.

    The mirror's centre shifts by about half its size times the turn.
    """
    spokes = mirror.outline_in_rig_mm - mirror.outline_in_rig_mm.mean(axis=0)
    return own_motion(mirror, turn_deg, float(np.linalg.norm(spokes, axis=1).mean()) * np.deg2rad(turn_deg))


def mirror_covariance(blocks: dict[int, FloatArray], names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of the parameters from covariances (3, 3) of virtual centres by mirror index."""
    covariance = np.zeros((len(names),) * 2)
    for k, block in blocks.items():
        rows = mirror_rows(names, k)
        covariance[np.ix_(rows, rows)] = block
    return covariance


def common_covariance(layout: Layout, names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of rigid motions of all mirrors together, and of a common scale, which pictures do not show."""
    motions, rows = common_motions(layout), all_rows(layout, names)
    covariance = np.zeros((len(names),) * 2)
    covariance[np.ix_(rows, rows)] = motions @ motions.T
    return covariance


def common_motions(layout: Layout) -> FloatArray:
    """Changes (3 m, 7) of the virtual centres for one standard deviation of each common motion and the scale."""
    sizes = np.array([np.deg2rad(COMMON_DEG)] * 3 + [COMMON_MM] * 3)
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    return np.column_stack([rigid_motion_derivatives(layout) * sizes, COMMON_SCALE * centres.ravel()])


def all_rows(layout: Layout, names: tuple[str, ...]) -> IntArray:
    return np.concatenate([mirror_rows(names, k) for k in range(len(layout.mirrors))])


def calibration_covariance(layout: Layout, names: tuple[str, ...]) -> FloatArray:
    """Covariance (g, g) of the calibration; 0 for parameters that it does not contain."""
    covariance = np.zeros((len(names),) * 2)
    known = layout.uncertainty
    if known is not None:
        pairs = [(names.index(name), index) for index, name in enumerate(known.parameters) if name in names]
        rows, columns = np.array(pairs, dtype=np.int64).T
        covariance[np.ix_(rows, rows)] = known.covariance[np.ix_(columns, columns)]
    return covariance
