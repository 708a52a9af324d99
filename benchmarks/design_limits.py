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
from benchmarks.design_front import PROTOTYPE, Point, designed, efficiency_at, searched, upper
from benchmarks.records import Table, add_json_option, short, table, write_record
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.processes.worker_pool import call_all
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.design_problem import overlap_problem
from mirrorcam.optics.design.program.seeds import seed_of
from mirrorcam.optics.design.program.separation import PairConstraint, neighbour_pairs
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


PRICED = (
    "gap",
    "gap as seen",
    "overlap",
    "sensor's borders",
    "light out, light in",
)
"""Families of constraints in the table; those of the size and depth of mirrors are added together below them."""
TABLED_FOLDS = (75, 90, 105, 120, 135)
LEFT_OUT = {
    "all constraints": "none",
    "no gaps": "gaps",
    "no gaps, thin, any size": "gaps, thickness, sizes",
    "only disjoint sub-images": "all but disjoint sub-images",
    "the same, 6 corners": "the same, six corners",
}
"""What the rows of the table call the fronts of `relaxations`."""


def table_of_budgets(budgets: dict[float, Budget]) -> Table:
    """Shares of the sensor by trade-off."""
    parts = {
        "common to all views at both depths": [b.both for b in budgets.values()],
        "common at one depth only": [b.one for b in budgets.values()],
        "rest of the sub-images": [b.rest for b in budgets.values()],
        "between sub-images": [b.between for b in budgets.values()],
    }
    first, *others = (f"{tradeoff:g}" for tradeoff in budgets)
    rows = [(name, *map(short, shares)) for name, shares in parts.items()]
    return table(("share of the sensor", f"trade-off {first}", *others), rows)


def table_of_prices(found: dict[str, Price]) -> Table:
    """Active constraints of families and what they cost together."""
    rows = []
    for title in PRICED:
        prices = [found[name] for name in title.split(", ")]
        counts = ", ".join(f"{each.active} of {each.of}" for each in prices)
        rows.append((title, counts, f"{sum(each.price for each in prices):.2f}"))
    cuts = [price for name, price in found.items() if name.startswith("cut")]
    active, price = sum(each.active for each in cuts), sum(each.price for each in cuts)
    rows.append(("size, depth, convexity", f"{active}", f"{price:.2f}" if price >= 0.005 else "0"))
    return table(("constraint at the optimum, 90°", "active, of all", "sum of multipliers"), rows)


def table_of_fronts(fronts: dict[str, list[Point]]) -> Table:
    """Mean efficiency at equal grid error, with more and more left out."""
    rows = []
    for name, title in LEFT_OUT.items():
        cells = []
        for error in EQUAL_ERRORS:
            mean, all_kept = (efficiency_at(fronts[each], error).mean() for each in (name, "all constraints"))
            cells.append(short(mean) + ("" if title == "none" else f", {100.0 * (mean / all_kept - 1.0):+.1f} %"))
        rows.append((title, *cells))
    first, second = EQUAL_ERRORS
    return table(("constraints left out", f"mean efficiency at grid error {first:g}", f"at {second:g}"), rows)


def table_of_folds(found: dict[int, list[Point]]) -> Table:
    """Efficiencies at equal grid error over the fold."""
    rows = [
        (f"{fold}°", *(" / ".join(map(short, efficiency_at(found[fold], error))) for error in EQUAL_ERRORS))
        for fold in TABLED_FOLDS
    ]
    return table(("fold", *(f"grid error {error:g}" for error in EQUAL_ERRORS)), rows)


