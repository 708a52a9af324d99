"""Compare the mirror camera with other cameras at 300 to 600 mm: depth, refocusing and new viewpoints, in simulation.

`python -m benchmarks.cameras_compared` renders four scenes as seven cameras see them, and writes docs/compared.md and
docs/images/compared.png. The same program gives the same figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from benchmarks.cameras_compared.cameras import FIELD_MM, cameras
from benchmarks.cameras_compared.measures import Measured, measure
from benchmarks.cameras_compared.page import BANDS_MM, COLUMNS, SURE, draw, row, write_page
from benchmarks.cameras_compared.pictures import DOTS, SENSOR
from benchmarks.depth_scenes.foliage import foliage
from benchmarks.depth_scenes.gloss import gloss
from benchmarks.depth_scenes.rendered_scene import RenderedScene, Scene
from benchmarks.depth_scenes.rods import rods
from benchmarks.depth_scenes.slant import slant
from benchmarks.records import ROOT, TIMES, Rows

SCENES: dict[str, Callable[[int], Scene]] = {"slant": slant, "foliage": foliage, "gloss": gloss, "rods": rods}
SEED = 1
SHOWN = "gloss"
STATED_ERROR, STATED_AT_MM = 0.02, 2000.0
"""Depth error of the D435, as its data sheet states it."""


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    compared = list(cameras())
    results: list[dict[str, Measured]] = [{} for _ in compared]
    for name, scene_of in SCENES.items():
        scene = RenderedScene(scene_of(SEED))
        for number, (camera, measured) in enumerate(zip(compared, results, strict=True)):
            print(f"{name}: {camera.name}", flush=True)
            measured[name] = measure(scene, camera, 1000 * number + SEED)
    rows = Rows(*COLUMNS)
    for camera, measured in zip(compared, results, strict=True):
        rows.add(*row(camera, measured))
    docs = ROOT / "docs"
    together = list(zip(compared, results, strict=True))
    draw(docs / "images" / "compared.png", together, SHOWN)
    # Noise of disparity is constant, so noise of depth grows with the distance squared.
    stated = (STATED_ERROR * (sum(band) / 2.0) ** 2 / STATED_AT_MM for band in BANDS_MM)
    values = {
        "scene": SHOWN,
        "scenes": ", ".join(f"`{name}`" for name in SCENES),
        "sure": f"{SURE:g}",
        "field": f"{FIELD_MM[0]:.0f} {TIMES} {FIELD_MM[1]:.0f}",
        "noise": f"{SENSOR.full_well_electrons:,.0f} electrons at white, "
        f"read noise of {SENSOR.read_noise_grey:g} grey levels",
        "dots": f"{DOTS:,}",
        "stated": ", ".join(f"{error:.2f}" for error in stated),
    }
    write_page(docs, rows.table, values)


if __name__ == "__main__":
    main()
