"""Two mirrors per view against one, at equal size: `python -m benchmarks.two_bounces [--picture FILE]`.

In the box around the mirrors of the default 3x3 design (scale 80 mm, C920, depths 300 and 500 mm, pupil 1.8 mm) at a
fold of 90 and of 120 degrees, the best arrangements of one and of two mirrors per view are searched by IPOPT under the
same constraints, from several seeds and folds, for the depth resolution: the root of the sum over the views of their
usable pixels times the squared distance of their virtual centre from the mean. Each is then checked by rays.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.two_bounces_chains import Chain, Found, Question
from benchmarks.two_bounces_program import Program
from benchmarks.two_bounces_rays import Traced, traced
from benchmarks.two_bounces_seeds import ladder, one_bounce, star
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.processes.worker_pool import call_all
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec

Box = tuple[float, float, float]
VIEWS = ((1, 2), (2, 2), (3, 3))
BOX_FOLDS_DEG = (90.0, 120.0)
ONE_BOUNCE_FOLDS_DEG = (90.0, 105.0, 120.0, 135.0)
TWO_BOUNCE_FOLDS_DEG = (0.0, 90.0)
SECONDS = 150.0
"""Longest search from one seed."""
REFLECTIVITY = 0.9
TILT_DEG = 0.1
"""Error of the tilt of each mirror about each of two axes in its plane, standard deviation."""
JUDGED_MM = 400.0


@dataclass(frozen=True)
class Row:
    """What an arrangement does.

    Attributes
    ----------
    baselines_mm
        Extent of the virtual centres across the views, x and y.
    spread_mm
        Root mean square distance of the virtual centres from their mean, across the views.
    efficiency
        Share of the sensor, mean over the depths, that sees the common region with the whole pupil.
    resolution_mm
        Depth resolution: root of the sum of usable pixels, as shares of the sensor, times squared distances.
    path_mm
        Mean length of the light from the plane at 400 mm to the pupil, along the views.
    moved_px
        Root mean square movement of a point in the middle of the region at 400 mm, through mirrors that are tilted.
    litres
        Volume of the box, along view axes, around the mirrors and the pupil.
    """

    baselines_mm: FloatArray
    spread_mm: float
    efficiency: float
    resolution_mm: float
    path_mm: float
    moved_px: float
    litres: float


def box_of(fold_deg: float) -> Box:
    """Sides, in view axes, of the box around the mirrors of the default design at a fold."""
    layout = design(DesignSpec(fold_deg=fold_deg))
    corners = np.concatenate([mirror.outline_in_rig_mm for mirror in layout.mirrors]) @ layout.view_from_rig.T
    x, y, z = np.ptp(corners, axis=0).tolist()
    return x, y, z


def shares(found: Found) -> FloatArray:
    """Share (views,) of the sensor on which each view sees the common regions, mean over the depths."""
    seen = np.array([[chain.normalized(region) for region in found.regions_mm] for chain in found.chains])
    following = np.roll(seen, -1, axis=2)
    twice = (seen[..., 0] * following[..., 1] - seen[..., 1] * following[..., 0]).sum(axis=2)
    return np.asarray(np.abs(twice).mean(axis=1) / 2.0 / (4.0 * found.question.half_field.prod()))


def tilted(chain: Chain, bounce: int, turn: FloatArray) -> Chain:
    """A chain of which one mirror is turned by a small vector (3,), in rad, about the middle of its outline."""
    normals, offsets = chain.normals.copy(), chain.offsets_mm.copy()
    normals[bounce] += np.cross(turn, normals[bounce])
    normals[bounce] /= np.linalg.norm(normals[bounce])
    offsets[bounce] = normals[bounce] @ chain.outlines_mm[bounce].mean(axis=0)
    return Chain(normals, offsets, chain.outlines_mm, chain.cell)


def moved_px(found: Found, tilt_deg: float = TILT_DEG) -> float:
    """Root mean square movement over the views of a point amid the scene, if each mirror has errors of its tilt."""
    q = found.question
    middles = np.mean(found.regions_mm, axis=1) @ q.view_from_rig.T
    part = (JUDGED_MM - q.depths_mm[0]) / (q.depths_mm[-1] - q.depths_mm[0])
    point = (middles[0] + part * (middles[-1] - middles[0])) @ q.view_from_rig
    squares = []
    for chain in found.chains:
        at = chain.normalized(point)
        for bounce, normal in enumerate(chain.normals):
            first = np.linalg.svd(normal[None])[2][1:]
            steps = [
                chain_moved.normalized(point) - at
                for chain_moved in (tilted(chain, bounce, np.deg2rad(tilt_deg) * axis) for axis in first)
            ]
            squares.append(np.square(steps).sum())
    return float(np.sqrt(np.sum(squares) / len(found.chains)) * q.camera.fx_px)


def row_of(found: Found) -> Row:
    """The figures of an arrangement."""
    centres = np.array([chain.virtual_centre_in_rig_mm for chain in found.chains])
    in_view = centres @ found.question.view_from_rig.T
    across = in_view[:, :2]
    squared = np.square(across - across.mean(axis=0)).sum(axis=1)
    each = shares(found)
    corners = np.concatenate([np.zeros((1, 3)), *(chain.outlines_mm.reshape(-1, 3) for chain in found.chains)])
    return Row(
        np.ptp(across, axis=0),
        float(np.sqrt(squared.mean())),
        float(each.sum()),
        float(np.sqrt((each * squared).sum())),
        float(JUDGED_MM - in_view[:, 2].mean()),
        moved_px(found),
        float(np.ptp(corners @ found.question.view_from_rig.T, axis=0).prod() / 1e6),
    )


def seeds_of(question: Question) -> list[list[Chain]]:
    """Where the search starts, for a question; fewer of many views, of which each takes a minute or more."""
    many = question.rows > 2
    if question.bounces == 1:
        return [one_bounce(question, distance, 0.6) for distance in (80.0, 60.0)[: 1 if many else 2]]
    stars = [star(question, 28.0, 50.0, 0.6), star(question, 20.0, 40.0, 0.5)]
    if question.fold_deg > 60.0:
        return stars
    ladders = [ladder(question, 40.0, 30.0, 0.6), ladder(question, 30.0, 50.0, 0.6)]
    return [stars[0], ladders[0]] if many else [*stars, *ladders]


def solved(question: Question, which: int) -> Found | None:
    """The optimum from one of the seeds, if there is one."""
    return Program(question, seeds_of(question)[which]).solve(SECONDS)


def best(found: Sequence[Found | None]) -> Found:
    """The arrangement with the best depth resolution."""
    return max((one for one in found if one is not None), key=lambda one: row_of(one).resolution_mm)


def searched(
    views: Sequence[tuple[int, int]], boxes: dict[float, Box], workers: int
) -> dict[tuple[float, int, int, int], Found]:
    """The best arrangements by fold of the box's design, rows, columns, and mirrors per view."""
    questions = [
        (box_fold, Question(rows, cols, bounces, fold, box))
        for box_fold, box in boxes.items()
        for rows, cols in views
        for bounces, folds in (
            (1, ONE_BOUNCE_FOLDS_DEG),
            (2, TWO_BOUNCE_FOLDS_DEG if rows < 3 else TWO_BOUNCE_FOLDS_DEG[:1]),
        )
        for fold in folds
    ]
    asked = [(box_fold, q, which) for box_fold, q in questions for which in range(len(seeds_of(q)))]
    answers = call_all([(solved, (q, which)) for _, q, which in asked], workers)
    grouped: dict[tuple[float, int, int, int], list[Found | None]] = {}
    for (box_fold, q, _), answer in zip(asked, answers, strict=True):
        grouped.setdefault((box_fold, q.rows, q.cols, q.bounces), []).append(answer)
    return {key: best(group) for key, group in grouped.items()}


