"""Pictures of light fields against truth, and what they cost: `python -m benchmarks.light_field_images [SCENE...]`.

SCENE: folders of `mirrorcam scene`, decoded by the layout as built. Refocused pictures are compared with what a pinhole
at the central view sees, as soft as lens and lookup make it (sigma .95 px), where it lies within a quarter pixel of
the plane (farthest view) in every view and is matte: what is in focus, and hidden from none. Sharp pictures are
compared wherever there is a sample; a held-out view is rendered without its own samples from those of the others.

Costs are of a light field without content, 3x3 views of 400x240 px unless stated, beside a bare cv2.remap of as many
samples in the same run; medians of 9 rounds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG, Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.equalisation import measure
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.perspective import all_in_focus, seen_from
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, aperture, homography, refocus
from mirrorcam.optics.light_field.render.view_depths import ViewDepths
from mirrorcam.render_scenes.tabletop.tabletop_set import MASK, TabletopSet, read_map

SOFTNESS_PX = 0.95
IN_FOCUS_PX = 0.25
FEWEST_PIXELS = 300
ROUNDS = 9


def psnr(image: NDArray[Any], true: NDArray[Any], where: NDArray[np.bool_]) -> float:
    """Peak signal-to-noise ratio of pictures (v, u, c), 0 to 255."""
    return float(10.0 * np.log10(255.0**2 / np.mean(np.square(image - true)[where])))


def true_view(folder: Path, t: int, s: int) -> NDArray[np.float64]:
    """The picture of a pinhole at a view (v, u, c), as soft as lens and lookup make it."""
    view = read_image(folder / f"truth/views/{t}_{s}.png").astype(np.float64)
    return np.asarray(cv2.GaussianBlur(view, (0, 0), SOFTNESS_PX))


def in_focus_everywhere(folder: Path, light_field: LightField, depth_mm: float) -> NDArray[np.bool_]:
    """Pixels (v, u) of the central view that show, in every view, a matte thing on the plane at a depth."""
    t, s = TabletopSet.load(folder).central_view
    plane = FocalPlane.at_depth(light_field, depth_mm)
    size = light_field.width_px, light_field.height_px
    where = read_image(folder / f"truth/mask/{t}_{s}.png", grey=True) == MASK["matte"]
    reach_mm = np.abs(light_field.positions_mm[..., :2]).max()
    for index in np.ndindex(light_field.rows, light_field.cols):
        depth = read_map(folder / f"truth/depth/{index[0]}_{index[1]}.exr", "depth")
        off_px = reach_mm * (light_field.slope_from_depth(depth) - light_field.slope_from_depth(depth_mm))
        blurred = (~(np.abs(off_px) <= IN_FOCUS_PX) | ~light_field.valid[index]).astype(np.float32)
        matrix = homography(light_field, index, plane)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        where &= np.asarray(cv2.warpPerspective(blurred, matrix, size, flags=flags, borderValue=1.0)) == 0
    return where


def decoded(folder: Path) -> LightField:
    """The frame of a tabletop set, by the layout as built, its views made equally bright."""
    decoder = Decoder(Layout.load(folder / "truth/layout.json"))
    frame = read_image(folder / TabletopSet.load(folder).frame_name)
    return decoder.equalised(measure([decoder.decode(frame)])).decode(frame)


def quality(folder: Path, rows: Rows) -> None:
    """Add rows, and print how near pictures of a tabletop set are to what pinholes see."""
    light_field = decoded(folder)
    t, s = TabletopSet.load(folder).central_view
    true, central = true_view(folder, t, s), light_field.samples[t, s].astype(np.float64)
    print(
        f"{folder.name}: {light_field.cols}x{light_field.rows} views of {light_field.width_px}x{light_field.height_px}"
    )
    for depth_mm in (310.0, 375.0, 500.0, 600.0):
        where = in_focus_everywhere(folder, light_field, depth_mm)
        if np.count_nonzero(where) < FEWEST_PIXELS:
            continue
        plane = FocalPlane.at_depth(light_field, depth_mm)
        mean, median = (psnr(refocus(light_field, plane, combine=c).image * 255.0, true, where) for c in _COMBINE)
        alone = psnr(central, true, where)
        pixels = f"{np.count_nonzero(where)}"
        rows.add(folder.name, f"{depth_mm:.0f} mm", pixels, f"{mean:.1f}", f"{median:.1f}", f"{alone:.1f}")
    depths = ViewDepths.measured(light_field)
    known = light_field.valid[t, s]
    sharp = all_in_focus(light_field, depths).image * 255.0
    print(f"  all in focus {psnr(sharp, true, known):.1f} dB, central view alone {psnr(central, true, known):.1f} dB")
    for index in ((t, s + 1), (t - 1, s)):
        weights = light_field.weights.copy()
        weights[index] = 0.0
        rest = LightField.of(light_field, light_field.samples, weights)
        picture = seen_from(rest, depths, light_field.positions_mm[index])
        there = picture.valid & light_field.valid[index]
        print(f"  held-out view {index}: {psnr(picture.image * 255.0, true_view(folder, *index), there):.1f} dB")


_COMBINE: Any = ("mean", "median")


def plain(rows: int, cols: int, width_px: int, height_px: int) -> LightField:
    """A light field of noise."""
    across, down = np.meshgrid(np.arange(cols) - cols // 2, np.arange(rows) - rows // 2)
    views = Views(
        positions_mm=np.stack([across, down, 0 * across], axis=-1).astype(np.float64) * 20.0,
        focal_px=3.0 * width_px,
        centre_px=np.array([width_px, height_px]) / 2.0,
        width_px=width_px,
        height_px=height_px,
        reference_depth_mm=375.0,
        reference_view_in_rig_mm=np.array([0.0, -80.0, 90.0]),
        view_from_rig=np.array(FOLD_90_VIEW_FROM_RIG),
        layout_identity="0" * 16,
    )
    shape = rows, cols, height_px, width_px
    samples = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    return LightField.of(views, samples, np.ones(shape, np.float32))


def milliseconds(work: Callable[[], object]) -> float:
    """Median time of a round."""
    work()
    rounds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        rounds.append(time.perf_counter() - start)
    return 1e3 * statistics.median(rounds)


def bare(light_field: LightField) -> Callable[[], object]:
    """One lookup of all samples."""
    flat = light_field.samples.reshape(-1, light_field.width_px, 3)
    u, v = np.meshgrid(np.arange(flat.shape[1], dtype=np.float32), np.arange(flat.shape[0], dtype=np.float32))
    return lambda: cv2.remap(flat, u, v, cv2.INTER_LINEAR)


def costs() -> None:
    """Print what pictures cost, and how that grows."""
    light_field = plain(3, 3, 400, 240)
    flat, tilted = (FocalPlane.at_depth(light_field, 400.0, (tilt, 0.0)) for tilt in (0.0, 20.0))
    every: dict[str, Callable[[], object]] = {
        "bare cv2.remap": bare(light_field),
        "mean": lambda: refocus(light_field, flat),
        "mean, tilted": lambda: refocus(light_field, tilted),
        "weighted": lambda: refocus(light_field, flat, view_weights=aperture(light_field)),
        "median": lambda: refocus(light_field, flat, combine="median"),
        "mean, 2x": lambda: refocus(light_field, flat, scale=2),
    }
    print("3x3 views of 400x240")
    for name, work in every.items():
        spent = milliseconds(work)
        print(f"  {name:16s} {spent:7.1f} ms {1e3 / spent:7.1f}/s")
    print("mean: views and pixels")
    for rows, width, height in ((3, 400, 240), (5, 400, 240), (7, 400, 240), (3, 800, 480), (3, 1600, 960)):
        grown = plain(rows, rows, width, height)
        plane = FocalPlane.at_depth(grown, 400.0)
        spent, least = milliseconds(lambda: refocus(grown, plane)), milliseconds(bare(grown))  # noqa: B023
        print(f"  {rows}x{rows} of {width}x{height}: {spent:7.1f} ms, {spent / least:.1f} bare lookups")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE")
    add_json_option(parser)
    options = parser.parse_args()
    if options.scenes:
        found = Rows("scene", "focus", "pixels", "mean, dB", "median, dB", "central view alone, dB")
        for each in options.scenes:
            quality(each, found)
        write_record(options.json, "light_field_images", table=found.table)
    costs()
