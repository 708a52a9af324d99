"""Scenes that are hard for depth estimation, with true disparity, in the format of the 4D Light Field Benchmark.

`python -m benchmarks.depth_scenes FOLDER [--views 3|5|9] [--size 512] [--spread 1] [--seed 1] [NAME...]` renders them,
each into a folder of its name, unless it exists. `edges.png` there is white where a pixel of the central view shows a
step in depth.

Prints, for each, by how many grey levels the other views, warped by the truth, differ from the central one, where both
show the same surface away from depth edges.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.depth_scenes.foliage import foliage
from benchmarks.depth_scenes.gloss import gloss
from benchmarks.depth_scenes.rendered_scene import RenderedScene, Scene, depth_views
from benchmarks.depth_scenes.rods import rods
from benchmarks.depth_scenes.slant import slant
from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.light_field.io.formats.hci import PARAMETERS, write_hci
from mirrorcam.optics.light_field.light_field import LightField, Views

SCENES: dict[str, Callable[[int], Scene]] = {"slant": slant, "foliage": foliage, "gloss": gloss, "rods": rods}
SPP = 256  # noise of half a grey level in most scenes
SEED = 1
SAME_SURFACE_PX = 0.05


def residuals(scene: RenderedScene, light_field: LightField, edges: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """Yield the absolute grey differences (n,) of each other view, warped by true disparity, from the central one."""
    t, s = light_field.rows // 2, light_field.cols // 2
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in light_field.samples.reshape(-1, *edges.shape, 3)]
    centre = grey[t * light_field.cols + s].astype(np.float64)
    disparity = _disparity(scene, light_field, t, s)
    columns, rows = np.meshgrid(*(np.arange(length, dtype=np.float32) for length in edges.shape[::-1]))
    for index in np.ndindex(light_field.rows, light_field.cols):
        if index == (t, s):
            continue
        positions = columns - disparity * np.float32(index[1] - s), rows - disparity * np.float32(index[0] - t)
        picture = cv2.remap(
            grey[index[0] * light_field.cols + index[1]].astype(np.float32), *positions, cv2.INTER_LANCZOS4
        )
        other = cv2.remap(_disparity(scene, light_field, *index), *positions, cv2.INTER_LINEAR, borderValue=np.nan)
        is_same_surface = ~edges & (np.abs(other - disparity) < SAME_SURFACE_PX)
        yield np.abs(picture - centre)[is_same_surface]


def _disparity(scene: RenderedScene, views: Views, t: int, s: int) -> NDArray[np.float32]:
    return views.disparity_px_from_depth(scene.depth_mm(views, t, s).astype(np.float64), "s").astype(np.float32)


def write_scene(
    folder: Path, name: str, *, count: int, size_px: int, spread: float = 1.0, seed: int = SEED, spp: int = SPP
) -> tuple[str, ...] | None:
    """Render a scene into a folder, unless it exists there.

    Returns None if it exists; otherwise the grey differences of warped views (median and 90th percentile), and the
    percentage of pixels on depth edges.
    """
    if (folder / PARAMETERS).exists():
        print(f"{name}: exists")
        return None
    scene, views = RenderedScene(SCENES[name](seed)), depth_views(count, size_px, spread)
    samples = np.empty((count, count, size_px, size_px, 3), np.uint8)
    for t, s in np.ndindex(count, count):
        samples[t, s] = scene.picture(views, t, s, spp=spp)
    light_field = LightField.of(views, samples, np.ones(samples.shape[:4], np.float32))
    edges = scene.edges(views)
    write_image(folder / "edges.png", np.where(edges, 255, 0).astype(np.uint8))
    write_hci(folder, light_field, scene.depth_mm(views, count // 2, count // 2))
    differences = np.concatenate(list(residuals(scene, light_field, edges)))
    return f"{np.median(differences):.2f}", f"{np.quantile(differences, 0.9):.2f}", f"{100.0 * edges.mean():.1f} %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"some of {', '.join(SCENES)}; by default all")
    parser.add_argument("--views", type=int, choices=(3, 5, 9), default=3)
    parser.add_argument("--size", type=int, default=512, help="side of each view, px")
    parser.add_argument("--spread", type=float, default=1.0, help="distance between views, times the usual one")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the scene")
    add_json_option(parser)
    request = parser.parse_intermixed_args()
    unknown = sorted(set(request.names) - set(SCENES))
    if unknown:
        parser.error(f"unknown scene {unknown[0]!r}, expected one of {', '.join(SCENES)}")
    rows = Rows("scene", "difference, grey levels: median", "90 % below", "pixels on edges of depth")
    for name in request.names or SCENES:
        options = {"count": request.views, "size_px": request.size, "spread": request.spread, "seed": request.seed}
        cells = write_scene(request.folder / name, name, **options)
        if cells is not None:
            rows.add(name, *cells)
    write_record(request.json, "depth_scenes", table=rows.table)


if __name__ == "__main__":
    main()
