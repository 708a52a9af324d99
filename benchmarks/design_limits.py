"""Limits of designs: `python -m benchmarks.design_limits [--workers N] [--pictures FOLDER]`.

For the default spec: where the pixels of the sensor go and how much parallax alone must cost; active constraints and
their prices, from IPOPT's multipliers; fronts with constraints left out, best of many starts, as numerical upper
bounds; how far each view rolls against u cot(fold / 2); and efficiency at equal grid error over the fold.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.design_account import (
    ACTIVE,
    Budget,
    Price,
    budget_of,
    densities,
    expected_rolls_deg,
    parallax_bound,
    prices,
    rolls_deg,
)
from benchmarks.design_front import Point, designed, efficiency_at, searched, upper
from mirrorcam.optics.base.files import atomic
from mirrorcam.optics.base.worker_pool import call_all
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.design_problem import overlap_problem
from mirrorcam.optics.design.program.seeds import seed_of
from mirrorcam.optics.design.program.separated_pairs import PairConstraint, neighbour_pairs
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

FOLDS_DEG = tuple(range(75, 140, 5))
FEW_TRADEOFFS = (0.1, 0.2, 0.3, 0.45, 0.65, 0.8)
EQUAL_ERRORS = (0.05, 0.1)
ERROR_TICKS = (0.02, 0.03, 0.05, 0.1, 0.2)
SINGLE_MM = 400.0
COLOURS = ("#000000", "#0077bb", "#ee7733", "#cc3311", "#009988")


def relaxations(spec: DesignSpec) -> dict[str, tuple[DesignSpec, tuple[PairConstraint, ...], bool]]:
    """Specs and pairs with more and more left out, and whether their layouts are to be checked."""
    pairs = neighbour_pairs(spec.arrangement)
    touching = spec.replaced(spacing_mm=0.0, seen_gap_mm=0.0)
    thin = touching.replaced(thickness_mm=1e-4, min_edge_mm=0.0, min_area_mm2=0.0)
    apart = tuple(pair for pair in pairs if pair.kind in ("seen", "in"))
    return {
        "all constraints": (spec, pairs, True),
        "no gaps": (touching, pairs, True),
        "no gaps, thin, any size": (thin, pairs, True),
        "only disjoint sub-images": (thin, apart, False),
        "the same, 6 corners": (thin.replaced(sides=6), apart, False),
    }


def bounds(spec: DesignSpec, workers: int) -> dict[str, list[Point]]:
    """The best fronts found with constraints left out."""
    calls = {
        name: (partial(searched, checked=checked, tradeoffs=FEW_TRADEOFFS), (relaxed, pairs))
        for name, (relaxed, pairs, checked) in relaxations(spec).items()
    }
    return dict(zip(calls, call_all(list(calls.values()), workers), strict=True))


def over_folds(spec: DesignSpec, workers: int) -> dict[int, list[Point]]:
    """The results of `design` at each fold over a few tradeoffs."""
    asked = [(fold, tradeoff) for fold in FOLDS_DEG for tradeoff in FEW_TRADEOFFS]
    calls = [(designed, (spec.replaced(fold_deg=float(fold), tradeoff=tradeoff),)) for fold, tradeoff in asked]
    found: dict[int, list[Point]] = {fold: [] for fold in FOLDS_DEG}
    for (fold, _), point in zip(asked, call_all(calls, workers), strict=True):
        found[fold].append(point)
    return found


def draw_limits(
    fronts: dict[str, list[Point]], budgets: dict[float, Budget], found: dict[str, Price], path: Path
) -> None:
    """Write a PNG: fronts with constraints left out, where the pixels go, and what constraints cost."""
    figure = Figure(figsize=(16.0, 5.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.1))
    for colour, (name, front) in zip(COLOURS, fronts.items(), strict=True):
        points = upper(front)
        left.plot(
            [p.grid_error for p in points], [p.mean for p in points], color=colour, marker="o", ms=3.5, label=name
        )
    left.set_xscale("log")
    left.minorticks_off()
    left.set_xticks(ERROR_TICKS, [f"{error:g}" for error in ERROR_TICKS])
    left.set_xlabel("grid error (of a spacing)")
    left.set_ylabel("pixel efficiency, mean of both depths")
    left.set_title("Constraints left out (fold 90°, best of many starts)", fontsize=11)
    left.grid(alpha=0.3, which="both", linewidth=0.5)
    left.legend(fontsize=9, loc="lower right")
    tradeoffs = list(budgets)
    bottom = np.zeros(len(tradeoffs))
    parts = {
        "common at both depths": [b.both for b in budgets.values()],
        "common at one depth only": [b.one for b in budgets.values()],
        "rest of the sub-images": [b.rest for b in budgets.values()],
        "between sub-images": [b.between for b in budgets.values()],
    }
    for colour, (name, shares) in zip(("#228833", "#99cc99", "#ddaa33", "#bbbbbb"), parts.items(), strict=True):
        middle.bar([f"{t:g}" for t in tradeoffs], shares, bottom=bottom, color=colour, label=name)
        bottom += shares
    middle.set_xlabel("tradeoff")
    middle.set_ylabel("part of the sensor")
    middle.set_ylim(0.0, 1.0)
    middle.set_title("Where the pixels go", fontsize=11)
    handles, labels = middle.get_legend_handles_labels()
    middle.legend(handles[::-1], labels[::-1], fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    _draw_prices(right, found)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _draw_prices(axes: Axes, found: dict[str, Price]) -> None:
    shown = sorted((name for name in found if found[name].price > ACTIVE), key=lambda name: found[name].price)
    axes.barh(shown, [found[name].price for name in shown], color="#4477aa")
    for place, name in enumerate(shown):
        axes.text(
            found[name].price, place, f" {found[name].active} of {found[name].of} active", va="center", fontsize=9
        )
    axes.set_xlim(0.0, 1.45 * max(found[name].price for name in shown))
    axes.set_xlabel("sum of multipliers, per unit (see docs/design.md)")
    axes.set_title("What the active constraints cost", fontsize=11)


def draw_folds(found: dict[int, list[Point]], layouts: dict[int, Layout], path: Path) -> None:
    """Write a PNG: efficiency over the fold at equal grid error; measured roll of each view against the law."""
    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    for error, colour in zip(EQUAL_ERRORS, COLOURS, strict=False):
        values = np.array([efficiency_at(front, error) for front in found.values()])
        for which, (line, marker) in enumerate((("solid", "o"), ("dashed", "s"))):
            label = f"grid error {error:g}, {DesignSpec().depths_mm[which]:g} mm"
            left.plot(list(found), values[:, which], color=colour, linestyle=line, marker=marker, ms=4, label=label)
    left.set_xlabel("fold (deg)")
    left.set_ylabel("pixel efficiency")
    left.set_title("Efficiency at equal grid error", fontsize=11)
    left.grid(alpha=0.3, linewidth=0.5)
    left.legend(fontsize=9)
    ends = 0.0
    for colour, (fold, layout) in zip(COLOURS, layouts.items(), strict=False):
        expected, measured = expected_rolls_deg(layout, fold), rolls_deg(layout)
        ends = max(ends, np.abs(expected).max(), np.abs(measured).max())
        right.plot(expected, measured, "o", color=colour, ms=5, alpha=0.75, label=f"fold {fold} deg")
    right.plot([-ends, ends], [-ends, ends], color="#777777", linewidth=0.8, zorder=0)
    right.set_xlabel("u cot(fold / 2) (deg)")
    right.set_ylabel("roll of the view (deg)")
    right.set_title("Roll of each view, measured", fontsize=11)
    right.grid(alpha=0.3, linewidth=0.5)
    right.legend(fontsize=9)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def print_budgets(budgets: dict[float, Budget]) -> None:
    print("tradeoff  both depths  one only  rest of sub-images  between  mean efficiency")
    for tradeoff, budget in budgets.items():
        parts = f"{budget.both:11.3f}  {budget.one:8.3f}  {budget.rest:18.3f}  {budget.between:7.3f}"
        print(f"{tradeoff:8.2f}  {parts}  {budget.both + budget.one / 2.0:.3f}")


def print_parallax_bounds(
    layouts: dict[float, Layout], budgets: dict[float, Budget], depths_mm: Sequence[float]
) -> None:
    """Raises RuntimeError where a design exceeds its bound, which would prove one of the two wrong."""
    print("tradeoff  mean efficiency  bound from parallax: small angles, all angles")
    for tradeoff, layout in layouts.items():
        mean = budgets[tradeoff].both + budgets[tradeoff].one / 2.0
        ideal = parallax_bound(layout, depths_mm)
        strict = parallax_bound(layout, depths_mm, densities(layout, depths_mm))
        print(f"{tradeoff:8.2f}  {mean:15.3f}  {ideal:.3f}  {strict:.3f}")
        if mean > strict:
            raise RuntimeError(f"mean efficiency {mean:.3f} exceeds its bound {strict:.3f}")


def print_prices(found: dict[str, Price]) -> None:
    print("family  active of all  sum of multipliers")
    for name, price in sorted(found.items(), key=lambda item: -item[1].price):
        print(f"{name:20} {price.active:5} of {price.of:5}  {price.price:.4f}")


def print_fronts(fronts: dict[str, list[Point]]) -> None:
    """Efficiency at equal grid error; the last digit is not a bound: the best of many local optima is."""
    base = fronts["all constraints"]
    for error in EQUAL_ERRORS:
        print(f"grid error {error:g}: efficiency at each depth, mean, more than with all constraints")
        for name, front in fronts.items():
            ours = efficiency_at(front, error)
            gain = ours.mean() / efficiency_at(base, error).mean() - 1.0
            print(f"  {name:26} " + " / ".join(f"{share:.3f}" for share in ours) + f"  {ours.mean():.3f}  {gain:+.1%}")


def print_folds(found: dict[int, list[Point]]) -> None:
    print("fold  " + "  ".join(f"at grid error {error:g}" for error in EQUAL_ERRORS))
    for fold, front in found.items():
        shares = [" / ".join(f"{share:.3f}" for share in efficiency_at(front, error)) for error in EQUAL_ERRORS]
        print(f"{fold:4}  " + "  ".join(f"{share:17}" for share in shares))


def main(workers: int, pictures: Path | None) -> None:
    spec = DesignSpec(camera=Camera.c920().replaced(aperture_mm=0.0), fold_deg=90.0)
    layouts = {tradeoff: design(spec.replaced(tradeoff=tradeoff)) for tradeoff in (0.1, 0.3, 0.5, 0.9)}
    budgets = {tradeoff: budget_of(layout, spec.depths_mm) for tradeoff, layout in layouts.items()}
    print_budgets(budgets)
    print_parallax_bounds(layouts, budgets, spec.depths_mm)
    working_mm = len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)
    problem = overlap_problem(spec, seed_of(spec, working_mm), neighbour_pairs(spec.arrangement))
    found = prices(spec, problem, problem.solver.optimise().values)
    print_prices(found)
    folded = {90: layouts[0.3]} | {fold: design(spec.replaced(fold_deg=float(fold))) for fold in (75, 120)}
    for fold, layout in folded.items():
        measured, expected = rolls_deg(layout), expected_rolls_deg(layout, fold)
        listed = " ".join(f"{a:+.1f}/{b:+.1f}" for a, b in zip(measured, expected, strict=True))
        print(f"fold {fold}: roll / u cot(fold / 2) of each view, deg: {listed}")
    fronts = bounds(spec, workers)
    print_fronts(fronts)
    print(f"{SINGLE_MM:g} mm alone:")
    print_fronts(bounds(spec.replaced(depths_mm=(SINGLE_MM,)), workers))
    folds = over_folds(spec, workers)
    print_folds(folds)
    if pictures:
        draw_limits(fronts, budgets, found, pictures / "design_limits.png")
        draw_folds(folds, folded, pictures / "design_fold.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--pictures", type=Path, help="a folder for design_limits.png and design_fold.png")
    arguments = parser.parse_args()
    main(arguments.workers, arguments.pictures)
