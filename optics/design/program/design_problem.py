"""The design of a spec as a nonlinear program: unknown mirrors, what is asked of them, what makes one better."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.constraints import Kind
from mirrorcam.optics.design.program.nonlinear_program import Program, Solver
from mirrorcam.optics.design.program.seeds import Seed, sensor_bounds
from mirrorcam.optics.design.program.terms import Indices
from mirrorcam.optics.geometry.design_spec import DesignSpec

REFERENCE_GRID_ERROR = 0.25
"""A grid error that weighs as much as a sensor without any overlap; about that of the faceted parabola."""

LEAST_EFFICIENCY = 0.02
"""A layout whose views share less of the sensor than this, at any depth, is no answer."""

TIE_BREAK = 1e-3
"""Weight of what decides where the objective leaves a choice: corners that nothing holds move outward."""

CENTRE_REACH = 0.6

SLACK_WEIGHTS = {"spacing": 1.0, "seen gap": 1.0, "occlusion": 3.0, "depth": 1.0, "overlap": 10.0, "size": 1.0}
"""What it costs, in a search for feasibility, to miss a limit by one scale (overlap: by a whole sub-image)."""

Way = Literal["seen", "gap", "in", "out"]


@dataclass(frozen=True, order=True)
class Keep:
    """What a pair of mirrors keeps: a gap between them, as the camera sees it or in space, or free light.

    "in" and "out" keep the second out of the light to and from the first.
    """

    way: Way
    first: int
    second: int


@dataclass(frozen=True)
class Problem:
    """The program of a spec and where in its unknowns the mirrors are: centres (n, 3), corners (n, sides, 2)."""

    solver: Solver
    centres: Indices
    corners: Indices

    def solution(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual centres (n, 3) in view axes, in scales, and corners (n, sides, 2), normalized."""
        return values[self.centres], values[self.corners]


def usual_keeps(rows: int, cols: int) -> tuple[Keep, ...]:
    """What mirrors next to each other keep as a rule; the rest is asked for where it turns out to matter.

    Gaps and free ways for light to each; across the diagonal, beams leave side by side without being kept apart.
    """
    keeps = []
    for i, j in combinations(range(rows * cols), 2):
        down, across = j // cols - i // cols, abs(i % cols - j % cols)
        if max(down, across) > 1:
            continue
        keeps += [Keep("seen", i, j), Keep("gap", i, j)]
        ways: tuple[Way, ...] = ("in",) if down and across else ("in", "out")
        keeps += [Keep(way, *pair) for way in ways for pair in ((i, j), (j, i))]
    return tuple(keeps)