def roll_figures(folded: dict[int, Layout]) -> dict[str, float]:
    """Rolls of the outer columns: by the law for equally wide columns, measured, and by the law where they are."""
    figures = {}
    for fold in (90, 120):
        layout = folded[fold]
        camera, cols = layout.camera, layout.cols
        middle = (1.0 - 1.0 / cols) * camera.width_px / 2.0 / camera.fx_px
        outer = [k for k in range(len(layout.mirrors)) if k % cols in (0, cols - 1)]
        figures[f"roll_bound_{fold}_deg"] = float(np.degrees(middle / np.tan(np.radians(fold) / 2.0)))
        for name, rolls in (("roll", rolls_deg(layout)), ("middles", expected_rolls_deg(layout, fold))):
            if name == "roll" or fold == 90:
                each = np.abs(rolls[outer])
                figures |= {f"{name}_{fold}_least_deg": each.min(), f"{name}_{fold}_most_deg": each.max()}
    return figures


def single_figures(single: dict[str, list[Point]]) -> dict[str, float]:
    """Mean efficiency at one depth with everything left out, and what it is more than with nothing left out."""
    figures: dict[str, float] = {}
    for error in EQUAL_ERRORS:
        most, kept = (efficiency_at(single[name], error).mean() for name in ("the same, 6 corners", "all constraints"))
        name = f"{100.0 * error:02.0f}"
        figures |= {f"all_left_out_400mm_at_{name}": most}
        figures |= {f"all_left_out_gain_at_{name}_percent": 100.0 * (most / kept - 1.0)}
    error, (efficiency,) = PROTOTYPE[(SINGLE_MM,)][0]
    return figures | {"prototype_400mm": efficiency, "prototype_400mm_grid_error": error}


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


def main(workers: int, pictures: Path | None, json: Path | None) -> None:
    spec = DesignSpec(camera=Camera.c920().replaced(aperture_mm=0.0), fold_deg=90.0)
    layouts = {tradeoff: design(spec.replaced(tradeoff=tradeoff)) for tradeoff in (0.1, 0.3, 0.5, 0.9)}
    budgets = {tradeoff: budget_of(layout, spec.depths_mm) for tradeoff, layout in layouts.items()}
    print_budgets(budgets)
    print_parallax_bounds(layouts, budgets, spec.depths_mm)
    working_mm = len(spec.depths_mm) / sum(1.0 / depth for depth in spec.depths_mm)
    problem = overlap_problem(spec, seed_of(spec, working_mm), neighbour_pairs(spec.arrangement))
    found = prices(spec, problem, problem.solver.optimise().values)
    print_prices(found)
    write_record(json, "design_limits_budget", table=table_of_budgets(budgets))
    write_record(json, "design_limits_constraints", table=table_of_prices(found))
    folded = {90: layouts[0.3]} | {fold: design(spec.replaced(fold_deg=float(fold))) for fold in (75, 120)}
    for fold, layout in folded.items():
        measured, expected = rolls_deg(layout), expected_rolls_deg(layout, fold)
        listed = " ".join(f"{a:+.1f}/{b:+.1f}" for a, b in zip(measured, expected, strict=True))
        print(f"fold {fold}: roll / u cot(fold / 2) of each view, deg: {listed}")
    fronts = bounds(spec, workers)
    print_fronts(fronts)
    print(f"{SINGLE_MM:g} mm alone:")
    single = bounds(spec.replaced(depths_mm=(SINGLE_MM,)), workers)
    print_fronts(single)
    write_record(json, "design_limits_prices", table=table_of_fronts(fronts))
    figures = {
        "parallax_bound_small_angles": parallax_bound(layouts[0.3], spec.depths_mm),
        "parallax_bound": parallax_bound(layouts[0.3], spec.depths_mm, densities(layouts[0.3], spec.depths_mm)),
    }
    write_record(json, "design_limits", roll_figures(folded) | single_figures(single) | figures)
    folds = over_folds(spec, workers)
    print_folds(folds)
    write_record(json, "design_limits_folds", table=table_of_folds(folds))
    if pictures:
        draw_limits(fronts, budgets, found, pictures / "design_limits.png")
        draw_folds(folds, folded, pictures / "design_fold.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--pictures", type=Path, help="a folder for design_limits.png and design_fold.png")
    add_json_option(parser)
    arguments = parser.parse_args()
    main(arguments.workers, arguments.pictures, arguments.json)
