"""Uncertainty of the mirrors' planes (individual, common, relative), and descriptions of the weakest directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    grid_points,
    project_points,
    uncertainty_of,
    views_of,
    worst_sigmas,
)
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

MAX_MOTIONS = 3
SUFFICIENT_FRACTION = 0.9
"""Fraction of a direction at which no further motions are added to its description."""
MIN_FRACTION = 0.02
"""Minimum fraction that a further motion must add."""


@dataclass(frozen=True)
class MirrorUncertainty:
    """Standard deviations of the mirrors' planes.

    Attributes
    ----------
    normal_deg
        Of each normal (m,), along its worst direction.
    distance_mm
        Of each mirror's distance (m,) from the pupil.
    common_rotation_deg
        Of the rotation (3,) of all mirrors as one body about the rig's axes, through the centroid of the mirrors.
    common_shift_mm
        Of the shift (3,) of all mirrors along these axes.
    relative_normal_deg, relative_distance_mm
        Of each mirror (m,) after removing the common motion.
    """

    normal_deg: FloatArray
    distance_mm: FloatArray
    common_rotation_deg: FloatArray
    common_shift_mm: FloatArray
    relative_normal_deg: FloatArray
    relative_distance_mm: FloatArray


def rigid_motion_derivatives(layout: Layout) -> FloatArray:
    """Derivatives (3 m, 6) of the virtual centres for a motion of all mirrors as one body, mm per rad and mm per mm.

    Columns 0 to 2 rotate about the rig's axes through the centroid of the mirrors, columns 3 to 5 shift along them.
    Points p of a plane n.p = -d go to p + w x (p - o) + s, so dn = w x n and dd = w.(o x n) - n.s; c = -2 d n.
    """
    centroid = np.mean([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors], axis=0)
    motions = np.zeros((3 * len(layout.mirrors), 6))
    for m, mirror in enumerate(layout.mirrors):
        n, d = mirror.normal_in_rig, mirror.distance_mm
        for k, axis in enumerate(np.eye(3)):
            d_rotation = axis @ np.cross(centroid, n) * n + d * np.cross(axis, n)
            motions[3 * m : 3 * m + 3, k] = -2.0 * d_rotation
            motions[3 * m : 3 * m + 3, 3 + k] = 2.0 * (n @ axis) * n
    return motions


def mirror_covariance(uncertainty: Uncertainty) -> FloatArray:
    """Covariance (3 m, 3 m) of the virtual centres, mm^2."""
    rows = [
        index
        for index, name in enumerate(uncertainty.parameters)
        if name.startswith("mirror ") and name.endswith("_mm")
    ]
    return uncertainty.covariance[np.ix_(rows, rows)]


def normal_and_distance_sigmas(virtual_centres: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Worst sigmas (m,) of normals, rad, and sigmas (m,) of distances, mm, for centres (m, 3) and their covariance.

    With c = -2 d n, a displacement of c perpendicular to n tilts n by its ratio to |c|; half of one along n changes d.
    """
    tilts, distances = [], []
    for m, centre in enumerate(virtual_centres):
        block = covariance[3 * m : 3 * m + 3, 3 * m : 3 * m + 3]
        length = float(np.linalg.norm(centre))
        unit = centre / length
        tangential = (np.eye(3) - np.outer(unit, unit)) / length
        tilts.append(worst_sigmas(tangential @ block @ tangential.T))
        distances.append(np.sqrt(max(float(unit @ block @ unit), 0.0)) / 2.0)
    return np.array(tilts), np.array(distances)


def common_motion(layout: Layout, *, lever_mm: float) -> FloatArray:
    """The map (6, 3 m) from displacements of all virtual centres to the best-fitting rigid motion.

    Least squares over all mirrors; a tilt is weighted by its displacement at `lever_mm`, and a shift along the normal
    by 1. The solution has minimum norm if it is not unique.
    """
    weights = np.zeros((3 * len(layout.mirrors),) * 2)
    for m, mirror in enumerate(layout.mirrors):
        normal_projection = np.outer(mirror.normal_in_rig, mirror.normal_in_rig)
        rows = slice(3 * m, 3 * m + 3)
        weights[rows, rows] = (
            lever_mm * (np.eye(3) - normal_projection) / (2.0 * mirror.distance_mm) + normal_projection / 2.0
        )
    # In mm at the lever arm, the six columns have similar size, so the cut-off of pinv is meaningful.
    scale = np.array([lever_mm] * 3 + [1.0] * 3)
    return np.asarray(
        np.linalg.pinv(weights @ rigid_motion_derivatives(layout) / scale, rcond=1e-6) @ weights / scale[:, None]
    )


