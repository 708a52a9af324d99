"""The scale of a fit of labels from one known length, and the covariances in that scale.

With the length l of the fit and the known length L, lengths are multiplied by L / l. Errors of l and of what is scaled
are correlated: to first order, d(s X) = s (dX - X dl / l).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.labels.point_adjustment import PointCovariance, points_of
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.calibration.solver.residuals import Estimate

CAMERA = "camera"
"""The name that stands for the camera in a known length: a length from it to a mirror is the distance of its plane."""


@dataclass(frozen=True)
class KnownLength:
    """A distance in mm between two labels of a frame; or between "camera" and the plane of a view's mirror."""

    first: str
    second: str
    mm: float


@dataclass(frozen=True, eq=False)
class FittedLength:
    """The known length as the fit has it, and its derivatives.

    Attributes
    ----------
    length
        In the unit of the fit.
    by_global
        Derivatives (g,) by the free intrinsics and the virtual centres, through the points as well.
    points
        Points (q,) that it depends on, and
    by_point
        its derivatives (q, 3) by them.
    spread
        Standard deviation of the length between frames relative to the predicted one; 1 for a mirror's distance.
    """

    length: float
    by_global: FloatArray
    points: IntArray
    by_point: FloatArray
    spread: float = 1.0


@dataclass(frozen=True, eq=False)
class Scaled:
    """Virtual centres (m, 3) and points (p, 3) in mm, with covariances.

    `covariance` (g, g) is of the free intrinsics and the virtual centres, `point_covariances` (p, 3, 3) of the points.
    """

    centres: FloatArray
    points: FloatArray
    covariance: FloatArray
    point_covariances: FloatArray


def mirror_length(estimate: Estimate, intrinsics: int, mirror: int) -> FittedLength:
    """The distance of a mirror's plane from the camera."""
    centre = estimate.virtual_centres_in_rig_mm[mirror]
    length = float(np.linalg.norm(centre))
    by_global = np.zeros(intrinsics + estimate.virtual_centres_in_rig_mm.size)
    first = intrinsics + 3 * mirror
    by_global[first : first + 3] = centre / length / 2.0
    return FittedLength(length / 2.0, by_global, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


def label_length(
    estimate: Estimate, covariance: PointCovariance, pairs: IntArray, names: tuple[str, str]
) -> FittedLength:
    """The mean distance of pairs of points (q, 2), one pair for each frame, weighted by their own noise."""
    if not len(pairs):
        raise InputError(
            f"labels {names[0]!r} and {names[1]!r} are located in no frame together, expected a length between two "
            "labels that are seen in two views or more"
        )
    points = points_of(estimate)
    between = points[pairs[:, 1]] - points[pairs[:, 0]]
    lengths = np.linalg.norm(between, axis=1)
    units = between / lengths[:, None]
    noise = covariance.of_noise[pairs[:, 0]] + covariance.of_noise[pairs[:, 1]]
    variances = np.einsum("qi,qij,qj->q", units, noise, units)
    weights = 1.0 / variances / np.sum(1.0 / variances)
    mean = float(weights @ lengths)
    spread = 1.0
    if len(pairs) > 1:
        spread = float(np.sqrt(np.sum((lengths - mean) ** 2 / variances) / (len(pairs) - 1)))
    by_point = np.concatenate([-units * weights[:, None], units * weights[:, None]])
    numbers = np.concatenate([pairs[:, 0], pairs[:, 1]])
    by_global = np.einsum("qi,qig->g", by_point, covariance.by_global[numbers])
    return FittedLength(mean, by_global, numbers, by_point, spread)


def fitted_length(
    known: KnownLength,
    table: LabelTable,
    estimate: Estimate,
    covariance: PointCovariance,
    intrinsics: int,
    point_frame: IntArray,
    point_label: IntArray,
) -> FittedLength:
    """The known length in a fit whose points (p,) have these frames and labels; raises InputError for unknown names."""
    if CAMERA in (known.first, known.second):
        view = known.second if known.first == CAMERA else known.first
        if view not in table.views[1:]:
            raise InputError(f"known length to view {view!r}, expected a mirror: {', '.join(table.views[1:])}")
        return mirror_length(estimate, intrinsics, table.views.index(view) - 1)
    numbers = []
    for name in (known.first, known.second):
        if name not in table.labels:
            raise InputError(f"known length to label {name!r}, expected {CAMERA} or one of {', '.join(table.labels)}")
        numbers.append(table.labels.index(name))
    if numbers[0] == numbers[1]:
        raise InputError(f"known length from label {known.first!r} to itself, expected two labels")
    at = [{int(point_frame[p]): int(p) for p in np.flatnonzero(point_label == number)} for number in numbers]
    pairs = np.array([(at[0][frame], at[1][frame]) for frame in sorted(at[0].keys() & at[1].keys())], dtype=np.int64)
    return label_length(estimate, covariance, pairs.reshape(-1, 2), (known.first, known.second))


def scaled(
    estimate: Estimate, covariance: PointCovariance, intrinsics: int, length: FittedLength, known_mm: float
) -> Scaled:
    """Return the fit in mm. A length that varies between frames more than its noise has a larger standard deviation."""
    scale = known_mm / length.length
    relative = length.by_global / length.length
    centres, points = estimate.virtual_centres_in_rig_mm, points_of(estimate)
    # The length's own noise, from the labels of its points.
    own = np.einsum("qi,qij->qj", length.by_point, covariance.of_noise[length.points])
    widening = max(length.spread, 1.0) ** 2
    own_variance = widening * float(np.sum(own * length.by_point)) / length.length**2
    change = np.eye(len(relative))
    change[intrinsics:, intrinsics:] *= scale
    change[intrinsics:] -= scale * np.outer(centres.ravel(), relative)
    along = np.zeros(len(relative))
    along[intrinsics:] = scale * centres.ravel()
    of_global = change @ covariance.of_global @ change.T + own_variance * np.outer(along, along)
    by_global = covariance.by_global - points[:, :, None] * relative
    of_points = by_global @ covariance.of_global @ by_global.transpose(0, 2, 1) + covariance.of_noise
    of_points += own_variance * points[:, :, None] * points[:, None, :]
    # A point of the length itself: its noise is in both.
    cross = own[:, None, :] * points[length.points][:, :, None] / length.length
    np.add.at(of_points, length.points, -(cross + cross.transpose(0, 2, 1)))
    return Scaled(scale * centres, scale * points, of_global, scale**2 * of_points)
