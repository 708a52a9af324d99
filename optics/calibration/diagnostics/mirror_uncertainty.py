"""Uncertainty of the mirrors' planes: of each alone, of all together, and of each relative to the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import uncertainty_of, worst_sigmas
from mirrorcam.optics.geometry.layout import Layout, Uncertainty


@dataclass(frozen=True)
class MirrorUncertainty:
    """Standard deviations of the mirrors' planes.

    Attributes
    ----------
    normal_deg
        Of each normal (m,), along its worst direction.
    distance_mm
        Of each distance from the pupil (m,).
    common_turn_deg
        Of the rotation (3,) of all mirrors as one body about the rig's x, y and z through the middle of the mirrors.
    common_shift_mm
        Of their shift (3,) along these axes.
    relative_normal_deg, relative_distance_mm
        Of each mirror (m,) without the common motion.
    """

    normal_deg: FloatArray
    distance_mm: FloatArray
    common_turn_deg: FloatArray
    common_shift_mm: FloatArray
    relative_normal_deg: FloatArray
    relative_distance_mm: FloatArray


def rigid_motions(layout: Layout) -> FloatArray:
    """Derivatives (3 m, 6) of the virtual centres by a motion of all mirrors as one body, mm per rad and mm per mm.

    The rotation (columns 0 to 2) is about the rig's axes through the middle of the mirrors, the shift (3 to 5) along
    them. Points p of a plane n.p = -d go to p + w x (p - o) + s, so that dn = w x n and dd = w.(o x n) - n.s;
    c = -2 d n.
    """
    middle = np.mean([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors], axis=0)
    motions = np.zeros((3 * len(layout.mirrors), 6))
    for m, mirror in enumerate(layout.mirrors):
        n, d = mirror.normal_in_rig, mirror.distance_mm
        for k, axis in enumerate(np.eye(3)):
            by_turn = axis @ np.cross(middle, n) * n + d * np.cross(axis, n)
            motions[3 * m : 3 * m + 3, k] = -2.0 * by_turn
            motions[3 * m : 3 * m + 3, 3 + k] = 2.0 * (n @ axis) * n
    return motions


def mirror_covariance(known: Uncertainty) -> FloatArray:
    """Covariance (3 m, 3 m) of the virtual centres, mm^2."""
    rows = [place for place, name in enumerate(known.parameters) if name.startswith("mirror ") and name.endswith("_mm")]
    return known.covariance[np.ix_(rows, rows)]


def normal_and_distance_sigmas(virtual_centres: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Worst sigmas of normals (m,) rad and sigmas of distances (m,) mm, from centres (m, 3) and covariance (3 m, 3 m).

    With c = -2 d n, a change of c across n tilts n by it over |c|, and one along n changes d by half of it.
    """
    tilts, distances = [], []
    for m, centre in enumerate(virtual_centres):
        block = covariance[3 * m : 3 * m + 3, 3 * m : 3 * m + 3]
        length = float(np.linalg.norm(centre))
        unit = centre / length
        across = (np.eye(3) - np.outer(unit, unit)) / length
        tilts.append(worst_sigmas(across @ block @ across.T))
        distances.append(np.sqrt(max(float(unit @ block @ unit), 0.0)) / 2.0)
    return np.array(tilts), np.array(distances)


def common_motion(layout: Layout, *, lever_mm: float) -> FloatArray:
    """The map (6, 3 m) from changes of all virtual centres to the motion of one body that fits them best.

    Least squares over all mirrors, with a tilt weighted by its displacement at `lever_mm` and a shift along the normal
    by itself; the solution of minimum norm where it is not unique.
    """
    weights = np.zeros((3 * len(layout.mirrors),) * 2)
    for m, mirror in enumerate(layout.mirrors):
        along = np.outer(mirror.normal_in_rig, mirror.normal_in_rig)
        rows = slice(3 * m, 3 * m + 3)
        weights[rows, rows] = lever_mm * (np.eye(3) - along) / (2.0 * mirror.distance_mm) + along / 2.0
    # In units of mm at the lever the six columns are of one size, so that the cut-off of pinv means something.
    scale = np.array([lever_mm] * 3 + [1.0] * 3)
    return np.asarray(np.linalg.pinv(weights @ rigid_motions(layout) / scale, rcond=1e-6) @ weights / scale[:, None])


def mirror_uncertainty(layout: Layout, *, lever_mm: float) -> MirrorUncertainty:
    """The standard deviations of a calibrated layout's mirrors; tilts are weighted by their effect at `lever_mm`."""
    covariance = mirror_covariance(uncertainty_of(layout))
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    normal, distance = normal_and_distance_sigmas(centres, covariance)
    common = common_motion(layout, lever_mm=lever_mm)
    of_common = np.sqrt(np.maximum(np.diag(common @ covariance @ common.T), 0.0))
    rest = np.eye(len(covariance)) - rigid_motions(layout) @ common
    relative_normal, relative_distance = normal_and_distance_sigmas(centres, rest @ covariance @ rest.T)
    return MirrorUncertainty(
        normal_deg=np.degrees(normal),
        distance_mm=distance,
        common_turn_deg=np.degrees(of_common[:3]),
        common_shift_mm=of_common[3:],
        relative_normal_deg=np.degrees(relative_normal),
        relative_distance_mm=relative_distance,
    )
