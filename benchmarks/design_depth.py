"""What a design for depth gains, predicted and measured on rendered pictures: `python -m benchmarks.design_depth`.

3x3, C920, scale 80 mm, depths 300 and 500 mm. For each fold the design for overlap and the one for depth, with their
figures; then the ratio of their standard deviations of depth. Measured: a board full of edges, square to the views at
each depth, is rendered for both (fast renderer, whole pupil) and exposed many times with the noise of a C920; the depth
of each window of 5 x 5 px of the central view is that at which the pictures, moved there, differ least from their mean.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.records import TIMES, add_json_option, short, table, write_record
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.depth_sigma import WINDOW_PX, depth_sigma_mm
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import common_region
from mirrorcam.optics.geometry.targets import Charuco
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings

FOLDS_DEG: tuple[float | Literal["auto"], ...] = (90.0, 120.0, "auto")
OBJECTIVES: tuple[Literal["overlap", "depth"], ...] = ("overlap", "depth")
SHOWN = ("usable_efficiency", "fov", "grid_error", "baseline", "depth_sigma", "longest_edge")

BOARD = Charuco(cols=40, rows=30, square_mm=6.0, marker_mm=4.5, dictionary="DICT_4X4_1000")
SENSOR = SENSORS["c920"].replaced(vignetting=0.0, jpeg_quality=None, readout_ms=0.0)
"""A C920 whose views are equally bright, and whose noise is that of pixels alone."""

STEPS_PER_PX = 2
"""Points at which views are compared, along each side of a pixel of the central view."""

CANDIDATES = np.arange(-3.0, 4.0)
"""Depths that are compared, in expected standard deviations from the true one."""


@dataclass(frozen=True)
class Windows:
    """Windows of the board, square to the views at a depth: their middles (n, 2) and size in mm, in view axes."""

    middles_mm: FloatArray
    side_mm: float
    depth_mm: float

    def points(self, depth_mm: float) -> FloatArray:
        """Points (n, k, 3) of the windows as a picture of the central view has them, moved to another depth."""
        count = round(np.sqrt(WINDOW_PX)) * STEPS_PER_PX
        along = ((np.arange(count) + 0.5) / count - 0.5) * self.side_mm
        x, y = (grid.ravel() for grid in np.meshgrid(along, along))
        across = self.middles_mm[:, None] + np.column_stack([x, y])
        return np.concatenate([across, np.full((*across.shape[:-1], 1), depth_mm)], axis=-1)


def fold_deg_of(layout: Layout) -> float:
    return float(np.degrees(np.arctan2(layout.view_from_rig[2, 1], layout.view_from_rig[2, 2])))


def windows_of(layouts: Sequence[Layout], depth_mm: float, spacing_mm: float = 4.0) -> Windows:
    """Windows in the region that all views of both layouts show; one size, that of the first's central view."""
    regions = [common_region(layout, depth_mm)[0] for layout in layouts]
    shared = regions[0].intersection(regions[1]).buffer(-4.0)
    left, low, right, high = shared.bounds
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(left, right, spacing_mm), np.arange(low, high, spacing_mm)))
    inside = shapely.contains_xy(shared, x, y)
    middles = np.column_stack([x, y])[inside]
    layout = layouts[0]
    ends = np.array([[*shared.centroid.coords[0], depth_mm]] * 3) + np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    px = layout.project(ends @ layout.view_from_rig, layout.central_index)
    density = abs(np.linalg.det(px[1:] - px[0]))
    return Windows(middles, float(np.sqrt(WINDOW_PX / density)), depth_mm)


def rendered(layout: Layout, depth_mm: float, middle_mm: FloatArray) -> FloatArray:
    """Radiance of the board square to the views at a depth, its middle at (2,)."""
    scene = FastScene(
        layout.camera, layout.mirrors, BOARD, RenderSettings(renderer="fast", sensor=SENSOR, maps=False), variant=None
    )
    view_from_board = np.eye(4)
    view_from_board[:3, 3] = [*(middle_mm - np.array(BOARD.size_mm) / 2.0), depth_mm]
    rig_from_view = np.eye(4)
    rig_from_view[:3, :3] = layout.view_from_rig.T
    scene.place_board(rig_from_view @ view_from_board)
    return np.asarray(scene.render())


def measured_sigma_mm(layout: Layout, windows: Windows, expected_mm: float, exposures: int) -> FloatArray:
    """Standard deviation (n,) over exposures of the depth of each window, by matching all views."""
    radiance = rendered(layout, windows.depth_mm, windows.middles_mm.mean(axis=0))
    depths = windows.depth_mm + CANDIDATES * expected_mm
    # A pixel of the central view shows the same ray at all depths: its points move towards that view's centre.
    centre = layout.virtual_centres_in_view_mm.reshape(-1, 3)[layout.central_index]
    places = []
    true = windows.points(windows.depth_mm)
    for depth in depths:
        moved = centre + (true - centre) * (depth - centre[2]) / (windows.depth_mm - centre[2])
        in_rig = moved @ layout.view_from_rig
        places.append([layout.project(in_rig, k).astype(np.float32) for k in range(len(layout.mirrors))])
    random = np.random.default_rng(0)
    found = [_matched(_exposed(radiance, layout, random), places, depths) for _ in range(exposures)]
    return np.asarray(np.std(found, axis=0, ddof=1))