def line_of(key: tuple[float, int, int, int], found: Found, rays: Traced) -> str:
    box_fold, rows, cols, bounces = key
    row = row_of(found)
    lit = row.resolution_mm * REFLECTIVITY ** (bounces / 2.0)
    return (
        f"{box_fold:4g}  {rows} x {cols}  {bounces}  {found.question.fold_deg:4g}  {rows * cols * bounces:3d}  "
        f"{row.baselines_mm[0]:4.0f} x {row.baselines_mm[1]:3.0f}  {row.spread_mm:5.1f}  {row.efficiency:.3f}  "
        f"{rays.usable.mean():.3f} {rays.blocked:.3f}  {row.resolution_mm:5.1f}  {lit:5.1f}  {row.path_mm:4.0f}  "
        f"{row.moved_px:4.1f}  {row.litres:.2f}"
    )


def _side_view(axes: Axes, found: Found, title: str) -> None:
    """Mirrors and chief rays from above: along y of the views."""
    turn = found.question.view_from_rig.T
    colours = [f"C{k % 10}" for k in range(len(found.chains))]
    for chain, colour in zip(found.chains, colours, strict=True):
        for outline in chain.outlines_mm @ turn:
            axes.fill(outline[:, 0], outline[:, 2], color=colour, alpha=0.45, linewidth=0.8, edgecolor=colour)
        ray = np.append(chain.cell.mean(axis=0), 1.0)
        stops, way = [np.zeros(3)], ray / np.linalg.norm(ray)
        for normal, offset in zip(chain.normals, chain.offsets_mm, strict=True):
            stops.append(stops[-1] + way * (offset - stops[-1] @ normal) / (way @ normal))
            way = way - 2.0 * (way @ normal) * normal
        stops.append(stops[-1] + 90.0 * way)
        path = np.array(stops) @ turn
        axes.plot(path[:, 0], path[:, 2], color=colour, linewidth=0.9)
    centres = np.array([chain.virtual_centre_in_rig_mm for chain in found.chains]) @ turn
    axes.plot(centres[:, 0], centres[:, 2], "kx", markersize=6)
    axes.plot(0.0, 0.0, "ko", markersize=5)
    row = row_of(found)
    axes.set_title(
        f"{title}: resolution {row.resolution_mm:.0f} mm,\nspread {row.spread_mm:.0f} mm, usable {row.efficiency:.2f}",
        fontsize=10,
    )
    axes.set_aspect("equal")
    axes.grid(alpha=0.3, linewidth=0.5)


