"""Allowed sizes for the mirrors of a design of rectangles, whose sides were free so far.

The design with free sides is the relaxation. Candidates give every mirror an allowed size, and for each the program is
solved again with the sizes fixed. Sides in steps are rounded; a design for depth also tries the sizes of the design
for overlap whose pixels and field of view it keeps. Sizes that are sold start from the largest that fit into
the free rectangles, enlarged by several factors, and from one size for all: what all views share grows only if all
mirrors grow. Then one mirror after another gets the size with the best optimum, until none improves.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from itertools import product

import numpy as np

from mirrorcam.core.processes.calls import Calls
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimum import Goal, Optimum
from mirrorcam.optics.design.program.nonlinear_program import SolverOutcome
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.rectangle_sizes import RectangleSizes

FITS = (0.98, 1.04, 1.1, 1.18, 1.27)
"""Factors on the free sides up to which a size that is sold fits: mirrors can make room for each other."""
MAX_LOSS = 0.02
"""Increase of the objective by sides rounded to the nearest steps beyond which they are also rounded down."""
SHRUNK = (0.95, 0.9, 0.8)
"""Ratios to the free sides that are tried if those rounded down have no optimum."""
TRIED = 3
"""Number of sizes that are tried, those nearest to the free size, for one mirror or for all."""
MAX_ITERATIONS = 100
"""Iteration limit with fixed sizes: a candidate with an optimum takes some 30, another never ends."""
MAX_ROUNDS = 2
"""Rounds of trying other sizes for all mirrors."""
MIN_GAIN = 1e-4
"""Improvement of the objective for which a mirror changes its size."""


def expected_searches(spec: DesignSpec) -> int:
    """The number of searches of `with_allowed_sizes` if the first candidates have optima; 0 for free outlines."""
    sizes = spec.rectangle_sizes
    if sizes is None:
        return 0
    if not sizes.is_stock:
        return 4 if spec.same_size else 1
    tried = min(TRIED, len(sizes.options_mm))
    return tried if spec.same_size else 1 + len(FITS) + tried + (tried - 1) * len(spec.arrangement.steps)


def with_allowed_sizes(optimum: Optimum, calls: Calls, reference: Optimum | None = None) -> Optimum:
    """The best design found with allowed sizes; free outlines are returned as they are.

    `reference` is another design with allowed sizes, from which the search starts, too. Raises InfeasibleDesign if no
    candidate has an optimum that meets all constraints.
    """
    sizes = optimum.spec.rectangle_sizes
    if sizes is None:
        return optimum
    starts = [(optimum.values, size_mm) for size_mm in _starts(optimum, sizes)]
    if reference is not None:
        starts.append((reference.values, reference.sizes_mm))
    best = _best_of(optimum, starts, calls)
    if not sizes.is_stock and not optimum.spec.same_size and _loss(best, optimum) > MAX_LOSS:
        down_mm = _cut_sizes(np.floor(optimum.sizes_mm / sizes.step_mm), optimum.spec, sizes.step_mm)
        found = _best_of(optimum, [(optimum.values, down_mm)], calls)
        best = min(best, found, key=lambda each: _loss(each, optimum))
    if best is None and not sizes.is_stock:
        best = _best_of(optimum, [(optimum.values, size_mm) for size_mm in _other_sizes(optimum, sizes)], calls)
    if best is None:
        raise InfeasibleDesign(
            "size", f"mirrors of the shape {_text(optimum.spec)} meet no optimum near sizes of {_range(optimum)}"
        )
    if not sizes.is_stock or optimum.spec.same_size:
        return best
    return _improved(best, optimum.sizes_mm, sizes, calls)


def _starts(optimum: Optimum, sizes: RectangleSizes) -> list[FloatArray]:
    """Candidates (n, 2) of sizes, mm, for all mirrors."""
    free_mm = optimum.sizes_mm
    if not sizes.is_stock:
        step, spec = sizes.step_mm, optimum.spec
        if spec.same_size:
            low = np.maximum(np.floor(free_mm / step), np.ceil(spec.min_edge_mm / step))
            return [step * (low + shift) for shift in product((0.0, 1.0), repeat=2)]
        return [_cut_sizes(np.round(free_mm / step), spec, step)]
    options = sizes.options_mm
    if optimum.spec.same_size:
        return [np.broadcast_to(options[k], free_mm.shape) for k in _by_distance(options, free_mm[0])[:TRIED]]
    smallest = options[options.prod(axis=1).argmin()]
    starts = [np.array([options[_by_distance(options, free)[0]] for free in free_mm])]
    for fit in FITS:
        fitting = [options[(options <= fit * free).all(axis=1)] for free in free_mm]
        starts.append(np.array([fits[fits.prod(axis=1).argmax()] if len(fits) else smallest for fits in fitting]))
    middle = np.median(free_mm, axis=0)
    starts += [np.broadcast_to(options[k], free_mm.shape) for k in _by_distance(options, middle)[:TRIED]]
    return list(np.unique(starts, axis=0))


def _loss(found: Optimum | None, free: Optimum) -> float:
    """Increase of the objective from the design with free sides; infinite without a design."""
    return np.inf if found is None else found.outcome.objective - free.outcome.objective


def _other_sizes(optimum: Optimum, sizes: RectangleSizes) -> list[FloatArray]:
    """Sizes (n, 2), mm, in steps, to try where neither rounded nor smaller ones have an optimum.

    Where constraints leave little space, one side may grow while the other shrinks, or both shrink by more.
    """
    whole = np.floor(optimum.sizes_mm / sizes.step_mm)
    others = [*(whole + side for side in np.eye(2)), *(np.floor(ratio * whole) for ratio in SHRUNK)]
    return [_cut_sizes(other, optimum.spec, sizes.step_mm) for other in others]


def _cut_sizes(steps: FloatArray, spec: DesignSpec, step_mm: float) -> FloatArray:
    """Sizes (n, 2), mm, of numbers of steps: no side is below the smallest edge, and shorter sides grow to the area."""
    sizes_mm = step_mm * np.maximum(steps, np.ceil(spec.min_edge_mm / step_mm))
    widths, heights = sizes_mm.T
    shorter = np.minimum(widths, heights)
    needed = step_mm * np.ceil(spec.min_area_mm2 / np.maximum(widths, heights) / step_mm)
    return np.where(sizes_mm == shorter[:, None], np.maximum(shorter, needed)[:, None], sizes_mm)


def _by_distance(options: FloatArray, free_mm: FloatArray) -> list[int]:
    """Indices of sizes (k, 2), those nearest to a free size (2,) first, by the ratio of their sides."""
    return [int(k) for k in np.abs(np.log(options / free_mm)).sum(axis=1).argsort(kind="stable")]


def _best_of(optimum: Optimum, candidates: Sequence[tuple[FloatArray, FloatArray]], calls: Calls) -> Optimum | None:
    """The best optimum near a candidate's values, with its sizes (n, 2), mm, that meets all constraints on pairs."""
    with closing(calls([(sized_optimum, (optimum.goal, *each)) for each in candidates])) as outcomes:
        found = zip(outcomes, candidates, strict=True)
        solved = [(outcome, size_mm) for outcome, (_, size_mm) in found if outcome.solved]
    for outcome, size_mm in sorted(solved, key=lambda pair: float(pair[0].objective)):
        if (best := _with_all_pairs(optimum, outcome, size_mm)) is not None:
            return best
    return None


