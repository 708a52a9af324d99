"""Pixel efficiency against grid error: `python -m benchmarks.design_front [--picture FILE]`.

3x3, C920, scale 80 mm, spacing 1 mm, at depths 300 and 500 mm and at 400 mm alone: what `design` answers over the
tradeoffs, at folds of 90, 105 and 120 degrees, with mirrors of 4, 5 and 6 corners and with the two depths weighed
unequally, and the best of more starts at 90 degrees. Each front is compared, at equal grid error, with the points of a
plain prototype; the camera is a pinhole. Figures are those of `optics.design.metrics`, by polygon clipping; every
design passed its verdict.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.records import Table, add_json_option, short, table, write_record
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.processes.calls import Call
from mirrorcam.core.processes.worker_pool import call_all
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.assess.verify import require_passed, verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.design_problem import overlap_problem
from mirrorcam.optics.design.program.nonlinear_program import SolverOutcome
from mirrorcam.optics.design.program.seeds import layout_of, mirrors_of
from mirrorcam.optics.design.program.separation import PairConstraint, neighbour_pairs
from mirrorcam.optics.design.search import MEETINGS, seed_meeting
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import pixel_efficiency

TRADEOFFS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97)

MORE_MEETINGS = (*MEETINGS, 0.8, 1.5, 10.0)
"""Where chief rays of the seeds of a search meet, in multiples of the working depth."""

PROTOTYPE = {
    (300.0, 500.0): ((0.105, (0.51, 0.52)), (0.063, (0.47, 0.48)), (0.012, (0.34, 0.45))),
    (400.0,): ((0.107, (0.61,)),),
}
"""Grid error and pixel efficiencies that a plain prototype reached."""

WEIGHED = {"2 : 3": (295.0, 305.0, 490.0, 500.0, 510.0), "1 : 3": (300.0, 480.0, 500.0, 520.0)}
"""Depths that make a design for 300 and 500 mm weigh the two unequally: what is listed more often weighs more."""

PINHOLE_CAMERA = Camera.c920().replaced(aperture_mm=0.0)
"""The prototype knew no other."""

ASKED = 1.1
"""How many times the prototype's efficiency is asked for, at equal grid error."""


@dataclass(frozen=True)
class Point:
    """A design on a front: its tradeoff, grid error and pixel efficiency at each depth."""

    tradeoff: float
    grid_error: float
    efficiency: tuple[float, ...]

    @property
    def mean(self) -> float:
        return sum(self.efficiency) / len(self.efficiency)


def point_of(layout: Layout, spec: DesignSpec) -> Point:
    efficiency = tuple(pixel_efficiency(layout, depth) for depth in spec.depths_mm)
    return Point(spec.tradeoff, grid_error(layout), efficiency)


def designed(spec: DesignSpec, wanted_mm: tuple[float, ...] = ()) -> Point:
    """The result of `design`, at the spec's depths or at others."""
    return point_of(design(spec), spec.replaced(depths_mm=wanted_mm or spec.depths_mm))


def searched(
    spec: DesignSpec, pairs: tuple[PairConstraint, ...], *, checked: bool, tradeoffs: Sequence[float] = TRADEOFFS
) -> list[Point]:
    """The front of a spec from many starts: seeds, then the neighbours' optima up and down the tradeoffs.

    Of each tradeoff the best optimum; where `checked`, only those whose layout passes its verdict. `keeps` may leave
    out what a buildable layout keeps.
    """
    asked = [spec.replaced(tradeoff=tradeoff) for tradeoff in tradeoffs]
    problems = [overlap_problem(one, seed_meeting(one), pairs) for one in asked]
    seeds = [seed_meeting(spec, meeting) for meeting in MORE_MEETINGS]
    best: list[SolverOutcome | None] = [None] * len(asked)
    layouts: list[Layout | None] = [None] * len(asked)

    def attempt(k: int, start: FloatArray) -> None:
        outcome, before = problems[k].solver.optimise(start), best[k]
        if not outcome.solved or (before is not None and outcome.objective >= before.objective - 1e-9):
            return
        centres, corners = problems[k].solution(outcome.values)
        try:
            layout = layout_of(asked[k], mirrors_of(asked[k], centres * spec.scale_mm, corners), {})
            if checked:
                require_passed(verify(layout, asked[k]))
        except InfeasibleDesign:
            return
        best[k], layouts[k] = outcome, layout

    for start in (overlap_problem(spec, seed, pairs).solver.program.start for seed in seeds):
        for k in range(len(asked)):
            attempt(k, start)
    for hops in (range(1, len(asked)), range(len(asked) - 2, -1, -1)):
        for k in hops:
            neighbour = best[k - 1 if hops.step > 0 else k + 1]
            if neighbour is not None:
                attempt(k, neighbour.values)
    return [point_of(layout, one) for layout, one in zip(layouts, asked, strict=True) if layout is not None]


