"""The design of a spec as a nonlinear program: unknown mirrors, constraints on them and the objective."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.nonlinear_program import Program, Solver
from mirrorcam.optics.design.program.seeds import Seed, sensor_bounds, tile_places
from mirrorcam.optics.design.program.terms import Indices
from mirrorcam.optics.geometry.arrangement import Arrangement
from mirrorcam.optics.geometry.design_spec import FIRST_FOLD_DEG, FOLD_DEG, DesignSpec

REFERENCE_GRID_ERROR = 0.25
"""A grid error that weighs as much as a sensor without any overlap; about that of the faceted parabola."""

LEAST_EFFICIENCY = 0.02
"""A layout whose views share less of the sensor than this, at any depth, is refused."""

TIE_BREAK = 1e-3
"""Weight that decides where the objective leaves a choice: corners that no constraint holds move outward."""

CENTRE_REACH = 0.6

NEAR_TILES = 1e-6
"""Difference of the places of two tiles that is none."""

SLACK_WEIGHTS = {
    "spacing": 1.0,
    "seen gap": 1.0,
    "occlusion": 3.0,
    "body": 3.0,
    "depth": 1.0,
    "overlap": 10.0,
    "size": 1.0,
}
"""Cost, in a search for feasibility, of missing a limit by one scale (overlap: by a whole sub-image)."""

PairKind = Literal["seen", "gap", "in", "out"]
MirrorUnknowns = tuple[Indices, Indices]


@dataclass(frozen=True, order=True)
class PairConstraint:
    """A constraint on two mirrors: a gap between them, in the image ("seen") or in space ("gap"), or free light.

    "in" and "out" keep the second out of the light to and from the first.
    """

    kind: PairKind
    first: int
    second: int


@dataclass(frozen=True)
class Problem:
    """The program of a spec; where in its unknowns the fold (1), centres (n, 3) and corners (n, sides, 2) are."""

    solver: Solver
    fold: Indices
    centres: Indices
    corners: Indices

    def solution(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual centres (n, 3) in view axes, in scales, and corners (n, sides, 2), normalized."""
        return values[self.centres], values[self.corners]


def neighbour_pairs(arrangement: Arrangement) -> tuple[PairConstraint, ...]:
    """The constraints on neighbours that every design starts with; others follow where a solution violates them.

    Neighbours are those whose tiles touch in the seed. Gaps and free light in both directions; across the diagonal,
    beams leave side by side without being kept apart.
    """
    places, pairs = tile_places(arrangement), []
    for i, j in combinations(range(len(places)), 2):
        across, down = np.abs(places[j] - places[i]) + NEAR_TILES
        if max(down, across) > 1.0 + 2.0 * NEAR_TILES:
            continue
        diagonal = min(down, across) >= 1.0
        pairs += [PairConstraint("seen", i, j), PairConstraint("gap", i, j)]
        legs: tuple[PairKind, ...] = ("in",) if diagonal else ("in", "out")
        pairs += [PairConstraint(leg, *ordered) for leg in legs for ordered in ((i, j), (j, i))]
    return tuple(pairs)


@dataclass(frozen=True)
class _Common:
    """What many terms take, in scales: place of the fold, `optics`, intrinsics (9) and sensor px (2) in `lens`."""

    kind: Kind
    fold: Indices
    optics: list[float]
    lens: list[ArrayLike]
    tile_area: float

    @classmethod
    def of(cls, spec: DesignSpec, seed: Seed, fold: Indices) -> Self:
        return cls(
            kind=Kind.of(spec),
            fold=fold,
            optics=[
                spec.thickness_mm / spec.scale_mm,
                spec.refractive_index,
                spec.camera.pupil.radius_mm / spec.scale_mm,
                spec.scale_mm / spec.camera.focus_mm,
            ],
            lens=[spec.camera.intrinsics, [spec.camera.width_px, spec.camera.height_px]],
            tile_area=4.0 * float(np.prod(seed.half_tile)),
        )


def problem_of(spec: DesignSpec, seed: Seed, pairs: tuple[PairConstraint, ...]) -> Problem:
    """The program of a spec, started from a seed, in view axes; all lengths in units of `scale_mm`.

    The objective is tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency averaged over the
    depths).

    Parameters
    ----------
    spec : what is asked for.
    seed : mirrors to start from.
    pairs : constraints on pairs of mirrors. Their unknowns come last, so that a solution still fits when more are
        appended.
    """
    program = Program()
    fold = program.unknown(*np.deg2rad(_start_and_range_deg(spec)))
    common = _Common.of(spec, seed, fold)
    mirrors = _add_mirrors(program, spec, seed, common)
    _add_grid(program, spec, fold, [centre for centre, _ in mirrors])
    for depth_mm in spec.depths_mm:
        _add_region(program, spec, seed, common, mirrors, depth_mm / spec.scale_mm)
    _add_body(program, spec, seed, common, mirrors)
    _add_pairs(program, spec, seed, common, mirrors, pairs)
    return Problem(
        solver=Solver(program, SLACK_WEIGHTS),
        fold=fold,
        centres=np.array([centre for centre, _ in mirrors]),
        corners=np.array([corners for _, corners in mirrors]).reshape(len(mirrors), spec.sides, 2),
    )


