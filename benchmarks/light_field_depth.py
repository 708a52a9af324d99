"""Depth of light fields beside OpenCV's stereo and beside the truth, and how fast it is.

`python -m benchmarks.light_field_depth hci FOLDER` scores depth from 3x3 of the 9x9 views of a scene in the format of
the 4D Light Field Benchmark; a folder that does not exist gets a rendered scene in that format first (minutes).
`... tabletop FOLDER [--json FILE]` compares with the truth of a set of `mirrorcam scene`.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.records import add_json_option, write_record
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder, choose_views
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.io.formats.hci import HciScene, read_hci, write_hci
from mirrorcam.optics.light_field.light_field import LightField, Views

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
Disparity = NDArray[np.float32]
# As the 4D Light Field Benchmark scores disparities (Honauer et al., ACCV 2016).
BORDER_PX = 15
BAD_PX = 0.07


def _errors(disparity_px: Disparity | FloatArray, truth_px: Disparity | FloatArray) -> FloatArray:
    """Errors (n,) of all pixels with a truth, less the border; NaN where there is no estimate."""
    inner = slice(BORDER_PX, -BORDER_PX)
    error = (np.asarray(disparity_px, dtype=np.float64) - truth_px)[inner, inner]
    return error[np.isfinite(truth_px[inner, inner])]


def bad_pixels(
    disparity_px: Disparity | FloatArray, truth_px: Disparity | FloatArray, threshold_px: float = BAD_PX
) -> float:
    """BadPix: the part, 0 to 1, of pixels whose disparity (v, u) is wrong by more than a threshold, or unknown."""
    return float(np.mean(~(np.abs(_errors(disparity_px, truth_px)) <= threshold_px)))


def mean_square_error(disparity_px: Disparity | FloatArray, truth_px: Disparity | FloatArray) -> float:
    """MSE, times 100 as the benchmark states it: of the pixels with an estimate, px^2."""
    return float(100.0 * np.nanmean(np.square(_errors(disparity_px, truth_px))))


def render_hci(folder: Path, *, size_px: int = 512, step_mm: float = 2.0, spp: int = 16, views: int = 9) -> None:
    """Photograph the tabletop scene with an even grid of square pinhole views about the central virtual camera, 9x9 as
    in the benchmark, and write it with its truth."""
    from mirrorcam.render_scenes.tabletop.tabletop import arrange_tabletop, nearest_mm
    from mirrorcam.render_scenes.tabletop.tabletop_scene import TabletopScene, pinhole_rays
    from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm

    layout = Layout.load(DEFAULT_LAYOUT)
    base = choose_views(layout, 375.0, "common")
    offsets = (np.arange(views) - views // 2) * step_mm
    grid = np.stack([*np.meshgrid(offsets, offsets), np.zeros((views, views))], axis=-1)
    geometry = replace(
        base,
        positions_mm=grid,
        focal_px=base.focal_px * size_px / base.width_px,
        centre_px=np.full(2, (size_px - 1) / 2.0),
        width_px=size_px,
        height_px=size_px,
    )
    scene = TabletopScene(layout, arrange_tabletop(layout, default_depths_mm(layout), 1), mirror_reflectance=0.92)
    samples = np.empty((views, views, size_px, size_px, 3), np.uint8)
    for t, s in np.ndindex(views, views):
        light = scene.view(geometry, t, s, nearest_mm(layout), spp=spp, seed=100 * t + s)
        samples[t, s] = np.rint(255.0 * np.clip(light * np.float32(0.9), 0.0, 1.0) ** (1 / 2.2))
    hits = scene.hits(*pinhole_rays(geometry, views // 2, views // 2, nearest_mm(layout)))
    depth = np.where(hits.object_index < 0, np.nan, np.nan_to_num(hits.points) @ geometry.view_from_rig[2])
    light_field = LightField.of(geometry, samples, np.ones(samples.shape[:4], np.float32))
    write_hci(folder, light_field, depth.astype(np.float32))


def filled(disparity: Disparity) -> Disparity:
    """A map whose gaps (NaN) take the farther of the nearest known disparities to the left and right of them."""
    numbers = np.arange(disparity.shape[1])
    result = disparity.copy()
    for row in result:
        known = np.flatnonzero(np.isfinite(row))
        if 0 < len(known) < len(row):
            left = known[np.clip(np.searchsorted(known, numbers, "right") - 1, 0, None)]
            right = known[np.clip(np.searchsorted(known, numbers), None, len(known) - 1)]
            gaps = ~np.isfinite(row)
            row[gaps] = np.minimum(row[left], row[right])[gaps]
    return result


def stereo(scene: HciScene, pair: str, block_px: int, smooth: float, mode: int) -> Disparity:
    """Disparity (v, u) of the central view by OpenCV's StereoSGBM from it and its neighbour on one side."""
    light_field = scene.light_field
    t, s = light_field.rows // 2, light_field.cols // 2
    neighbour = {"right": (t, s + 1), "left": (t, s - 1), "bottom": (t + 1, s), "top": (t - 1, s)}[pair]
    pictures = [
        np.asarray(cv2.cvtColor(light_field.samples[index], cv2.COLOR_RGB2BGR)) for index in ((t, s), neighbour)
    ]
    if pair in ("top", "bottom"):
        pictures = [picture.transpose(1, 0, 2) for picture in pictures]
    if pair in ("top", "left"):
        pictures = [picture[:, ::-1] for picture in pictures]
    low, high = scene.disparity_range_px or (0.0, 0.0)
    first = int(np.floor(low)) - 1
    matcher: Any = cv2.StereoSGBM.create(
        minDisparity=first,
        numDisparities=16 * int(np.ceil((high + 1 - first) / 16)),
        blockSize=block_px,
        P1=round(8 * 3 * block_px**2 * smooth),
        P2=round(32 * 3 * block_px**2 * smooth),
        disp12MaxDiff=1,
        uniquenessRatio=0,
        mode=mode,
    )
    # What lies beyond the picture's side cannot be matched there: the picture goes on as its edge.
    margin = 16 + max(abs(first), int(np.ceil(high)))
    wide = [cv2.copyMakeBorder(np.ascontiguousarray(p), 0, 0, margin, margin, cv2.BORDER_REPLICATE) for p in pictures]
    found = matcher.compute(*wide)[:, margin:-margin].astype(np.float32) / np.float32(16.0)
    found[found < first] = np.nan
    found = filled(found)
    if pair in ("top", "left"):
        found = found[:, ::-1]
    return found.T if pair in ("top", "bottom") else found


