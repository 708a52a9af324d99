"""Write the page of the comparison, docs/compared.md, and its figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.cameras_compared.cameras import FAR_MM, NEAR_MM, ComparedCamera
from benchmarks.cameras_compared.measures import Measured, inner
from benchmarks.records import TIMES, Table
from mirrorcam.core.disk.files import write_text

BANDS_MM = ((300.0, 400.0), (400.0, 500.0), (500.0, 600.0))
WRONG = 0.02
"""Relative error beyond which a depth is wrong."""
SURE = 0.9
"""Stated confidence from which a depth counts as sure: below, its sigma includes that it may be wrong."""

Results = Sequence[tuple[ComparedCamera, Mapping[str, Measured]]]


def pooled(camera: ComparedCamera, measured: Mapping[str, Measured], name: str) -> Any:
    """Return the values (n,) of a map of all scenes, within the field."""
    return np.concatenate([inner(camera.views, getattr(result, name)).ravel() for result in measured.values()])


def row(camera: ComparedCamera, measured: Mapping[str, Measured]) -> list[str]:
    """Return the cells of a camera."""
    maps = ("true_mm", "depth_mm", "sigma_mm", "confidence", "bound_mm")
    true, depth, sigma, confidence, bound = (pooled(camera, measured, name) for name in maps)
    error, is_sure = np.abs(depth - true), confidence >= SURE
    depths = []
    for low, high in BANDS_MM:
        band = (true >= low) & (true < high)
        sure = band & is_sure
        if not sure.any():
            depths.append("none sure")
            continue
        values = (np.median(values[sure]) for values in (error, sigma, bound))
        depths.append("{:.2f} ({:.2f}), {:.2f}; {:.0f} %".format(*values, 100.0 * sure.sum() / band.sum()))
    within = (true >= BANDS_MM[0][0]) & (true < BANDS_MM[-1][1])
    is_wrong = ~(error <= WRONG * true)
    wrong = [100.0 * is_wrong[chosen].mean() for chosen in (within, within & is_sure)]
    refocus, viewpoint = (
        np.mean([getattr(result, name) for result in measured.values()]) for name in ("refocus_db", "viewpoint_db")
    )
    pair = "{:.0f} {} {:.0f}".format
    return [
        camera.name,
        str(camera.view_count),
        f"{camera.view_px[0]} {TIMES} {camera.view_px[1]}",
        pair(camera.baseline_mm[0], TIMES, camera.baseline_mm[1]),
        pair(camera.field_mm[0], TIMES, camera.field_mm[1]),
        camera.price,
        camera.rate,
        *depths,
        "{:.1f}; {:.1f}".format(*wrong),
        f"{refocus:.1f}",
        f"{viewpoint:.1f}",
    ]


DESCRIBED = (
    "camera",
    "views",
    "pixels per view",
    "reach of the viewpoint (largest baseline), mm",
    "common field at 400 mm, mm",
    "price",
    "frames per second",
)
COLUMNS = (
    *DESCRIBED,
    *(f"depth at {low:.0f} to {high:.0f} mm" for low, high in BANDS_MM),
    "wrong depths, %",
    "refocus, dB",
    "new viewpoint, dB",
)


def columns(table: Table, names: Sequence[str]) -> Table:
    """Return some columns of a table."""
    chosen = [table.columns.index(name) for name in names]
    return Table(columns=tuple(names), rows=tuple(tuple(cells[index] for index in chosen) for cells in table.rows))


def write_page(docs: Path, table: Table, values: Mapping[str, str]) -> None:
    """Write docs/compared.md from the table of all columns and the texts of its settings."""
    template = Path(__file__).with_name("page.md").read_text(encoding="utf-8")
    tables = {
        "described": columns(table, DESCRIBED).markdown(),
        "measured": columns(table, ("camera", *COLUMNS[len(DESCRIBED) :])).markdown(),
    }
    write_text(docs / "compared.md", template.format(**tables, **values))


def draw(path: Path, results: Results, scene: str) -> None:
    """Draw each camera's central view, depth and refocused picture of a scene."""
    figure, axes = plt.subplots(3, len(results), figsize=(2.0 * len(results), 4.6), constrained_layout=True)
    for column, (camera, measured) in zip(axes.T, results, strict=True):
        result = measured[scene]
        pictures: tuple[Any, ...] = (result.picture, result.depth_mm, result.refocused)
        for axis, picture in zip(column, pictures, strict=True):
            shown = inner(camera.views, picture)
            height = round(200 * shown.shape[0] / shown.shape[1])
            shown = cv2.resize(shown, (200, height), interpolation=cv2.INTER_AREA)
            colours = {"cmap": "gray", "vmin": 0, "vmax": 255} if shown.dtype == np.uint8 else {}
            if picture is result.depth_mm:
                colours = {"cmap": "turbo_r", "vmin": NEAR_MM, "vmax": FAR_MM}
            axis.imshow(shown, **colours)
            axis.set(xticks=[], yticks=[])
        column[0].set_title(camera.name, fontsize=9)
    for axis, label in zip(axes[:, 0], ("central view", "depth", "refocused at 400 mm"), strict=True):
        axis.set_ylabel(label, fontsize=9)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)