def mirror_uncertainty(layout: Layout, *, lever_mm: float) -> MirrorUncertainty:
    """Return standard deviations of a calibrated layout's mirrors; `lever_mm` weights tilts as in `common_motion`."""
    covariance = mirror_covariance(uncertainty_of(layout))
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    normal, distance = normal_and_distance_sigmas(centres, covariance)
    common = common_motion(layout, lever_mm=lever_mm)
    common_sigmas = np.sqrt(np.maximum(np.diag(common @ covariance @ common.T), 0.0))
    relative = np.eye(len(covariance)) - rigid_motion_derivatives(layout) @ common
    relative_normal, relative_distance = normal_and_distance_sigmas(centres, relative @ covariance @ relative.T)
    return MirrorUncertainty(
        normal_deg=np.degrees(normal),
        distance_mm=distance,
        common_rotation_deg=np.degrees(common_sigmas[:3]),
        common_shift_mm=common_sigmas[3:],
        relative_normal_deg=np.degrees(relative_normal),
        relative_distance_mm=relative_distance,
    )


@dataclass(frozen=True)
class NamedMotion:
    """A motion with a name, as a change of parameters: `change` (g,) is for one `unit` of the motion."""

    name: str
    unit: str
    change: FloatArray


@dataclass(frozen=True)
class WeakDirection:
    """One principal direction of the covariance.

    Attributes
    ----------
    description
        Its description.
    sigmas
        Standard deviation in each motion of the description, as (name, value, unit).
    fraction
        Fraction (0 to 1) of the direction that these motions explain.
    separate_px
        Rms shift of the pixels of all views for one standard deviation, if each parameter acted alone.
    combined_px
        The actual rms shift: if much smaller than `separate_px`, the parameters compensate each other.
    """

    description: str
    sigmas: tuple[tuple[str, float, str], ...]
    fraction: float
    separate_px: float
    combined_px: float


def motions_of(layout: Layout) -> list[NamedMotion]:
    """Return the named motions that the layout's parameters allow, the simplest first."""
    parameters = _Parameters(uncertainty_of(layout).parameters)
    has_mirrors = "mirror 0 x_mm" in parameters.names
    motions = _common_motions(layout, parameters) if has_mirrors and len(layout.mirrors) > 1 else []
    motions += _camera_motions(layout.camera, parameters)
    if "sheet_mm" in parameters.names:
        motions.append(NamedMotion("thickness of the plates", "mm", parameters.change({"sheet_mm": 1.0})))
    for m in range(len(layout.mirrors) if has_mirrors else 0):
        motions += _mirror_motions(layout, m, parameters)
    return motions


@dataclass(frozen=True)
class _Parameters:
    """Parameter names, and changes (g,) of the parameters."""

    names: tuple[str, ...]

    def change(self, parts: dict[str, float]) -> FloatArray:
        vector = np.zeros(len(self.names))
        for name, value in parts.items():
            vector[self.names.index(name)] = value
        return vector

    def centres(self, displacements: FloatArray) -> FloatArray:
        """The change that moves the virtual centres by (3 m,) mm."""
        rows = enumerate(displacements.reshape(-1, 3))
        return self.change({f"mirror {m} {axis}_mm": row[k] for m, row in rows for k, axis in enumerate("xyz")})


def _common_motions(layout: Layout, parameters: _Parameters) -> list[NamedMotion]:
    """Motions of all mirrors as one body, and away from the camera."""
    body = rigid_motion_derivatives(layout)
    rotations = [
        NamedMotion(f"all mirrors together about {axis}", "deg", parameters.centres(np.radians(1.0) * body[:, k]))
        for k, axis in enumerate("xyz")
    ]
    shifts = [
        NamedMotion(f"all mirrors together along {axis}", "mm", parameters.centres(body[:, 3 + k]))
        for k, axis in enumerate("xyz")
    ]
    outwards = np.concatenate([-2.0 * mirror.normal_in_rig for mirror in layout.mirrors])
    return [*rotations, *shifts, NamedMotion("all mirrors away from the camera", "mm", parameters.centres(outwards))]


def _camera_motions(camera: Camera, parameters: _Parameters) -> list[NamedMotion]:
    numbers = sorted(name for name in camera.lens.names if not name.startswith("field "))
    named = [
        ("focal length", "px", {"fx_px": 1.0, "fy_px": 1.0}),
        ("shape of a pixel", "px", {"fx_px": 0.5, "fy_px": -0.5}),
        ("principal point in x", "px", {"cx_px": 1.0}),
        ("principal point in y", "px", {"cy_px": 1.0}),
        *((f"lens distortion {name}", "", {name: 1.0}) for name in numbers),
    ]
    free = set(parameters.names)
    return [
        NamedMotion(description, unit, parameters.change(parts))
        for description, unit, parts in named
        if parts.keys() <= free
    ]