def upper(front: Sequence[Point]) -> list[Point]:
    """Points that no other betters in both grid error and mean efficiency, by grid error."""
    kept: list[Point] = []
    for point in sorted(front, key=lambda point: (point.grid_error, -point.mean)):
        if not kept or point.mean > kept[-1].mean:
            kept.append(point)
    return kept


def efficiency_at(front: Sequence[Point], error: float) -> FloatArray:
    """Efficiencies (depths,) on a front at a grid error, between its points; NaN beyond its ends."""
    points = upper(front)
    errors = [point.grid_error for point in points]
    values = np.array([point.efficiency for point in points])
    return np.array([np.interp(error, errors, column, left=np.nan, right=np.nan) for column in values.T])


def compared(name: str, front: Sequence[Point], depths_mm: tuple[float, ...]) -> list[str]:
    """A line per point of the prototype: efficiency at its grid error, and by how much that is more."""
    lines = []
    for error, theirs in PROTOTYPE[depths_mm]:
        ours = efficiency_at(front, error)
        gains, mean_gain = ours / np.array(theirs) - 1.0, ours.mean() / np.mean(theirs) - 1.0
        reached = "at every depth" if (gains >= ASKED - 1.0).all() else "on average" if mean_gain >= ASKED - 1 else "no"
        shares = " / ".join(f"{share:.3f}" for share in ours)
        percents = " / ".join(f"{gain:+.1%}" for gain in gains)
        lines.append(f"{name:26} {error:.3f}  {shares:13}  {percents:17} mean {mean_gain:+.1%}  +10 %: {reached}")
    return lines


Fronts = dict[tuple[float, ...], dict[str, list[Point]]]


TABLED = {
    "90°": "fold 90 deg, 4 corners",
    "90°, 6 corners": "fold 90 deg, 6 corners",
    "105°": "fold 105 deg, 4 corners",
    "120°": "fold 120 deg, 4 corners",
}
"""Fronts of the table, by the titles of their columns."""


def tabled(found: Fronts) -> Table:
    """Efficiencies at the prototype's grid errors, and their gains."""
    rows = []
    for depths, points in PROTOTYPE.items():
        alone = f", {depths[0]:g} mm alone" if len(depths) == 1 else ""
        for error, theirs in points:
            cells = [short(error) + alone, " / ".join(short(share, 2) for share in theirs)]
            for name in TABLED.values():
                ours = efficiency_at(found[depths][name], error)
                gains = " / ".join(f"{100.0 * gain:+.0f}" for gain in ours / np.array(theirs) - 1.0)
                cells.append(f"{' / '.join(map(short, ours))}, {gains} %")
            rows.append(cells)
    return table(("grid error", "prototype", *TABLED), rows)


def gains_of(found: Fronts) -> dict[str, float]:
    """Gains at a fold of 90 degrees, in percent: of the mean, at the farther depth, by weights, and by more starts."""
    both = next(iter(PROTOTYPE))
    ours, more = (found[both][f"fold 90 deg, {name}"] for name in ("4 corners", "more starts"))
    gains, mean, by_starts = [], [], []
    for error, theirs in PROTOTYPE[both]:
        here = efficiency_at(ours, error)
        gains.append(100.0 * (here / np.array(theirs) - 1.0))
        mean.append(100.0 * float(here.mean() / np.mean(theirs) - 1.0))
        by_starts.append(100.0 * abs(float(efficiency_at(more, error).mean() / here.mean() - 1.0)))
    far = [float(gain[-1]) for gain in gains]
    figures = {"mean_gain_least_percent": min(mean), "mean_gain_most_percent": max(mean)}
    figures |= {"gain_500mm_least_percent": min(far), "gain_500mm_most_percent": max(far)}
    for ratio, (error, theirs) in zip(WEIGHED, (PROTOTYPE[both][0], PROTOTYPE[both][-1]), strict=True):
        weighed = 100.0 * (efficiency_at(found[both][f"fold 90 deg, weighed {ratio}"], error) / np.array(theirs) - 1.0)
        name = f"weighted_{ratio.replace(' : ', '_')}"
        figures |= {f"{name}_grid_error": error}
        figures |= {f"{name}_gain_{depth:g}mm_percent": float(g) for depth, g in zip(both, weighed, strict=True)}
    return figures | {"more_starts_percent": float(np.nanmax(by_starts))}