def _exposed(radiance: FloatArray, layout: Layout, random: np.random.Generator) -> FloatArray:
    picture = photograph(radiance.astype(np.float32), 2, layout.camera, SENSOR, random)
    return np.asarray(picture, dtype=np.float32)


def _matched(picture: FloatArray, places: list[list[NDArray[np.float32]]], depths: FloatArray) -> FloatArray:
    """Depth (n,) of each window at the least of a parabola through the squared differences of views from their mean."""
    costs = []
    for of_views in places:
        shown = np.stack([cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LANCZOS4) for at in of_views])
        costs.append(np.square(shown - shown.mean(axis=0)).sum(axis=(0, 2)))
    curve, slope, _ = np.polyfit(depths - depths.mean(), np.array(costs), 2)
    return np.asarray(depths.mean() - slope / (2.0 * curve))


TITLES = (
    "sigma of depth at 300 / 500 mm",
    "usable efficiency at 300 / 500 mm",
    f"field of view, x {TIMES} y",
    f"baselines, x {TIMES} y",
    "grid error",
)


def figures_of(layout: Layout) -> tuple[str, ...]:
    """A layout's figures, in the order of `TITLES`."""

    def of(pattern: str, places: Sequence[object]) -> list[float]:
        return [layout.metrics[pattern.format(place)].value for place in places]

    sigmas, shares = (of(name, ("300", "500")) for name in ("depth_sigma_{}mm", "usable_efficiency_{}mm"))
    return (
        " / ".join(map(short, sigmas)) + " mm",
        " / ".join(map(short, shares)),
        f" {TIMES} ".join(f"{each:.1f}°" for each in of("fov_{}_deg", "xy")),
        f" {TIMES} ".join(f"{each:.0f}" for each in of("baseline_{}_mm", "xy")) + " mm",
        short(layout.metrics["grid_error"].value),
    )


def main(exposures: int, json: Path | None) -> None:
    head, columns, rendered_rows = [""], [], []
    gains: dict[str, float] = {}
    for fold in FOLDS_DEG:
        layouts = tuple(design(DesignSpec(fold_deg=fold, objective=goal)) for goal in OBJECTIVES)
        chosen = " and ".join(f"{fold_deg_of(layout):.0f}" for layout in layouts)
        print(f"\nfold {fold}: {chosen} deg")
        for goal, layout in zip(OBJECTIVES, layouts, strict=True):
            title = f"fold {fold:g}°: " if isinstance(fold, float) else "fold auto: "
            found_deg = "" if isinstance(fold, float) else f" ({fold_deg_of(layout):.0f}°)"
            head.append((title if goal == "overlap" else "") + goal + found_deg)
            columns.append(figures_of(layout))
        print(f"{'':26} overlap   depth")
        for name in layouts[0].metrics:
            if name.startswith(SHOWN):
                print(f"{name:26} {layouts[0].metrics[name].value:7.3f} {layouts[1].metrics[name].value:7.3f}")
        for depth in DesignSpec().depths_mm:
            windows = windows_of(layouts, depth)
            points = np.column_stack([windows.middles_mm, np.full(len(windows.middles_mm), depth)])
            predicted = [depth_sigma_mm(layout, points) for layout in layouts]
            measured = [
                measured_sigma_mm(layout, windows, float(expected.mean()), exposures)
                for layout, expected in zip(layouts, predicted, strict=True)
            ]
            textured = np.max(measured, axis=0) < 5.0 * np.median(measured)
            ratio, found = (float(np.median((b / a)[textured])) for a, b in (predicted, measured))
            name = f"{fold:g}" if isinstance(fold, float) else fold
            of_layouts = [layout.metrics[f"depth_sigma_{depth:g}mm"].value for layout in layouts]
            gains[f"gain_{name}_{depth:g}mm_percent"] = 100.0 * (1.0 - of_layouts[1] / of_layouts[0])
            rendered_rows.append((f"fold {name}{'°' * isinstance(fold, float)}, {depth:g} mm", ratio, found))
            print(
                f"{depth:g} mm: sigma of depth over that of the design for overlap, predicted {ratio:.3f}, measured "
                f"{found:.3f} ({found / ratio - 1.0:+.1%}), medians of {textured.sum()} of {textured.size} windows; "
                f"measured {np.median(measured[0][textured]):.4f} and {np.median(measured[1][textured]):.4f} mm"
            )
    rows = [(title, *cells) for title, *cells in zip(TITLES, *columns, strict=True)]
    write_record(json, "design_depth", gains, table(head, rows))
    apart = max(100.0 * abs(found / ratio - 1.0) for _, ratio, found in rendered_rows)
    cells = [(name, short(ratio), short(found)) for name, ratio, found in rendered_rows]
    write_record(json, "design_depth_rendered", {"apart_percent": apart}, table(("", "predicted", "measured"), cells))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--exposures", type=int, default=40)
    add_json_option(parser)
    options = parser.parse_args()
    main(options.exposures, options.json)