def draw(found: dict[tuple[float, int, int, int], Found], path: Path) -> None:
    """Write a PNG: the best arrangements of one and of two mirrors per view in the box of the first fold."""
    views = [(rows, cols) for rows, cols in VIEWS if (BOX_FOLDS_DEG[0], rows, cols, 2) in found]
    figure = Figure(figsize=(4.2 * len(views), 8.4), layout="constrained")
    grid = figure.subplots(2, len(views), squeeze=False, sharex=True)
    for column, (rows, cols) in enumerate(views):
        for bounces in (1, 2):
            name = f"{rows} x {cols}, {'one mirror' if bounces == 1 else 'two mirrors'} per view"
            _side_view(grid[bounces - 1, column], found[BOX_FOLDS_DEG[0], rows, cols, bounces], name)
        grid[1, column].set_xlabel("x of the views, mm")
    for axes in grid[:, 0]:
        axes.set_ylabel("depth (z of the views), mm")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=90)


def main(views: Sequence[tuple[int, int]], workers: int, picture: Path | None) -> None:
    boxes = {fold: box_of(fold) for fold in BOX_FOLDS_DEG}
    for fold, box in boxes.items():
        print(f"box of the default design at {fold:g} deg: " + " x ".join(f"{side:.1f}" for side in box) + " mm")
    found = searched(views, boxes, workers)
    print("box   views  mirrors per view, fold, all; baselines mm, spread mm, usable by IPOPT, by rays, blocked,")
    print(f"      resolution mm, the same with the light of {REFLECTIVITY:g} per mirror, path mm,")
    print(f"      px moved by tilts of {TILT_DEG:g} deg, litres around pupil and mirrors")
    for key, one in found.items():
        print(line_of(key, one, traced(one)), flush=True)
    if picture:
        draw(found, picture)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--most-rows", type=int, default=3, help="leave out what has more rows of views")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--picture", type=Path, help="a PNG to write")
    arguments = parser.parse_args()
    main([one for one in VIEWS if one[0] <= arguments.most_rows], arguments.workers, arguments.picture)