def best_stereo(scene: HciScene, every: int) -> tuple[dict[str, float], dict[str, str]]:
    """The least BadPix and the least MSE over all pairs and settings of StereoSGBM, each chosen with the truth.

    Settings are tried on all cores: OpenCV matches outside Python's lock.
    """
    truth = scene.disparity_px
    assert truth is not None
    best = {"bad": np.inf, "mse": np.inf}
    how = {"bad": "", "mse": ""}
    modes = {"sgbm": cv2.STEREO_SGBM_MODE_SGBM, "hh": cv2.STEREO_SGBM_MODE_HH, "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY}
    settings = list(product(("right", "left", "bottom", "top"), (1, 3, 5, 7, 9), (0.3, 1.0, 3.0), modes))

    def tried(setting: tuple[str, int, float, str]) -> dict[str, float]:
        pair, block, smooth, mode = setting
        return scores(stereo(scene, pair, block, smooth, modes[mode]), truth, every)

    with ThreadPoolExecutor(cores()) as threads:
        for (pair, block, smooth, mode), found in zip(settings, threads.map(tried, settings), strict=True):
            for name, value in found.items():
                if value < best[name]:
                    best[name], how[name] = value, f"{pair}, block {block}, smoothness {smooth}, {mode}"
    return best, how


def scores(disparity: Disparity, truth: Disparity, every: int) -> dict[str, float]:
    """BadPix(0.07) in percent and MSE x 100, in px per step of the full grid."""
    own, true = disparity / every, truth / every
    return {"bad": 100.0 * bad_pixels(own, true), "mse": mean_square_error(own, true)}


def our_disparity(scene: HciScene) -> Disparity:
    """Disparity (v, u) of the central view from all views."""
    near, far = scene.depth_range_mm or (None, None)
    found = DepthEstimator(scene.light_field, near_mm=near, far_mm=far).estimate(scene.light_field)
    return found.disparity_px().astype(np.float32)


def hci(folder: Path) -> None:
    if not folder.exists():
        print(f"rendering {folder} ...")
        render_hci(folder)
    for every in (4, 1):
        scene = read_hci(folder, every=every) if every > 1 else _inner(read_hci(folder))
        assert scene.disparity_px is not None
        ours = scores(our_disparity(scene), scene.disparity_px, every)
        best, how = best_stereo(scene, every)
        print(f"3x3 of 9x9 views, {every} steps apart      BadPix(0.07) %    MSE x 100")
        print(f"  depth from nine views              {ours['bad']:10.2f} {ours['mse']:14.3f}")
        print(f"  StereoSGBM, best pair and settings {best['bad']:10.2f} {best['mse']:14.3f}")
        print(f"    chosen with the truth: {how['bad']} / {how['mse']}")


def _inner(scene: HciScene) -> HciScene:
    """The innermost 3x3 views of a scene."""
    light_field = scene.light_field
    t, s = (slice(count // 2 - 1, count // 2 + 2) for count in (light_field.rows, light_field.cols))
    geometry: dict[str, Any] = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    views = Views(**(geometry | {"positions_mm": light_field.positions_mm[t, s]}))
    return replace(scene, light_field=LightField.of(views, light_field.samples[t, s], light_field.weights[t, s]))


def scene_errors(folder: Path) -> dict[str, float]:
    """Print errors of depth of a tabletop scene; those of 300 to 500 mm are returned as the figures of a record."""
    from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopSet, read_map

    manifest = TabletopSet.load(folder)
    t, s = manifest.central_view
    light_field = Decoder(Layout.load(folder / "truth/layout.json")).decode(read_image(folder / manifest.frame_name))
    found = DepthEstimator(light_field).estimate(light_field)
    truth = read_map(folder / f"truth/depth/{t}_{s}.exr", "depth")
    matte = read_image(folder / f"truth/mask/{t}_{s}.png", grey=True) == 1
    working = found.valid & (truth >= 300.0) & (truth <= 500.0)
    figures: dict[str, float] = {}
    for name, where in {
        "300 to 500 mm": working,
        "300 to 500 mm, matte": working & matte,
        "all, matte": found.valid & matte,
        "all, matte, confidence > 0.5": found.valid & matte & (found.confidence > 0.5),
    }.items():
        part = (np.abs(found.depth_mm - truth) / truth)[where]
        sigmas = (np.abs(found.depth_mm - truth) / found.sigma_mm)[where]
        figures = figures or {
            "median_percent": 100.0 * float(np.median(part)),
            "nine_of_ten_percent": 100.0 * float(np.quantile(part, 0.9)),
            "beyond_2_percent_percent": 100.0 * float(np.mean(part > 0.02)),
            "half_within_sigma": float(np.median(sigmas)),
        }
        print(
            f"{name:30} {where.mean():5.1%} of pixels, error of depth: median {np.median(part):.3%}, 90 % below "
            f"{np.quantile(part, 0.9):.2%}, more than 2 %: {np.mean(part > 0.02):.1%}; "
            f"median {np.median(sigmas):.2f} sigma"
        )
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", choices=("hci", "tabletop"))
    parser.add_argument("folder", type=Path)
    add_json_option(parser)
    options = parser.parse_args()
    if options.job == "hci":
        hci(options.folder)
    else:
        write_record(options.json, "light_field_depth", scene_errors(options.folder))


if __name__ == "__main__":
    main()
