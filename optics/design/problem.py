"""The design of a spec as a nonlinear program: unknown mirrors, what is asked of them, what makes one better."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import prod

import casadi as ca
import numpy as np

from optics.design import constraints
from optics.design.metrics import sensor_polygon
from optics.design.program import Expression, Program
from optics.design.seeds import ellipsoid_centres, tiles
from optics.spec import DesignSpec
from optics.values import FloatArray

REFERENCE_GRID_ERROR = 0.25
"""A grid error that weighs as much as a sensor without any overlap; about that of the faceted parabola."""

LEAST_EFFICIENCY = 0.05
"""A layout whose views share less of the sensor than this, at any depth, is no answer."""

TIE_BREAK = 1e-3
"""Weight of what decides where the objective leaves a choice: corners that nothing holds move outward."""

CENTRE_REACH = 0.6
LEAST_GRID_SPACING = 0.05


@dataclass(frozen=True)
class Start:
    """Where the search starts, in units of the scale: mirrors of a faceted ellipsoid, row by row.

    Virtual centres (n, 3), corners (n, 4, 2) and chief rays (n, 3) with z = 1 in normalized coordinates. `crowded`
    where tiles as far apart as the spec asks would leave little of the sensor.
    """

    centres: FloatArray
    corners: FloatArray
    crowded: bool

    @cached_property
    def rays(self) -> FloatArray:
        return np.column_stack([self.corners.mean(axis=1), np.ones(len(self.corners))])

    @cached_property
    def middles(self) -> FloatArray:
        """Where chief rays meet the mirrors (n, 3)."""
        reach = 0.5 * (self.centres**2).sum(axis=1) / (self.rays * self.centres).sum(axis=1)
        return self.rays * reach[:, None]

    @cached_property
    def half_tile(self) -> FloatArray:
        """Half the size (2,) of a sub-image."""
        return (self.corners[0, 2] - self.corners[0, 0]) / 2.0


@dataclass(frozen=True)
class Problem:
    """The program of a spec, its objective, and what is to be read from a solution: centres (n, 3), corners (4n, 2)."""

    program: Program
    objective: Expression
    centres: Expression
    corners: Expression


def start_of(spec: DesignSpec) -> Start:
    """The faceted ellipsoid whose chief rays meet at the harmonic mean of the depths."""
    wanted_gap = 1.3 * spec.spacing_mm / spec.scale_mm
    whole = tiles(spec, 0.0)[0, 0]
    most = 0.5 * float((whole[2] - whole[0]).min())
    corners = tiles(spec, min(wanted_gap, most)).reshape(-1, 4, 2)
    target = len(spec.depths_mm) / sum(spec.scale_mm / depth for depth in spec.depths_mm)
    return Start(ellipsoid_centres(corners.mean(axis=1), 1.0, target), corners, crowded=wanted_gap > most)


def squared_grid_error(centres: list[Expression], rows: int, cols: int) -> tuple[Expression, list[Expression]]:
    """Squared grid error of virtual centres (row by row) to their best-fitting grid, and that grid's spacings.

    Linear regression on the indices is the best fit; the error is relative to the geometric mean of the spacings.
    """
    across = np.tile(np.arange(cols) - (cols - 1) / 2.0, rows)
    upwards = np.repeat((rows - 1) / 2.0 - np.arange(rows), cols)
    mean: Expression = sum(centres, start=ca.SX.zeros(3)) / len(centres)
    residual = ca.horzcat(*(centre - mean for centre in centres)).T
    spacings = []
    for axis, steps in ((0, across), (2, upwards)):
        if steps.any():
            spacing = ca.dot(residual[:, axis], ca.DM(steps)) / float(steps @ steps)
            residual[:, axis] -= spacing * ca.DM(steps)
            spacings.append(spacing)
    return ca.sumsqr(residual) / len(centres) / prod(spacings) ** (2.0 / len(spacings)), spacings


def _inner(count: int) -> list[int]:
    return [count // 2] if count % 2 else [count // 2 - 1, count // 2]


def _add_mirrors(program: Program, spec: DesignSpec, start: Start) -> list[constraints.MirrorUnknown]:
    bounds = np.array(sensor_polygon(spec.camera).bounds).reshape(2, 2)
    back = (1.0 if spec.surface == "first" else -1.0) * spec.thickness_mm / spec.scale_mm
    mirrors = []
    for centre, corners in zip(start.centres, start.corners, strict=True):
        mirror = constraints.add_mirror(program, centre, corners, reach=CENTRE_REACH, bounds=bounds, back=back)
        constraints.keep_on_sensor(program, spec.camera, mirror)
        constraints.keep_nearer_than(program, mirror, min(spec.depths_mm) / spec.scale_mm)
        mirrors.append(mirror)
    # The innermost mirrors, on average, fold the optical axis by 90 degrees at the height asked for; nothing else
    # fixes the size of the whole or its direction.
    inner = [t * spec.cols + s for t in _inner(spec.rows) for s in _inner(spec.cols)]
    program.require_zero(sum(mirrors[k].centre for k in inner) / len(inner) - ca.DM([0.0, -1.0, 1.0]))
    return mirrors


def neighbours(spec: DesignSpec) -> list[tuple[int, int]]:
    """Pairs of mirrors that are next to each other in the grid, also diagonally."""
    return [
        (i, j)
        for i, j in combinations(range(spec.rows * spec.cols), 2)
        if max(abs(i // spec.cols - j // spec.cols), abs(i % spec.cols - j % spec.cols)) == 1
    ]


def _keep_apart(
    program: Program, start: Start, mirrors: list[constraints.MirrorUnknown], i: int, j: int, gap: float
) -> None:
    middles = start.middles[i], start.middles[j]
    constraints.keep_sheets_apart(program, mirrors[i], mirrors[j], gap, middles=middles)
    for light, other in ((i, j), (j, i)):
        constraints.keep_light_free(
            program,
            mirrors[light],
            mirrors[other],
            gap,
            start_centre=start.centres[light],
            start_rays=(start.rays[light], start.rays[other]),
        )


def _add_efficiency(
    program: Program, spec: DesignSpec, start: Start, mirrors: list[constraints.MirrorUnknown], depth: float
) -> Expression:
    """Part of the sensor that sees a region which all mirrors show whole, at a depth in scales."""
    seen = constraints.add_overlap(
        program,
        mirrors,
        depth,
        aim=np.array([0.0, 1.0]),
        half_size=0.6 * start.half_tile,
    )
    per_edge = 3 if spec.camera.distortion.any() else 1
    area_px = sum(
        constraints.polygon_area([constraints.pixels(spec.camera, p) for p in constraints.subdivided(view, per_edge)])
        for view in seen
    )
    return area_px / (spec.camera.width_px * spec.camera.height_px)


def problem_of(spec: DesignSpec, start: Start, pairs: Iterable[tuple[int, int]]) -> Problem:
    """The program of a spec; all lengths in units of `scale_mm`.

    `pairs` of mirrors are kept out of each other's way; their unknowns come last, so that a solution still fits when
    more pairs are appended. The objective is tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel
    efficiency averaged over the depths).
    """
    program = Program()
    mirrors = _add_mirrors(program, spec, start)
    efficiencies = [_add_efficiency(program, spec, start, mirrors, d / spec.scale_mm) for d in spec.depths_mm]
    for efficiency in efficiencies:
        program.require(efficiency - LEAST_EFFICIENCY)
    error, spacings = squared_grid_error([mirror.centre for mirror in mirrors], spec.rows, spec.cols)
    for spacing in spacings:
        program.require(spacing - LEAST_GRID_SPACING)

    for i, j in pairs:
        _keep_apart(program, start, mirrors, i, j, spec.spacing_mm / spec.scale_mm)

    wasted = 1.0 - sum(efficiencies) / len(efficiencies)
    used = sum(constraints.polygon_area(mirror.corners) for mirror in mirrors) / (4.0 * prod(start.half_tile))
    objective = spec.tradeoff * error / REFERENCE_GRID_ERROR**2 + (1.0 - spec.tradeoff) * wasted
    return Problem(
        program,
        objective + TIE_BREAK * (wasted - used / len(mirrors)),
        ca.horzcat(*(mirror.centre for mirror in mirrors)).T,
        ca.horzcat(*(corner for mirror in mirrors for corner in mirror.corners)).T,
    )
