"""Depth on scenes that others rendered, beside OpenCV's stereo, and how true its own statement of error is.

`python -m benchmarks.light_field_depth_scenes [--every N] [--fast] [--no-sgbm] SCENE[=TRUTH.pfm]...` scores scenes in
the format of the 4D Light Field Benchmark, of which every Nth view is taken. The truth is that of the scene, or a
disparity map, px per view step of the full grid; one that is smaller than the views lacks as much at every side. BadPix
and MSE are those of the benchmark; beside them stand the best of all pairs and settings of StereoSGBM, chosen by the
truth. Errors in standard deviations leave out what lies within 4 px of a depth edge of the truth.

`--figure FILE.png` draws how often depth of each stated probability is right and how errors in sigmas are distributed,
`--pictures FOLDER` maps of depth, errors and confidence of each scene.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.light_field_depth import Disparity, best_stereo, scores, stereo
from benchmarks.light_field_depth_errors import MeasuredScene, reliability, sigma_px
from benchmarks.light_field_depth_figures import draw_reliability, draw_scene
from mirrorcam.core.images.pfm import read_pfm
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.depth import DepthEstimator, Quality
from mirrorcam.optics.light_field.io.formats.hci import HciScene, read_hci

CLASSES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0)


@dataclass(frozen=True, eq=False)
class Judged:
    """A scene's scores beside those of StereoSGBM, which are NaN where it was left out, and its errors."""

    measured: MeasuredScene
    ours: dict[str, float]
    sgbm: dict[str, float]
    seconds: float
    pair_seconds: float


def truth_of(scene: HciScene, path: Path | None, every: int) -> Disparity:
    """True disparity (v, u) of the central view, px per step of the views that are taken; NaN where not known."""
    if path is None:
        if scene.disparity_px is None:
            raise InputError("a scene without a truth: expected gt_disp_lowres.pfm in its folder, or SCENE=TRUTH.pfm")
        return scene.disparity_px
    given = read_pfm(path)
    height, width = scene.light_field.height_px, scene.light_field.width_px
    down, right = (height - given.shape[0]) // 2, (width - given.shape[1]) // 2
    truth = np.full((height, width), np.nan, np.float32)
    truth[down : down + given.shape[0], right : right + given.shape[1]] = given * np.float32(every)
    return truth


def judged(
    name: str,
    scene: HciScene,
    truth: Disparity,
    every: int,
    quality: Quality,
    *,
    against: str = "true disparity",
    sgbm: bool = True,
) -> Judged:
    """Measure depth and compare it with the truth and, unless that is left out, with the best of StereoSGBM."""
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
    best = {"bad": np.nan, "mse": np.nan}
    if sgbm:
        best, _ = best_stereo(HciScene(light_field, truth, scene.disparity_range_px), every)
    samples = light_field.samples[found.view]
    measured = MeasuredScene(
        name=name,
        views=f"{light_field.rows}x{light_field.cols}, step {every}",
        against=against,
        image=np.broadcast_to(samples, (*samples.shape[:2], 3)),
        disparity_px=disparity / np.float32(every),
        truth_px=truth / np.float32(every),
        sigma_px=sigma_px(found),
        confidence=found.confidence,
        reach=float(every * (max(light_field.cols, light_field.rows) // 2)),
    )
    return Judged(measured, scores(disparity, truth, every), best, seconds, pair_seconds)


def report(results: Sequence[Judged]) -> None:
    """Print the scores, and how often depth of each class of confidence is right."""
    print("scene          views          BadPix.07 % / MSE x 100   best SGBM       |e|/sigma  >3 sigma  times one pair")
    for each in results:
        scene, flat = each.measured, each.measured.flat_sigmas
        print(
            f"{scene.name:14} {scene.views:14} {each.ours['bad']:8.2f} / {each.ours['mse']:6.2f}     "
            f"{each.sgbm['bad']:6.2f} / {each.sgbm['mse']:6.2f}  {np.median(flat):8.2f}  {np.mean(flat > 3):7.1%} "
            f"{each.seconds / each.pair_seconds:10.1f}"
        )
    print("\nconfidence: its mean, and the share of pixels that are right to half a pixel of the farthest view")
    classes = reliability([each.measured for each in results], CLASSES)
    for group in classes:
        print(
            f"  {group.stated:.3f}, right {group.right:.3f} ({group.low:.3f} to {group.high:.3f}); "
            f"{group.count / sum(c.count for c in classes):6.1%} of the pixels"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE[=TRUTH.pfm]")
    parser.add_argument("--every", type=int, default=1, help="take every Nth view of a whole scene")
    parser.add_argument(
        "--step", type=int, help="steps of the full grid between views, where a folder holds a part of it"
    )
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--no-sgbm", action="store_true", help="leave out the search for the best of StereoSGBM")
    parser.add_argument("--figure", type=Path, help="a PNG file: whether confidence and sigma are true")
    parser.add_argument("--pictures", type=Path, help="a folder for SCENE.png: depth, errors and confidence of each")
    options = parser.parse_args(arguments)
    results = []
    for given in options.scenes:
        folder, _, truth = given.partition("=")
        scene = read_hci(Path(folder), every=options.every)
        every = options.step or options.every
        disparity = truth_of(scene, Path(truth) if truth else None, every)
        quality: Quality = "fast" if options.fast else "best"
        against = f"disparity of {Path(truth).name}" if truth else "true disparity"
        name = Path(folder).name
        result = judged(name, scene, disparity, every, quality, against=against, sgbm=not options.no_sgbm)
        results.append(result)
        report([result])
        if options.pictures:
            draw_scene(options.pictures / f"{name}.png", result.measured)
    if len(results) > 1:
        report(results)
    if options.figure:
        draw_reliability(options.figure, [each.measured for each in results])


if __name__ == "__main__":
    main()
