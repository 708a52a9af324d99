"""Depth on scenes that others rendered, beside OpenCV's stereo, and how true its own statement of error is.

`python -m benchmarks.light_field_depth_scenes [--every N] [--fast] SCENE[=TRUTH.pfm]...` scores scenes in the format
of the 4D Light Field Benchmark, of which every Nth view is taken. The truth is that of the scene, or a disparity map,
px per view step of the full grid; one that is smaller than the views lacks as much at every side. BadPix and MSE are
those of the benchmark; beside them stand the best of all pairs and settings of StereoSGBM, chosen by the truth. Errors
in standard deviations leave out what lies within 4 px of a depth edge of the truth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.light_field_depth import BORDER_PX, Disparity, best_stereo, scores, stereo
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, Quality
from mirrorcam.optics.light_field.io.formats.hci import HciScene, read_hci
from mirrorcam.optics.light_field.io.pfm import read_pfm

EDGE_PX = 4
EDGE_STEP_PX = 0.12
"""Second difference of the truth, px per view step of the full grid, that is a depth edge."""
RIGHT_PX = 0.5
CLASSES = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0])


@dataclass(frozen=True, eq=False)
class Judged:
    """A scene's scores, and the errors (n,) of its pixels: px of the farthest view, in sigmas, and confidence.

    `flat` marks those away from depth edges.
    """

    name: str
    views: str
    ours: dict[str, float]
    sgbm: dict[str, float]
    seconds: float
    pair_seconds: float
    error_px: FloatArray
    sigmas: FloatArray
    confidence: FloatArray
    flat: Any


def truth_of(scene: HciScene, path: Path | None, every: int) -> Disparity:
    """True disparity (v, u) of the central view, px per step of the views that are taken; NaN where not known."""
    if path is None:
        assert scene.disparity_px is not None, "no truth in the scene's folder"
        return scene.disparity_px
    given = read_pfm(path)
    height, width = scene.light_field.height_px, scene.light_field.width_px
    down, right = (height - given.shape[0]) // 2, (width - given.shape[1]) // 2
    truth = np.full((height, width), np.nan, np.float32)
    truth[down : down + given.shape[0], right : right + given.shape[1]] = given * np.float32(every)
    return truth


def at_edges(truth: Disparity, every: int) -> Any:
    """Mask (v, u) of pixels within EDGE_PX of a depth edge."""
    bend = np.abs(cv2.Laplacian(np.nan_to_num(truth / every), cv2.CV_32F, ksize=1))
    side = 2 * EDGE_PX + 1
    return np.asarray(cv2.dilate((bend > EDGE_STEP_PX).astype(np.uint8), np.ones((side, side), np.uint8))) > 0


def judged(name: str, scene: HciScene, truth: Disparity, every: int, quality: Quality) -> Judged:
    """Measure depth and compare it with the truth and with StereoSGBM."""
    light_field = scene.light_field
    near, far = scene.depth_range_mm or (None, None)
    estimator = DepthEstimator(light_field, near_mm=near, far_mm=far, quality=quality)
    estimator.estimate(light_field)
    start = time.process_time()
    found = estimator.estimate(light_field)
    seconds = time.process_time() - start
    start = time.process_time()
    stereo(scene, "right", 5, 1.0, cv2.STEREO_SGBM_MODE_SGBM)
    pair_seconds = time.process_time() - start
    disparity = found.disparity_px().astype(np.float32)
    best, _ = best_stereo(HciScene(light_field, truth, scene.disparity_range_px), every)
    inner = (slice(BORDER_PX, -BORDER_PX),) * 2
    steps = max(light_field.cols, light_field.rows) // 2
    error = (np.abs(disparity - truth) * steps)[inner].ravel()
    usable = np.isfinite(error)
    return Judged(
        name,
        f"{light_field.rows}x{light_field.cols}, step {every}",
        scores(disparity, truth, every),
        best,
        seconds,
        pair_seconds,
        error[usable],
        (error / sigma_px(found)[inner].ravel())[usable],
        found.confidence[inner].ravel()[usable],
        ~at_edges(truth, every)[inner].ravel()[usable],
    )


def sigma_px(found: DepthMap) -> FloatArray:
    """Standard deviation (v, u) in px of the farthest view's motion."""
    views = found.views
    distance = found.depth_mm.astype(np.float64) - views.reference_view_depth_mm
    reach = views.focal_px * float(np.abs(views.positions_mm[..., :2]).max())
    return np.asarray(found.sigma_mm / np.square(distance) * reach)


def report(results: Sequence[Judged]) -> None:
    """Print the scores, and how often depth of each class of confidence is right."""
    print("scene          views          BadPix.07 % / MSE x 100   best SGBM       |e|/sigma  >3 sigma  times one pair")
    for each in results:
        flat = each.sigmas[each.flat]
        print(
            f"{each.name:14} {each.views:14} {each.ours['bad']:8.2f} / {each.ours['mse']:6.2f}     "
            f"{each.sgbm['bad']:6.2f} / {each.sgbm['mse']:6.2f}  {np.median(flat):8.2f}  {np.mean(flat > 3):7.1%} "
            f"{each.seconds / each.pair_seconds:10.1f}"
        )
    print("\nconfidence: its mean, and the share of pixels that are right to half a pixel of the farthest view")
    confidence = np.concatenate([each.confidence for each in results])
    right = np.concatenate([each.error_px for each in results]) < RIGHT_PX
    for low, high in pairwise(CLASSES):
        within = (confidence >= low) & (confidence < high)
        if within.any():
            share, mean = right[within].mean(), confidence[within].mean()
            print(f"  {low:.2f} to {high:.2f}: {mean:.3f}, right {share:.3f}; {within.mean():6.1%} of the pixels")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE[=TRUTH.pfm]")
    parser.add_argument("--every", type=int, default=1, help="take every Nth view of a whole scene")
    parser.add_argument(
        "--step", type=int, help="steps of the full grid between views, where a folder holds a part of it"
    )
    parser.add_argument("--fast", action="store_true")
    options = parser.parse_args()
    results = []
    for given in options.scenes:
        folder, _, truth = given.partition("=")
        scene = read_hci(Path(folder), every=options.every)
        every = options.step or options.every
        disparity = truth_of(scene, Path(truth) if truth else None, every)
        quality: Quality = "fast" if options.fast else "best"
        results.append(judged(Path(folder).name, scene, disparity, every, quality))
        report(results[-1:])
    if len(results) > 1:
        report(results)


if __name__ == "__main__":
    main()
