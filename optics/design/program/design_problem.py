"""The design of a spec as a nonlinear program: unknown mirrors, constraints on them and the objective.

A relaxed program finds the smallest change of one parameter of a spec that meets all constraints. Its parameters are
interpolated linearly between two specs; the interpolation variable, the change, is an unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.draft import TIE_BREAK, Draft, tilts
from mirrorcam.optics.design.program.nonlinear_program import MAX_ITERATIONS, TOLERANCE, Program, Solver
from mirrorcam.optics.design.program.seeds import Seed
from mirrorcam.optics.design.program.separation import PairConstraint, add_body, add_pairs
from mirrorcam.optics.design.program.terms import ELASTIC, Indices, Term, TermBuilder
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.pupil import SHARP_VARIANCE_PX2

REFERENCE_GRID_ERROR = 0.25
"""Grid error that costs as much as a sensor without any overlap; about the error of the faceted parabola."""
MIN_EFFICIENCY = 0.02
"""Minimum pixel efficiency of an acceptable layout at any depth."""
SAMPLES = np.vstack([np.full(8, 0.125), 0.7 * np.eye(8)[::2] + 0.3 * 0.125])
"""Weights (5, 8) of a region's corners: the objective for depth is evaluated at its centre and near corners."""
MIN_TRADEOFF = 1e-3
"""Trade-off below which the limit on the grid error of a design for depth no longer grows."""
MIN_FRACTION_OF_OVERLAP = 0.99
"""Fraction of field of view and pixels of each view that a design for depth keeps of the design for overlap."""
SLACK_WEIGHTS = {
    "spacing": 1.0,
    "seen gap": 1.0,
    "occlusion": 3.0,
    "body": 3.0,
    "depth": 1.0,
    "overlap": 10.0,
    "size": 1.0,
}
"""Cost, in a search for feasibility, of a violation by one design scale (overlap: by one sub-image)."""
CHANGE_COST = 0.01
"""Weight of the squared change, small in comparison with any violation."""


@dataclass(frozen=True)
class OverlapDesign:
    """The design for overlap of a spec, as the reference for its design for depth.

    Attributes
    ----------
    fold : fold angle, radians.
    centres : virtual centres (n, 3) in view axes, in units of the design scale.
    fractions : fractions (depths, n) of the sensor's pixels that see the common region, by view.
    regions : corners (depths, 8, 2) of the regions, as unknowns of `constraints.region_term`.
    fields : fields of view (depths, 2) of the regions, see `constraints.field_of_view`.
    grid_error : grid error.
    """

    fold: float
    centres: FloatArray
    fractions: FloatArray
    regions: FloatArray
    fields: FloatArray
    grid_error: float