def fronts(workers: int) -> Fronts:
    """All fronts by depths and name, made in `workers` processes."""
    asked = {
        (depths, name): DesignSpec(camera=PINHOLE_CAMERA, depths_mm=depths, spacing_mm=1.0, fold_deg=fold, sides=sides)
        for depths in PROTOTYPE
        for name, fold, sides in (
            *((f"fold {fold} deg, {4} corners", float(fold), 4) for fold in (90, 105, 120)),
            *((f"fold 90 deg, {sides} corners", 90.0, sides) for sides in (5, 6)),
        )
    }
    plain: dict[tuple[tuple[float, ...], str], list[Call]] = {
        key: [(designed, (spec.replaced(tradeoff=tradeoff),)) for tradeoff in TRADEOFFS] for key, spec in asked.items()
    }
    both = next(iter(PROTOTYPE))
    for ratio, depths in WEIGHED.items():
        plain[both, f"fold 90 deg, weighed {ratio}"] = [
            (
                designed,
                (
                    DesignSpec(
                        camera=PINHOLE_CAMERA, depths_mm=depths, spacing_mm=1.0, fold_deg=90.0, tradeoff=tradeoff
                    ),
                    both,
                ),
            )
            for tradeoff in TRADEOFFS
        ]
    more: list[Call] = [
        (
            partial(searched, checked=True),
            (
                DesignSpec(camera=PINHOLE_CAMERA, depths_mm=depths, spacing_mm=1.0, fold_deg=90.0),
                neighbour_pairs(DesignSpec().arrangement),
            ),
        )
        for depths in PROTOTYPE
    ]
    # The searches take longest, so they start first.
    answers = iter(call_all([*more, *(call for calls in plain.values() for call in calls)], workers))
    searches = dict(zip(PROTOTYPE, answers, strict=False))
    found: Fronts = {depths: {} for depths in PROTOTYPE}
    for (depths, name), calls in plain.items():
        found[depths][name] = [next(answers) for _ in calls]
    for depths, front in searches.items():
        found[depths]["fold 90 deg, more starts"] = front
    return found


STYLES = {
    "fold 90 deg, 4 corners": ("#000000", "o", "solid"),
    "fold 105 deg, 4 corners": ("#0077bb", "s", "solid"),
    "fold 120 deg, 4 corners": ("#33bbee", "D", "solid"),
    "fold 90 deg, 5 corners": ("#ee7733", "^", "dashed"),
    "fold 90 deg, 6 corners": ("#cc3311", "v", "dashed"),
    "fold 90 deg, weighed 2 : 3": ("#009988", "P", "dashdot"),
    "fold 90 deg, weighed 1 : 3": ("#bbaa00", "X", "dashdot"),
    "fold 90 deg, more starts": ("#777777", ".", "dotted"),
}


def _panel(axes: Axes, found: dict[str, list[Point]], depths_mm: tuple[float, ...], which: int) -> None:
    for name, front in found.items():
        colour, marker, line = STYLES[name]
        points = upper(front)
        errors, shares = [p.grid_error for p in points], [p.efficiency[which] for p in points]
        axes.plot(
            errors,
            shares,
            color=colour,
            marker=marker,
            linestyle=line,
            markersize=4,
            linewidth=1.3,
            label=name.replace(" deg", "°"),
        )
    errors = [error for error, _ in PROTOTYPE[depths_mm]]
    theirs = np.array([efficiency[which] for _, efficiency in PROTOTYPE[depths_mm]])
    axes.plot(errors, theirs, "x", color="#aa3377", markersize=8, markeredgewidth=2, label="prototype")
    axes.plot(errors, ASKED * theirs, "_", color="#aa3377", markersize=14, markeredgewidth=2, label="prototype + 10 %")
    axes.set_xscale("log")
    axes.set_xlabel("grid error (of a spacing)")
    axes.set_ylabel(f"pixel efficiency at {depths_mm[which]:g} mm")
    axes.set_title("depths " + " and ".join(f"{depth:g}" for depth in depths_mm) + " mm", fontsize=11)
    axes.grid(alpha=0.3, which="both", linewidth=0.5)


def draw(found: Fronts, path: Path) -> None:
    """Write a PNG: efficiency at each depth over grid error, one panel a depth, with the prototype's points."""
    panels = [(depths, which) for depths in PROTOTYPE for which in range(len(depths))]
    figure = Figure(figsize=(5.0 * len(panels), 5.6), layout="constrained")
    for axes, (depths, which) in zip(figure.subplots(1, len(panels), sharey=True), panels, strict=True):
        _panel(axes, found[depths], depths, which)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def main(workers: int, picture: Path | None, json: Path | None) -> None:
    print(f"IPOPT of CasADi {version('casadi')}; {len(TRADEOFFS)} tradeoffs from {TRADEOFFS[0]} to {TRADEOFFS[-1]}")
    found = fronts(workers)
    for depths, named in found.items():
        print("\ndepths " + ", ".join(f"{depth:g}" for depth in depths) + " mm: tradeoff, grid error, efficiencies")
        for name, front in named.items():
            print(name)
            for point in front:
                shares = " ".join(f"{share:.3f}" for share in point.efficiency)
                print(f"  {point.tradeoff:.2f}  {point.grid_error:.4f}  {shares}")
        print("\nat the prototype's grid error: efficiency, gain at each depth")
        for name, front in named.items():
            print("\n".join(compared(name, front, depths)))
    write_record(json, "design_front", gains_of(found), tabled(found))
    if picture:
        draw(found, picture)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path, help="a PNG to write")
    add_json_option(parser)
    arguments = parser.parse_args()
    main(arguments.workers, arguments.picture, arguments.json)