def _mirror_motions(layout: Layout, m: int, parameters: _Parameters) -> list[NamedMotion]:
    """Rotations of one mirror about the centroid of its outline, its shift along the normal, and its bends."""
    mirror, name, motions = layout.mirrors[m], layout.mirror_names[m], []
    x, y, n = mirror.rig_from_plane[:3, :3].T
    for axis, description in ((x, "about its x"), (y, "about its y")):
        displacement = np.zeros(3 * len(layout.mirrors))
        # With o the centroid of the outline: dd = w.(o x n), dn = w x n, c = -2 d n.
        o = mirror.outline_in_rig_mm.mean(axis=0)
        change = axis @ np.cross(o, n) * n + mirror.distance_mm * np.cross(axis, n)
        displacement[3 * m : 3 * m + 3] = -2.0 * np.radians(1.0) * change
        motions.append(NamedMotion(f"mirror {name} {description}", "deg", parameters.centres(displacement)))
    displacement = np.zeros(3 * len(layout.mirrors))
    displacement[3 * m : 3 * m + 3] = -2.0 * n
    motions.append(NamedMotion(f"mirror {name} along its normal", "mm", parameters.centres(displacement)))
    for axes, description in (("xx", "along its x"), ("yy", "along its y"), ("xy", "as a twist")):
        if (parameter := f"mirror {m} curvature_{axes}_per_m") in parameters.names:
            motions.append(
                NamedMotion(f"bend of mirror {name} {description}", "1/m", parameters.change({parameter: 1.0}))
            )
    return motions


def weak_directions(layout: Layout, *, range_mm: float, count: int = 3) -> tuple[WeakDirection, ...]:
    """Return the `count` least determined directions of a calibrated layout, weakest first.

    They are principal axes of the covariance in pixels: each parameter is scaled by the rms shift that it alone causes,
    over all views, at points `range_mm` away. A direction is described by orthogonal matching pursuit over
    `motions_of`.
    """
    derivatives = np.concatenate(
        [project_points(layout, view, grid_points(layout, view, range_mm)[1]).d_parameter for view in views_of(layout)]
    )
    derivatives = derivatives.reshape(-1, derivatives.shape[-1]) / np.sqrt(len(derivatives))
    scale = np.linalg.norm(derivatives, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)  # some parameters of a lens's field may have no effect in any view
    covariance = uncertainty_of(layout).covariance * np.outer(scale, scale)
    variances, axes = np.linalg.eigh(covariance)
    motions = motions_of(layout)
    directions = []
    for k in range(len(variances) - 1, max(len(variances) - 1 - count, -1), -1):
        sigma = float(np.sqrt(max(variances[k], 0.0)))
        combined = float(np.linalg.norm(derivatives @ (sigma * axes[:, k] / scale)))
        chosen, amounts, fraction = _matching_pursuit(axes[:, k], [motion.change * scale for motion in motions])
        parts = tuple(
            (motions[i].name, sigma * abs(float(amount)), motions[i].unit)
            for i, amount in zip(chosen, amounts, strict=True)
        )
        directions.append(WeakDirection(_description([name for name, _, _ in parts]), parts, fraction, sigma, combined))
    return tuple(directions)


def _matching_pursuit(axis: FloatArray, dictionary: Sequence[FloatArray]) -> tuple[list[int], FloatArray, float]:
    """Return dictionary entries that approximate a unit vector, their amounts, and the fraction they explain."""
    lengths = np.array([np.linalg.norm(entry) for entry in dictionary])
    units = np.array(dictionary) / lengths[:, None]
    chosen: list[int] = []
    amounts, fraction = np.zeros(0), 0.0
    while len(chosen) < MAX_MOTIONS and fraction < SUFFICIENT_FRACTION:
        best, best_amounts, best_fraction = -1, amounts, fraction
        for i in range(len(units)):
            if i in chosen:
                continue
            columns = units[[*chosen, i]].T
            fitted, *_ = np.linalg.lstsq(columns, axis, rcond=1e-6)
            fitted_fraction = 1.0 - float(np.sum((axis - columns @ fitted) ** 2))
            # A later, more specific motion must be better by more than rounding.
            if fitted_fraction > best_fraction + 1e-9:
                best, best_amounts, best_fraction = i, fitted, fitted_fraction
        if best < 0 or (chosen and best_fraction - fraction < MIN_FRACTION):
            break
        chosen.append(best)
        amounts, fraction = best_amounts, best_fraction
    return chosen, amounts / lengths[chosen], fraction


def _description(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} against {' and '.join(names[1:])}"
