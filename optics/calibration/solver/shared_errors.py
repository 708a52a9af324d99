"""Errors that all corners of a view share, in the covariance of a solution.

Noise averages out over corners and frames; what is wrong with all corners of a view alike does not. In second-surface
mirrors that is what ghost images leave: they move edges by some hundredths of a pixel, of which a few percent remain
however well they are modelled. No residual shows it, as mirrors and camera follow it.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.normal_equations import (
    Chunk,
    Grouped,
    Places,
    columns_of,
    normal_equations,
)
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Estimate

SHARED_PX = 0.0005
"""Standard deviation of what the corners of a second-surface mirror share: of a shift along each axis, and of what
grows along each axis, at its root mean square over the corners."""
FIELDS = 6
"""Shared errors of a view: of x and of y, a shift, and what grows along x and along y."""


def shared_covariance(estimate: Estimate, observations: Observations, model: Model) -> FloatArray:
    """Covariance (g, g) of the free globals by errors that corners share.

    Parameters
    ----------
    estimate
        The minimum of the sum of squares.
    observations
        The corners that it was fitted to.
    model
        What is free.
    """
    mirrors = len(estimate.virtual_centres_in_rig_mm)
    places = Places.of(model, mirrors)
    plates = np.flatnonzero(estimate.thickness_mm > 0.0)
    if not places.size or not np.isin(observations.view, plates).any():
        return np.zeros((places.size, places.size))
    grouped = Grouped.of(observations, model)
    matrix, solved = normal_equations(estimate, grouped, model).reduced(0.0)
    corners = np.ascontiguousarray(model.board.shaped(estimate.shape).T)
    middles, sizes = _extents(observations, mirrors)
    right = np.zeros((places.size, mirrors, FIELDS))
    for chunk in grouped.chunks:
        if chunk.direct:
            continue
        columns = columns_of(estimate, chunk, model, corners)
        fields = _fields((chunk.pixels - middles[chunk.view].T) / sizes[chunk.view].T) * chunk.per_sigma
        for place, mirror, frame, start, stop in _groups(chunk, places):
            if estimate.thickness_mm[mirror] > 0.0:
                sums = np.einsum("cxn,fxn->cf", columns[:, :, start:stop], fields[:, :, start:stop])
                own = solved.shape[1]
                right[:, mirror] -= solved[frame, :, :-1].T @ sums[:own]
                right[place, mirror] += sums[own + 1 :]
    moved = SHARED_PX * cho_solve(cho_factor(matrix), right.reshape(places.size, mirrors * FIELDS))
    return np.asarray(moved @ moved.T)


def _groups(chunk: Chunk, places: Places) -> list[tuple[FloatArray, int, int, int, int]]:
    """Places among the globals, mirror, frame, first and last row of the groups of a chunk."""
    ends = zip(chunk.edges[:-1], chunk.edges[1:], strict=True)
    at = places.of_groups(chunk.group_view)
    return [
        (place, mirror, frame, start, stop)
        for place, mirror, frame, (start, stop) in zip(
            at, chunk.group_view.tolist(), chunk.group_frame.tolist(), ends, strict=True
        )
    ]


def _extents(observations: Observations, mirrors: int) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation (mirrors, 2) of the pixels of each mirror's corners; 0 and 1 where it shows none."""
    means, deviations = np.zeros((mirrors, 2)), np.ones((mirrors, 2))
    for mirror in range(mirrors):
        pixels = observations.pixels[observations.view == mirror]
        if len(pixels):
            means[mirror], deviations[mirror] = pixels.mean(axis=0), np.maximum(pixels.std(axis=0), 1.0)
    return means, deviations


def _fields(at: FloatArray) -> FloatArray:
    """Shared errors (f, 2, n) of corners at places (2, n) in their view, of size 1."""
    one, none = np.ones(at.shape[1]), np.zeros(at.shape[1])
    return np.stack([pair for field in (one, *at) for pair in (np.stack([field, none]), np.stack([none, field]))])