@dataclass(frozen=True)
class Problem:
    """The program of a spec, with the indices of its unknowns.

    Attributes
    ----------
    solver : the program's solver.
    fold : index (1,) of the fold angle.
    centres : indices (n, 3) of the virtual centres.
    corners : indices (n, sides, 2) of the sub-images' corners.
    sizes : indices (n, 2) of the sizes of rectangles; (0, 2) for free outlines.
    regions : indices (depths, 16) of the corners of the regions at the depths.
    """

    solver: Solver
    fold: Indices
    centres: Indices
    corners: Indices
    sizes: Indices
    regions: Indices

    def fields(self, spec: DesignSpec, values: FloatArray) -> FloatArray:
        """Fields of view (depths, 2) of the regions, see `constraints.field_of_view`."""
        centres = [ca.SX(centre) for centre in values[self.centres]]
        sizes = [
            constraints.field_of_view(ca.SX(values[region]), centres, depth_mm / spec.scale_mm)
            for region, depth_mm in zip(self.regions, spec.depths_mm, strict=True)
        ]
        return np.array([ca.evalf(size) for size in sizes]).reshape(-1, 2)

    def outlines(self, spec: DesignSpec, values: FloatArray) -> FloatArray:
        """Corners (depths, 8, 2) of the regions in view axes, in units of the design scale."""
        factor = 1.0 + np.array(spec.depths_mm)[:, None, None] / spec.scale_mm
        aim = [0.0, -np.sin(values[self.fold[0]])]
        return np.asarray(aim + values[self.regions].reshape(-1, constraints.REGION_CORNERS, 2) * factor)

    def solution(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Virtual centres (n, 3) in view axes, in units of the design scale, and normalized corners (n, sides, 2)."""
        return values[self.centres], values[self.corners]


def overlap_problem(
    spec: DesignSpec,
    seed: Seed,
    pairs: tuple[PairConstraint, ...],
    devices: int = 0,
    *,
    max_iterations: int = MAX_ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Problem:
    """The program for maximum overlap, started from a seed, in view axes; lengths in units of `scale_mm`.

    The objective is tradeoff * (grid error / 0.25)^2 + (1 - tradeoff) * (1 - pixel efficiency), with the efficiency
    averaged over the depths and over the exact device and devices as built.

    Parameters
    ----------
    spec : the requested design.
    seed : start values of mirrors.
    pairs : constraints on pairs of mirrors. Their unknowns follow all others of the design, so that a solution remains
        usable after more are appended.
    devices : number of devices as built in the objective. Their unknowns come last.
    max_iterations : iteration limit of the solver.
    tolerance : its tolerance.
    """
    return _problem(*overlap_draft(spec, seed, pairs, devices), max_iterations, tolerance)


def overlap_draft(
    spec: DesignSpec, seed: Seed, pairs: tuple[PairConstraint, ...], devices: int = 0
) -> tuple[Draft, list[Indices]]:
    """The program of `overlap_problem` without its solver, and the indices of its regions' corners."""
    draft = _draft_at_scale(spec, seed)
    grid = constraints.grid_term(spec.arrangement)
    draft.program.add(grid, draft.centres, [spec.tradeoff / REFERENCE_GRID_ERROR**2])
    device_tilts = tilts(spec, devices)
    weight = (1.0 - spec.tradeoff + TIE_BREAK) / len(device_tilts)
    regions = _add_regions(draft, device_tilts[:1], weight, _min_fractions(spec))
    add_body(draft)
    add_pairs(draft, pairs)
    _add_regions(draft, device_tilts[1:], weight, _min_fractions(spec))
    return draft, regions


def depth_problem(spec: DesignSpec, seed: Seed, pairs: tuple[PairConstraint, ...], overlap: OverlapDesign) -> Problem:
    """The program for the minimum standard deviation of depth, keeping pixels and field of view of the overlap design.

    The objective is the standard deviation relative to the design for overlap, averaged over the depths. The limit on
    the grid error is the one that the trade-off weighs as much as all pixels, or the grid error of the design for
    overlap if that is larger. See `overlap_problem` for the other parameters and the unknowns.
    """
    draft = _draft_at_scale(spec, seed)
    max_error = max(max_grid_error(spec.tradeoff), 1.01 * overlap.grid_error)
    draft.program.add(constraints.grid_limit_term(spec.arrangement), draft.centres, [max_error])
    exact = tilts(spec, 0)
    limits = np.maximum(_min_fractions(spec), MIN_FRACTION_OF_OVERLAP * overlap.fractions)
    regions = _add_regions(draft, exact, TIE_BREAK, limits)
    _add_depth_sigma(draft, regions, overlap)
    add_body(draft)
    add_pairs(draft, pairs)
    return _problem(draft, regions)


def max_grid_error(tradeoff: float) -> float:
    """The grid error g with tradeoff * (g / 0.25)^2 = 1 - tradeoff."""
    return REFERENCE_GRID_ERROR * float(np.sqrt((1.0 - tradeoff) / max(tradeoff, MIN_TRADEOFF)))


def _problem(
    draft: Draft, regions: list[Indices], max_iterations: int = MAX_ITERATIONS, tolerance: float = TOLERANCE
) -> Problem:
    return Problem(
        solver=Solver(draft.program, SLACK_WEIGHTS, max_iterations, tolerance),
        fold=draft.fold,
        centres=np.array(draft.centres),
        corners=np.array([corners for _, corners in draft.mirrors]).reshape(len(draft.mirrors), draft.spec.sides, 2),
        sizes=draft.sizes,
        regions=np.array(regions),
    )


def _draft_at_scale(spec: DesignSpec, seed: Seed) -> Draft:
    """A draft whose central mirrors, on average, fold the optical axis to the view axis at the requested height.

    Nothing else fixes the scale and the direction of the layout.
    """
    draft = Draft.of(spec, seed)
    inner = [draft.centres[index] for index in spec.arrangement.inner]
    draft.program.add(constraints.mean_term(len(inner)), [draft.fold, *inner])
    return draft


def _min_fractions(spec: DesignSpec) -> FloatArray:
    """Minimum fraction (depths, n) of the sensor's pixels with which each view sees the region at each depth."""
    mirrors = len(spec.arrangement.steps)
    return np.full((len(spec.depths_mm), mirrors), MIN_EFFICIENCY / mirrors)


def _add_regions(draft: Draft, devices: FloatArray, weight: float, min_fractions: FloatArray) -> list[Indices]:
    """Add unknown regions that all views show, and reward their pixel efficiency; returns their corners' indices.

    There is a region at each depth for each of the devices (k, n, 2), given by the tilts of their mirrors. `weight` is
    the weight of a device for all depths together, `min_fractions` (depths, n) limit the sensor's fractions.
    """
    depths_mm, half_size, regions = draft.spec.depths_mm, 0.6 * draft.seed.half_tile, []
    for device_tilts, (depth_mm, fractions) in product(devices, zip(depths_mm, min_fractions, strict=True)):
        centre = draft.program.unknown([0.0, 0.0])
        region = draft.program.unknown((constraints.region_directions() * half_size).ravel())
        draft.program.add(constraints.region_term(), [centre, region], [half_size])
        depth, depth_weight = depth_mm / draft.spec.scale_mm, weight / len(depths_mm)
        for mirror, tilt, fraction in zip(draft.mirrors, device_tilts, fractions, strict=True):
            term = constraints.view_term(draft.kind, tilted=bool(tilt.any()))
            parameters: list[ArrayLike] = [*draft.lens, depth, draft.tile_area, depth_weight, fraction]
            draft.add(term, [*mirror, region], [*parameters, tilt] if tilt.any() else parameters)
        regions.append(region)
    return regions


def _add_depth_sigma(draft: Draft, regions: list[Indices], overlap: OverlapDesign) -> None:
    """Add the objective of a design for depth, a mean over points of the common region, and limit its field of view."""
    spec, camera = draft.spec, draft.spec.camera
    sigma = constraints.depth_sigma_term(len(draft.mirrors), spec.arrangement.central_index)
    field = constraints.field_of_view_term(len(draft.mirrors))
    blur = camera.fx_px * camera.aperture_mm / spec.scale_mm / 4.0 / float(np.sqrt(SHARP_VARIANCE_PX2))
    unknowns, overlap_values = [draft.fold, *draft.centres], np.concatenate([[overlap.fold], overlap.centres.ravel()])
    for depth_mm, region, corners, fields in zip(spec.depths_mm, regions, overlap.regions, overlap.fields, strict=True):
        depth = depth_mm / spec.scale_mm
        parameters = [[depth, *point, spec.scale_mm / camera.focus_mm, blur] for point in SAMPLES @ corners]
        reference = sum(float(sigma.value(overlap_values, [*numbers, 1.0])[0]) for numbers in parameters)
        for numbers in parameters:
            draft.program.add(sigma, unknowns, [*numbers, 1.0 / reference / len(spec.depths_mm)])
        draft.program.add(field, [region, *draft.centres], [depth, MIN_FRACTION_OF_OVERLAP * fields])


@lru_cache
def relaxed_term(term: Term) -> Term:
    """The constraints of a term with variable parameters; it has no objective.

    Unknowns: the term's, and the change. Parameters: the term's without a change, and their increase for a change of 1.
    """
    builder = TermBuilder()
    x, change = builder.unknown(term.unknowns), builder.unknown(1)
    numbers, increase = builder.parameter(term.parameters), builder.parameter(term.parameters)
    _, constraints = term.value(x, numbers + change * increase)
    for row, family in enumerate(term.family.tolist()):
        builder.require(constraints[row], None if family < 0 else ELASTIC[family])
    return builder.built(equality=term.equality)


@lru_cache
def distance_term() -> Term:
    """The weighted squared distance of a number from a target. Parameters: target, weight."""
    builder = TermBuilder()
    number, target, weight = builder.unknown(1), builder.parameter(), builder.parameter()
    builder.minimise(weight * (number - target) ** 2)
    return builder.built()


def relaxed_program(program: Program, changed: Program, start: float) -> Program:
    """A program with variable parameters; its last unknown is the change, from 0 to 1, whose square it minimises.

    Parameters
    ----------
    program, changed
        The programs for changes of 0 and 1, with the same terms and unknowns. `changed` gives the start values.
    start
        Start value of the change.
    """
    relaxed = _without_terms(changed, *program.bounds)
    change = relaxed.unknown(start, 0.0, 1.0)
    for (term, uses, numbers), (_, _, others) in zip(program.uses, changed.uses, strict=True):
        for indices, old, new in zip(uses, numbers, others, strict=True):
            relaxed.add(relaxed_term(term), [indices, change], [old, new - old])
    relaxed.add(distance_term(), [change], [0.0, CHANGE_COST])
    return relaxed


def relaxed_fold(program: Program, fold: Indices, requested: float, min_fold: float, max_fold: float) -> Program:
    """A program whose fold, at the index `fold`, varies within limits and approaches the requested fold.

    Angles are radians; the fold starts at the program's start value.
    """
    low, high = program.bounds
    low[fold], high[fold] = min_fold, max_fold
    relaxed = _without_terms(program, low, high)
    change = relaxed.unknown(0.0, 0.0, 0.0)
    for term, uses, numbers in program.uses:
        for indices, parameters in zip(uses, numbers, strict=True):
            relaxed.add(relaxed_term(term), [indices, change], [parameters, np.zeros_like(parameters)])
    relaxed.add(distance_term(), [fold], [requested, CHANGE_COST])
    return relaxed


def _without_terms(program: Program, low: FloatArray, high: FloatArray) -> Program:
    """A program with the unknowns of another, without terms."""
    copy = Program()
    free = slice(len(ELASTIC), None)
    copy.unknown(program.start[free], low[free], high[free])
    return copy