def _inner(count: int) -> list[int]:
    return [count // 2] if count % 2 else [count // 2 - 1, count // 2]


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def problem_of(spec: DesignSpec, seed: Seed, keeps: tuple[Keep, ...]) -> Problem:
    """The program of a spec, started from a seed, in view axes; all lengths in units of `scale_mm`.

    Pairs of mirrors keep out of each other's way as `keeps` says; its unknowns come last, so that a solution still fits
    when more is appended. The objective is tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency
    averaged over the depths).
    """
    program = Program()
    kind = Kind(spec.sides, bool(spec.camera.distortion.any()), spec.is_second_surface)
    count, scale = spec.rows * spec.cols, spec.scale_mm
    depths = np.array(spec.depths_mm) / scale
    optics: list[float] = [*spec.view_from_rig[2, [2, 1]], spec.thickness_mm / scale, spec.refractive_index]
    lens: list[ArrayLike] = [spec.camera.intrinsics, [spec.camera.width_px, spec.camera.height_px]]
    tile_area = 4.0 * float(np.prod(seed.half_tile))
    cut = [spec.min_edge_mm / scale, spec.min_area_mm2 / scale**2]

    low, high = sensor_bounds(spec.camera)
    reach = CENTRE_REACH
    centres = [program.unknown(centre, centre - reach, centre + reach) for centre in seed.centres]
    corners = [
        program.unknown(polygon.ravel(), np.tile(low, spec.sides), np.tile(high, spec.sides))
        for polygon in seed.corners
    ]
    mirrors = list(zip(centres, corners, strict=True))
    for mirror in mirrors:
        program.add(
            constraints.mirror_term(kind), mirror, [optics, *lens, cut, depths.min(), tile_area, TIE_BREAK / count]
        )
    # The innermost mirrors, on average, turn the optical axis to the view axis at the height asked for; nothing else
    # fixes the size of the whole or its direction.
    inner = [centres[t * spec.cols + s] for t in _inner(spec.rows) for s in _inner(spec.cols)]
    axis = spec.view_from_rig[:, 2]
    program.add(constraints.mean_term(len(inner)), inner, [axis - [0.0, 0.0, 1.0]])
    program.add(constraints.grid_term(spec.rows, spec.cols), centres, [spec.tradeoff / REFERENCE_GRID_ERROR**2])
    weight = (1.0 - spec.tradeoff + TIE_BREAK) / len(depths)
    for depth in depths:
        half_size = 0.6 * seed.half_tile
        middle = program.unknown([0.0, 0.0])
        region = program.unknown((constraints.region_directions() * half_size).ravel())
        program.add(constraints.region_term(), [middle, region], [half_size])
        for mirror in mirrors:
            view: list[ArrayLike] = [optics, *lens, depth, axis[:2], tile_area, weight, LEAST_EFFICIENCY / count]
            program.add(constraints.view_term(kind), [*mirror, region], view)
    middles = seed.middles(spec.view_from_rig)
    planes = [_first_plane(keep, seed, middles) for keep in keeps]
    _add_keeps(program, kind, keeps, mirrors, planes, optics, spec.spacing_mm / scale, spec.seen_gap_mm / scale)
    return Problem(
        solver=Solver(program, SLACK_WEIGHTS),
        centres=np.array(centres),
        corners=np.array(corners).reshape(count, spec.sides, 2),
    )


def _first_plane(keep: Keep, seed: Seed, middles: FloatArray) -> FloatArray:
    """The plane (normal, offset) or line (3) that a pair starts with; chief rays meet their mirrors at `middles`."""
    if keep.way == "seen":
        p, q = seed.chief[keep.first], seed.chief[keep.second]
        across = _unit(q - p)
        return np.array([*across, -across @ (p + q) / 2.0])
    a, b, centre = middles[keep.first], middles[keep.second], seed.centres[keep.first]
    if keep.way == "gap":
        normal = _unit(b - a)
        return np.array([*normal, normal @ (a + b) / 2.0])
    between = _unit(_unit(b) - _unit(a))
    if keep.way == "in":
        return np.array([*between, 0.0])
    turned = between - 2.0 * (between @ centre) / (centre @ centre) * centre
    return np.array([*turned, turned @ centre])


def _add_keeps(
    program: Program,
    kind: Kind,
    keeps: tuple[Keep, ...],
    mirrors: list[tuple[Indices, Indices]],
    planes: list[FloatArray],
    optics: list[float],
    gap: float,
    seen_gap: float,
) -> None:
    terms = {
        "seen": constraints.seen_gap_term(kind.sides),
        "gap": constraints.gap_term(kind),
        "in": constraints.incoming_term(kind),
        "out": constraints.outgoing_term(kind),
    }
    given: dict[Way, list[ArrayLike]] = {"seen": [seen_gap], "gap": [optics, gap], "in": [optics], "out": [optics]}
    for keep, plane in zip(keeps, planes, strict=True):
        reach = np.array([*np.ones(plane.size - 1), np.inf])
        unknown = program.unknown(plane, -reach, reach)
        first, second = mirrors[keep.first], mirrors[keep.second]
        bodies = [first[1], second[1]] if keep.way == "seen" else [*first, *second]
        program.add(terms[keep.way], [*bodies, unknown], given[keep.way])