def _add_mirrors(program: Program, spec: DesignSpec, seed: Seed, common: _Common) -> list[MirrorUnknowns]:
    """The mirrors, in the order of the layout; returns their unknowns, virtual centre and corners."""
    low, high = sensor_bounds(spec.camera)
    centres = [program.unknown(centre, centre - CENTRE_REACH, centre + CENTRE_REACH) for centre in seed.centres]
    corners = [
        program.unknown(polygon.ravel(), np.tile(low, spec.sides), np.tile(high, spec.sides))
        for polygon in seed.corners
    ]
    mirrors = list(zip(centres, corners, strict=True))
    cut = [spec.min_edge_mm / spec.scale_mm, spec.min_area_mm2 / spec.scale_mm**2]
    nearest, reward = min(spec.depths_mm) / spec.scale_mm, TIE_BREAK / len(mirrors)
    for mirror in mirrors:
        given: list[ArrayLike] = [common.optics, *common.lens, cut, nearest, common.tile_area, reward]
        program.add(constraints.mirror_term(common.kind), [common.fold, *mirror], given)
    return mirrors


def _add_grid(program: Program, spec: DesignSpec, fold: Indices, centres: list[Indices]) -> None:
    """The arrangement of virtual centres, its place and its objective."""
    # The innermost mirrors, on average, turn the optical axis to the view axis at the height asked for; nothing else
    # fixes the size of the whole or its direction.
    inner = [centres[index] for index in spec.arrangement.inner]
    program.add(constraints.mean_term(len(inner)), [fold, *inner])
    program.add(constraints.grid_term(spec.arrangement), centres, [spec.tradeoff / REFERENCE_GRID_ERROR**2])


def _add_region(
    program: Program, spec: DesignSpec, seed: Seed, common: _Common, mirrors: list[MirrorUnknowns], depth: float
) -> None:
    """An unknown region at a depth (in scales) that all views show, and the objective of their pixel efficiency."""
    half_size = 0.6 * seed.half_tile
    middle = program.unknown([0.0, 0.0])
    region = program.unknown((constraints.region_directions() * half_size).ravel())
    program.add(constraints.region_term(), [middle, region], [half_size])
    weight = (1.0 - spec.tradeoff + TIE_BREAK) / len(spec.depths_mm)
    least = LEAST_EFFICIENCY / len(mirrors)
    for mirror in mirrors:
        given: list[ArrayLike] = [common.optics, *common.lens, depth, common.tile_area, weight, least]
        program.add(constraints.view_term(common.kind), [common.fold, *mirror, region], given)


def _start_and_range_deg(spec: DesignSpec) -> tuple[float, float, float]:
    """The fold to start with, the least and the greatest."""
    if spec.fold_deg == "auto":
        return FIRST_FOLD_DEG, FOLD_DEG.least, FOLD_DEG.most
    return spec.fold_deg, spec.fold_deg, spec.fold_deg


def _add_body(program: Program, spec: DesignSpec, seed: Seed, common: _Common, mirrors: list[MirrorUnknowns]) -> None:
    """The box around the camera's body, out of the reach of mirrors and of their light, by an unknown plane each."""
    box = (spec.kept_free_in_rig_mm / spec.scale_mm).ravel()
    if box.size == 0:
        return
    for mirror, middle in zip(mirrors, seed.middles(spec.view_from_rig), strict=True):
        sideways = -_unit(middle * [1.0, 1.0, 0.0])
        for term, normal in (
            (constraints.body_gap_term(common.kind), -_unit(middle)),
            (constraints.body_light_term(common.kind), sideways),
        ):
            plane = program.unknown([*normal, normal @ middle / 2.0], *_plane_range(3))
            program.add(term, [common.fold, *mirror, plane], [common.optics, box])


def _plane_range(size: int) -> tuple[FloatArray, FloatArray]:
    """Least and greatest values of the normal (size) of a plane or line, and of its offset."""
    reach = np.array([*np.ones(size), np.inf])
    return -reach, reach


def _add_pairs(
    program: Program,
    spec: DesignSpec,
    seed: Seed,
    common: _Common,
    mirrors: list[MirrorUnknowns],
    pairs: tuple[PairConstraint, ...],
) -> None:
    kind, optics = common.kind, common.optics
    terms = {
        "seen": constraints.seen_gap_term(kind.sides),
        "gap": constraints.gap_term(kind),
        "in": constraints.incoming_term(kind),
        "out": constraints.outgoing_term(kind),
    }
    gap, seen_gap = spec.spacing_mm / spec.scale_mm, spec.seen_gap_mm / spec.scale_mm
    given: dict[PairKind, list[ArrayLike]] = {"seen": [seen_gap], "gap": [optics, gap], "in": [optics], "out": [optics]}
    middles = seed.middles(spec.view_from_rig)
    for pair in pairs:
        plane = _first_plane(pair, seed, middles)
        unknown = program.unknown(plane, *_plane_range(plane.size - 1))
        first, second = mirrors[pair.first], mirrors[pair.second]
        parts = [first[1], second[1]] if pair.kind == "seen" else [common.fold, *first, *second]
        program.add(terms[pair.kind], [*parts, unknown], given[pair.kind])


def _first_plane(pair: PairConstraint, seed: Seed, middles: FloatArray) -> FloatArray:
    """The plane (normal, offset) or line (3) that a pair starts with; chief rays meet their mirrors at `middles`."""
    if pair.kind == "seen":
        p, q = seed.chief[pair.first], seed.chief[pair.second]
        across = _unit(q - p)
        return np.array([*across, -across @ (p + q) / 2.0])
    a, b, centre = middles[pair.first], middles[pair.second], seed.centres[pair.first]
    if pair.kind == "gap":
        normal = _unit(b - a)
        return np.array([*normal, normal @ (a + b) / 2.0])
    between = _unit(_unit(b) - _unit(a))
    if pair.kind == "in":
        return np.array([*between, 0.0])
    turned = between - 2.0 * (between @ centre) / (centre @ centre) * centre
    return np.array([*turned, turned @ centre])


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
