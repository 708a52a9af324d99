"""Scores of depth on scenes in the format of the 4D Light Field Benchmark."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.light_field_depth.reliability import MeasuredScene, reliability, sigma_px
from benchmarks.light_field_depth.stereo import Disparity, best_stereo, scores, stereo
from benchmarks.records import Rows
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pfm import read_pfm
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import choose_views
from mirrorcam.optics.light_field.depth import DepthEstimator, Quality
from mirrorcam.optics.light_field.io.formats.hci import HciScene, read_hci, write_hci
from mirrorcam.optics.light_field.light_field import LightField

DEFAULT_LAYOUT = Path(__file__).parents[2] / "tests" / "data" / "default_layout.json"
CLASSES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0)


@dataclass(frozen=True, eq=False)
class SceneScore:
    """A scene's scores and StereoSGBM's, the processor times of both, and the scene's errors."""

    measured: MeasuredScene
    ours: dict[str, float]
    sgbm: dict[str, float]
    seconds: float
    pair_seconds: float


def render_hci(folder: Path, *, size_px: int = 512, step_mm: float = 2.0, spp: int = 16, views: int = 9) -> None:
    """Render the tabletop scene with an even grid of square pinhole views about the central virtual camera, 9x9 as in
    the benchmark, and write it with its ground truth."""
    from mirrorcam.render_scenes.tabletop.tabletop import arrange_tabletop, clear_depth_mm
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
        light = scene.view(geometry, t, s, clear_depth_mm(layout), spp=spp, seed=100 * t + s)
        samples[t, s] = np.rint(255.0 * np.clip(light * np.float32(0.9), 0.0, 1.0) ** (1 / 2.2))
    hits = scene.hits(*pinhole_rays(geometry, views // 2, views // 2, clear_depth_mm(layout)))
    depth = np.where(hits.object_index < 0, np.nan, np.nan_to_num(hits.points) @ geometry.view_from_rig[2])
    light_field = LightField.of(geometry, samples, np.ones(samples.shape[:4], np.float32))
    write_hci(folder, light_field, depth.astype(np.float32))


def truth_of(scene: HciScene, path: Path | None, every: int) -> Disparity:
    """Return the true disparity (v, u) of the central view, px per step of the views; NaN where unknown."""
    if path is None:
        if scene.disparity_px is None:
            raise InputError(
                "a scene without ground truth: expected gt_disp_lowres.pfm in its folder, or SCENE=TRUTH.pfm"
            )
        return scene.disparity_px
    disparity = read_pfm(path)
    height, width = scene.light_field.height_px, scene.light_field.width_px
    down, right = (height - disparity.shape[0]) // 2, (width - disparity.shape[1]) // 2
    truth = np.full((height, width), np.nan, np.float32)
    truth[down : down + disparity.shape[0], right : right + disparity.shape[1]] = disparity * np.float32(every)
    return truth


def score_scene(scene: HciScene, truth: Disparity, every: int, quality: Quality) -> SceneScore:
    """Measure depth, and compare it with the truth and with the best result of StereoSGBM."""
    light_field = scene.light_field
    near, far = scene.depth_range_mm or (None, None)
    estimator = DepthEstimator(light_field, near_mm=near, far_mm=far, quality=quality)
    estimator.estimate(light_field)
    start = time.process_time()
    depth = estimator.estimate(light_field)
    seconds = time.process_time() - start
    start = time.process_time()
    stereo(scene, "right", 5, 1.0, cv2.STEREO_SGBM_MODE_SGBM)
    pair_seconds = time.process_time() - start
    disparity = depth.disparity_px().astype(np.float32)
    best, _ = best_stereo(replace(scene, disparity_px=truth), every)
    measured = MeasuredScene(
        disparity_px=disparity / np.float32(every),
        truth_px=truth / np.float32(every),
        sigma_px=sigma_px(depth),
        confidence=depth.confidence,
        farthest_steps=float(every * (max(light_field.cols, light_field.rows) // 2)),
    )
    return SceneScore(measured, scores(disparity, truth, every), best, seconds, pair_seconds)


def print_scores(scenes: Sequence[str], every: int, step: int | None, quality: Quality) -> Rows:
    """Print the scores of scenes, and how often depth is right in each class of confidence."""
    rows = Rows("scene", "views", "BadPix.07 %, MSE x 100", "best SGBM", "|e| / sigma", "> 3 sigma", "times one pair")
    results = []
    for text in scenes:
        folder, _, truth = text.partition("=")
        if not Path(folder).exists():
            print(f"rendering {folder} ...", flush=True)
            render_hci(Path(folder))
        scene = read_hci(Path(folder), every=every)
        view_step = step or every
        result = score_scene(scene, truth_of(scene, Path(truth) if truth else None, view_step), view_step, quality)
        results.append(result)
        flat = result.measured.flat_sigmas
        views = f"{scene.light_field.cols}x{scene.light_field.rows}, step {view_step}"
        both = (f"{score['bad']:.2f}, {score['mse']:.2f}" for score in (result.ours, result.sgbm))
        spread = f"{np.median(flat):.2f}", f"{np.mean(flat > 3):.1%}", f"{result.seconds / result.pair_seconds:.1f}"
        rows.add(Path(folder).name, views, *both, *spread)
    print("confidence: its mean, and the fraction of pixels that are right to half a pixel at the longest baseline")
    for group in reliability([result.measured for result in results], CLASSES):
        print(f"  {group.stated:.3f}, right {group.right:.3f} ({group.low:.3f} to {group.high:.3f}), {group.count} px")
    return rows
