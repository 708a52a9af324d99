"""Scenes that are hard for depth estimation, with true disparity, in the format of the 4D Light Field Benchmark.

`python -m benchmarks.depth_scenes FOLDER [--views 3|5|9] [--size 512] [NAME...]` renders them, each into a folder of
its name, and leaves alone what is there. `edges.png` in it is white where a pixel of the central view shows a step of
depth.

Printed for each: how far the other views, warped by the truth, are from the central one, in grey levels, where both
show the same surface away from edges of depth.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.depth_scenes.rendered_scene import STEP_MM, RenderedScene, depth_views
from benchmarks.depth_scenes.scenes import SCENES
from benchmarks.records import add_json_option, table, write_record
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.formats.hci import PARAMETERS, read_hci, write_hci
from mirrorcam.optics.light_field.light_field import LightField, Views

SPP = 256  # noise of half a grey level in most scenes
SEED = 1
SAME_SURFACE_PX = 0.05


def kept_paths(folder: Path, views: Views, spp: int) -> list[Path]:
    """Files beside a scene's folder of its finished pictures, row by row, named by their places in the whole grid."""
    places = np.rint(views.positions_mm[..., 1::-1] / STEP_MM).astype(int).reshape(-1, 2).tolist()
    kept = folder.with_name(f"{folder.name}.part")
    return [kept / f"{row:+d}{column:+d}_{views.width_px}_{spp}.png" for row, column in places]


def samples(scene: RenderedScene, views: Views, kept: list[Path], spp: int) -> NDArray[np.uint8]:
    """All pictures (t, s, v, u, 3) of a scene, those read that are finished."""
    found = np.empty((views.rows, views.cols, views.height_px, views.width_px, 3), np.uint8)
    for (t, s), path in zip(np.ndindex(views.rows, views.cols), kept, strict=True):
        if not path.exists():
            write_image(path, scene.picture(views, t, s, spp=spp))
        found[t, s] = read_image(path)
    return found


def residuals(scene: RenderedScene, light_field: LightField, edges: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """Of each other view warped to the central one by the true disparity: the grey levels (n,) by which they differ."""
    t, s = light_field.rows // 2, light_field.cols // 2
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in light_field.samples.reshape(-1, *edges.shape, 3)]
    centre = grey[t * light_field.cols + s].astype(np.float64)
    own = _disparity(scene, light_field, t, s)
    columns, rows = np.meshgrid(*(np.arange(length, dtype=np.float32) for length in edges.shape[::-1]))
    for index in np.ndindex(light_field.rows, light_field.cols):
        if index == (t, s):
            continue
        place = columns - own * np.float32(index[1] - s), rows - own * np.float32(index[0] - t)
        picture = cv2.remap(grey[index[0] * light_field.cols + index[1]].astype(np.float32), *place, cv2.INTER_LANCZOS4)
        theirs = cv2.remap(_disparity(scene, light_field, *index), *place, cv2.INTER_LINEAR, borderValue=np.nan)
        same = ~edges & (np.abs(theirs - own) < SAME_SURFACE_PX)
        yield np.abs(picture - centre)[same]


def _disparity(scene: RenderedScene, views: Views, t: int, s: int) -> NDArray[np.float32]:
    return views.disparity_px_from_depth(scene.depth_mm(views, t, s).astype(np.float64), "s").astype(np.float32)


def write_scene(
    folder: Path, name: str, *, count: int, size_px: int, spp: int = SPP, seed: int = SEED
) -> tuple[str, ...] | None:
    """Render a scene into a folder, unless it is there; continues after an interruption.

    Returns, unless it was there, grey levels by which warped views differ (median, and what 90 % are below), and how
    many pixels are on edges of depth.

    Raises InputError where the folder holds a scene of other views.
    """
    if (folder / PARAMETERS).exists():
        there = read_hci(folder).light_field
        if (there.rows, there.width_px) != (count, size_px):
            what = (
                f"holds {there.cols}x{there.rows} views of {there.width_px} px, asked for {count}x{count} of {size_px}"
            )
            raise InputError(f"{folder}: {what}; name another folder")
        print(f"{name}: is there")
        return None
    scene = RenderedScene(SCENES[name](seed))
    views = depth_views(count, size_px)
    kept = kept_paths(folder, views, spp)
    pictures = samples(scene, views, kept, spp)
    light_field = LightField.of(views, pictures, np.ones(pictures.shape[:4], np.float32))
    edges = scene.edges(views)
    write_image(folder / "edges.png", np.where(edges, 255, 0).astype(np.uint8))
    write_hci(folder, light_field, scene.depth_mm(views, count // 2, count // 2))
    for path in kept:
        path.unlink()
    if not any(kept[0].parent.iterdir()):
        kept[0].parent.rmdir()
    off = np.concatenate(list(residuals(scene, light_field, edges)))
    print(
        f"{name}: {count}x{count} views of {size_px} px; {edges.mean():.1%} of pixels on edges of depth; warped views "
        f"differ by {np.median(off):.2f} grey levels (median), {np.quantile(off, 0.9):.2f} (90 %)",
        flush=True,
    )
    return f"{np.median(off):.2f}", f"{np.quantile(off, 0.9):.2f}", f"{100.0 * edges.mean():.1f} %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(SCENES)}; all of them by default")
    parser.add_argument("--views", type=int, choices=(3, 5, 9), default=3)
    parser.add_argument("--size", type=int, default=512, help="side of each view, px")
    add_json_option(parser)
    request = parser.parse_args()
    wrong = sorted(set(request.names) - set(SCENES))
    if wrong:
        parser.error(f"unknown scene {wrong[0]!r}, expected of {', '.join(SCENES)}")
    found = {
        name: write_scene(request.folder / name, name, count=request.views, size_px=request.size)
        for name in request.names or SCENES
    }
    made = {f"`{name}`": figures for name, figures in found.items() if figures is not None}
    if made:
        lines = ("difference, grey levels: median", "90 % below", "pixels on edges of depth")
        rows = [(line, *(figures[n] for figures in made.values())) for n, line in enumerate(lines)]
        write_record(request.json, "depth_scenes", table=table(("", *made), rows))


if __name__ == "__main__":
    main()