def sized_optimum(goal: Goal, values: FloatArray, size_mm: FloatArray) -> SolverOutcome:
    """The optimum of a goal near given values, with the sizes (n, 2), mm, of all mirrors fixed."""
    # A fixed size on its limit would leave the interior-point method no interior.
    spec = goal.spec.replaced(min_edge_mm=0.9 * goal.spec.min_edge_mm, min_area_mm2=0.9 * goal.spec.min_area_mm2)
    problem = replace(goal, spec=spec, max_iterations=MAX_ITERATIONS).problem()
    return problem.solver.optimise(values, (problem.sizes.ravel(), size_mm.ravel() / spec.scale_mm))


def _with_all_pairs(optimum: Optimum, outcome: SolverOutcome, size_mm: FloatArray) -> Optimum | None:
    """The optimum with fixed sizes under all constraints on pairs; None if there is none."""
    sized = Optimum(optimum.goal, optimum.problem, outcome)
    while (stricter := sized.stricter) is not sized.goal:
        outcome = sized_optimum(stricter, sized.values, size_mm)
        if not outcome.solved:
            return None
        sized = Optimum(stricter, stricter.problem(), outcome)
    return sized


def _improved(optimum: Optimum, free_mm: FloatArray, sizes: RectangleSizes, calls: Calls) -> Optimum:
    """Give one mirror after another the size with the best optimum, until no change improves it."""
    options = sizes.options_mm
    nearest = [_by_distance(options, free)[:TRIED] for free in free_mm]
    for _ in range(MAX_ROUNDS):
        before = optimum.outcome.objective
        for index, tried in enumerate(nearest):
            candidates = []
            for option in options[tried]:
                size_mm = optimum.sizes_mm
                if np.abs(option - size_mm[index]).max() > sizes.step_mm / 2.0:
                    size_mm[index] = option
                    candidates.append((optimum.values, size_mm))
            found = _best_of(optimum, candidates, calls) if candidates else None
            if found is not None and found.outcome.objective < optimum.outcome.objective - MIN_GAIN:
                optimum = found
        if optimum.outcome.objective > before - MIN_GAIN:
            break
    return optimum


def _text(spec: DesignSpec) -> str:
    return f"{spec.shape}, all of one size," if spec.same_size else spec.shape


def _range(optimum: Optimum) -> str:
    low, high = optimum.sizes_mm.min(axis=0), optimum.sizes_mm.max(axis=0)
    return f"{low[0]:.1f} x {low[1]:.1f} to {high[0]:.1f} x {high[1]:.1f} mm"
