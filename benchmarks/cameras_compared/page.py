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
from benchmarks.records import TIMES, table
from mirrorcam.core.disk.files import write_text

BANDS_MM = ((300.0, 400.0), (400.0, 500.0), (500.0, 600.0))
WRONG = 0.02
"""Relative error beyond which a depth is wrong."""

Results = Sequence[tuple[ComparedCamera, Mapping[str, Measured]]]

_TEXT = """# Which camera to buy

MirrorCam beside other cameras that refocus, measure depth and shift the viewpoint, in simulation, at 300 to 600 mm.
`python -m benchmarks.cameras_compared` renders the pictures, measures, and writes this page and its figure.

{table}

![Central view, depth and refocused picture of the scene {scene} for each camera](images/compared.png)

## Do not build a MirrorCam if

{verdict}

## How it is measured

- **Scenes**: `slant`, `foliage` and `gloss` of `benchmarks.depth_scenes`, path-traced, as miniatures of a tenth of their
  size. All cameras look at the same {field} mm at 400 mm, with all the pixels that they have for it.
- **Distances** are from the camera's pupil. The mirror camera's views lie 120 mm behind it, which costs it depth.
- **Sensors** have the same noise, as of a C920: {noise}. Lenses are in focus at 400 mm and have the same blur. There is
  no JPEG, no mosaic, and no error of calibration or synchronisation for any camera.
- **Depth**: `estimate_depth` for all, with the same settings, over pixels of the three scenes together. Median error, in
  brackets the median of its stated standard deviation, then the median of the Cram\N{LATIN SMALL LETTER E WITH ACUTE}r-Rao bound of a window of 25 px
  that shares one depth. The estimator also uses that surfaces are smooth, so it can be better than the bound where
  there is little texture. Wrong: more than 2 % off, or none.
- **Refocus**: PSNR against a lens of 30 mm (50 mm at f/1.7) in the place of the views, focused at 400 mm. The camera's
  picture is the mean of views rendered by its depth within that lens, as far as its views reach.
- **New viewpoint**: the box within which views can be rendered, and the PSNR halfway to its outermost view.
- **Lytro Illum**: its pixels under a microlens are grouped by 3 {times} 3 into 21 views, each with the noise of all rays
  it stands for. It is zoomed to the mirror camera's field of 184 mm.
- **RealSense D435**: {dots} dots on the surfaces, in grey, with this project's estimator, not with its own. Intel states
  an error of at most 2 % at 2 m; as an error of disparity, that is {stated} mm at 350, 450 and 550 mm. It does not measure
  nearer than 280 mm at this resolution. Refocus and viewpoint use its pair without dots.

## Sources

Prices in EUR are this project's estimates ([cad/plan/prices.py](../cad/plan/prices.py)), and include the webcam; fewer
mirrors do not make a device cheaper, a cheaper webcam does.

| camera | figures | source |
|---|---|---|
| Logitech C920 | field of view, size | [optics/geometry/cameras/c920.toml](../optics/geometry/cameras/c920.toml) names them |
| Lytro Illum | price at launch | <https://www.engadget.com/2014-04-22-lytro-illum.html> |
| | f/2 at all zooms, 30 to 250 mm equivalent | <https://slashgear.com/lytro-illum-is-this-the-photographic-revolution-22326102> |
| | 7728 {times} 5368 px | <https://github.com/QUALINET/databases>, EPFL light field image dataset |
| | 15 {times} 15 views of 625 {times} 434 px, pixels of 1.4 \N{MICRO SIGN}m, microlenses of 20 \N{MICRO SIGN}m, 40 megarays | from memory: its raw metadata and Light Field Toolbox |
| RealSense D435 | 1.93 mm, 3 \N{MICRO SIGN}m, 50 mm | <https://community.intel.com/t5/Items-with-no-label/Why-do-the-D435-has-such-a-wide-distance-range-from-15mm-10000mm/m-p/676278> |
| | 5000 dots | <https://dev.intelrealsense.com/docs/projectors> |
| | field of its projector | <https://manualshive.com/ru/manual/framos/d435e/2326519?page=8> |
| | frame rates | <https://pastebin.com/1rv2VKrC>, what a D435i lists |
| | 2 % at 2 m, 280 mm | from memory: its data sheet, Intel 337029 |
"""


def pooled(camera: ComparedCamera, measured: Mapping[str, Measured], name: str) -> Any:
    """Return the values (n,) of a map of all scenes, within the field."""
    return np.concatenate([inner(camera.views, getattr(result, name)).ravel() for result in measured.values()])


def row(camera: ComparedCamera, measured: Mapping[str, Measured]) -> list[str]:
    """Return the cells of a camera."""
    maps = ("true_mm", "depth_mm", "sigma_mm", "bound_mm")
    true, depth, sigma, bound = (pooled(camera, measured, name) for name in maps)
    error = np.abs(depth - true)
    depths = []
    for low, high in BANDS_MM:
        band = (true >= low) & (true < high)
        values = (np.nanmedian(error[band]), np.nanmedian(sigma[band]), np.median(bound[band]))
        depths.append("{:.2f} ({:.2f}), {:.2f}".format(*values))
    within = (true >= BANDS_MM[0][0]) & (true < BANDS_MM[-1][1])
    wrong = np.mean(~(error[within] <= WRONG * true[within]))
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
        *depths,
        f"{100.0 * wrong:.1f}",
        f"{refocus:.1f}",
        f"{viewpoint:.1f}",
        camera.price,
        camera.rate,
    ]


COLUMNS = (
    "camera",
    "views",
    "pixels a view",
    "baseline and reach of a new viewpoint, mm",
    "common field at 400 mm, mm",
    *(f"depth at {low:.0f} to {high:.0f} mm: error (sigma), bound, mm" for low, high in BANDS_MM),
    "wrong depth, %",
    "refocus, dB",
    "new viewpoint, dB",
    "price",
    "frames per second",
)


def write_page(docs: Path, results: Results, verdict: str, values: Mapping[str, str]) -> None:
    """Write docs/compared.md from measured results, a verdict and the texts of its settings."""
    rows = table(COLUMNS, [row(camera, measured) for camera, measured in results])
    write_text(docs / "compared.md", _TEXT.format(table=rows.markdown(), verdict=verdict, times=TIMES, **values))


def draw(path: Path, results: Results, scene: str) -> None:
    """Draw each camera's central view, depth and refocused picture of a scene."""
    figure, axes = plt.subplots(3, len(results), figsize=(2.0 * len(results), 4.6), constrained_layout=True)
    for column, (camera, measured) in zip(axes.T, results, strict=True):
        result = measured[scene]
        for axis, picture in zip(column, (result.picture, result.depth_mm, result.refocused), strict=True):
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
