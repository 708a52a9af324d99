"""Denoising and seeing through rain by 4-D filters: `python -m benchmarks.light_field_filters SCENE...`.

Scenes are folders in the format of the HCI benchmark with true disparity. Noise, or streaks of rain between the camera
and the nearest surface, are added to their views. Prints the peak signal-to-noise ratio (dB) of the central view
against the one without: of each filter between the true depths, with and without outliers left out; of the mean and the
median of the views as they lie (at the reference plane) and warped by the true depth, which no one else is told; and of
OpenCV's non-local means in the central view, of the best of six strengths, picked by the truth. --picture draws the
central view, filtered and not. Of each scene without noise, and of --decoded light fields (.npz), it prints by how many
grey levels the hyperfan changes views: root mean square of all and of the central one, and the median.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.filters import FilterKind, Passband, filter_light_field
from mirrorcam.optics.light_field.io.formats.hci import read_hci
from mirrorcam.optics.light_field.io.formats.npz import load_npz
from mirrorcam.optics.light_field.light_field import LightField, Views

Float32 = NDArray[np.float32]

STRENGTHS = (3, 6, 10, 15, 20, 30)
KINDS: tuple[FilterKind, ...] = ("hyperfan", "dual-fan", "hypercone")
STREAK_PX, OPACITY = (15.0, 40.0), (0.4, 0.8)
RAIN_GREY = 0.9
RAIN_NOISE_GREY = 2.0


def dB(found: Any, truth: Any) -> float:  # noqa: N802
    """Peak signal-to-noise ratio of values from 0 to 1."""
    return float(-10.0 * np.log10(np.square(np.clip(found, 0.0, 1.0) - truth).mean()))


def every(light_field: LightField, step: int, side_px: int) -> LightField:
    """Every `step`-th view from the central one, the upper left of it up to a side."""
    kept = tuple(slice((count // 2) % step, None, step) for count in (light_field.rows, light_field.cols))
    samples = light_field.samples[*kept, :side_px, :side_px].astype(np.float32) / np.float32(255.0)
    geometry = {field.name: getattr(light_field, field.name) for field in fields(Views)}
    height, width = samples.shape[2:4]
    changes = {"positions_mm": light_field.positions_mm[kept], "width_px": width, "height_px": height}
    return LightField.of(Views(**(geometry | changes)), samples, light_field.weights[*kept, :side_px, :side_px])


def with_noise(clean: LightField, grey: float, seed: int = 0) -> LightField:
    noise = np.random.default_rng(seed).normal(0.0, grey / 255.0, clean.samples.shape)
    return LightField.of(clean, (clean.samples + noise).astype(np.float32), clean.weights)


def with_rain(clean: LightField, depths_mm: tuple[float, float], count: int, seed: int = 0) -> LightField:
    """Views behind streaks: points nearer than the first of two depths, projected into every view as it sees them."""
    rng = np.random.default_rng(seed)
    samples = clean.samples.copy()
    near, far = (1.0 / (depth - clean.reference_view_depth_mm) for depth in depths_mm)
    for _ in range(count):
        distance = 1.0 / (near + rng.uniform(0.3, 1.5) * (near - far))
        place = rng.uniform(-30.0, [clean.width_px + 30.0, clean.height_px + 30.0])
        length, opacity = rng.uniform(*STREAK_PX), rng.uniform(*OPACITY)
        ends = np.array([place, place + length * np.array([0.1, 1.0])])
        rays = np.c_[(ends - clean.centre_px) / clean.focal_px, np.ones(2)]
        for view, seen in zip(np.ndindex(clean.rows, clean.cols), _in_views(clean, distance * rays), strict=True):
            mask = np.zeros(samples.shape[2:4], np.uint8)
            start, end = (tuple(round(16.0 * each) for each in point) for point in seen)
            cv2.line(mask, start, end, 255, 2, cv2.LINE_AA, 4)
            alpha = (opacity / 255.0 * mask[..., None]).astype(np.float32)
            samples[view] = samples[view] * (1 - alpha) + np.float32(RAIN_GREY) * alpha
    return LightField.of(clean, samples, clean.weights)


def _in_views(views: Views, points_in_view: FloatArray) -> FloatArray:
    return views.project_in_view(points_in_view).reshape(-1, len(points_in_view), 2)


def warped(light_field: LightField, depth_mm: FloatArray) -> Float32:
    """All views (n, v, u, c) as the central one sees them, by depth (v, u) of it."""
    pixels = light_field.pixel_grid()
    points = light_field.plane_points_in_rig(light_field.reference_depth_mm, pixels)
    in_view = (points - light_field.reference_view_in_rig_mm) @ light_field.view_from_rig.T
    in_view *= ((depth_mm - light_field.reference_view_depth_mm) / in_view[..., 2])[..., None]
    maps = np.moveaxis(light_field.project_in_view(in_view).astype(np.float32), -1, 2)
    return np.stack(
        [
            cv2.remap(
                light_field.samples[view],
                maps[view][0],
                maps[view][1],
                cv2.INTER_CUBIC,
                borderMode=cv2.BORDER_REPLICATE,
            )
            for view in np.ndindex(light_field.rows, light_field.cols)
        ]
    )


def peers(given: LightField, depth_mm: FloatArray) -> Iterator[tuple[str, Any]]:
    """Pictures of the central view by other means; of non-local means, one for each strength."""
    central = given.samples[given.rows // 2, given.cols // 2]
    stacked, straight = given.samples.reshape(-1, *central.shape), warped(given, depth_mm)
    yield "as it is", central
    yield "mean", stacked.mean(axis=0)
    yield "median", np.median(stacked, axis=0)
    yield "mean, true depth", straight.mean(axis=0)
    yield "median, true depth", np.median(straight, axis=0)
    shown = np.rint(255.0 * np.clip(central, 0.0, 1.0)).astype(np.uint8)
    for strength in STRENGTHS:
        yield "non-local means", cv2.fastNlMeansDenoisingColored(shown, None, strength, strength, 7, 21) / 255.0


def judged(
    name: str,
    given: LightField,
    clean: LightField,
    depth_mm: FloatArray,
    picture: Path | None,
    kinds: Sequence[FilterKind] = KINDS,
) -> None:
    """Print figures of a light field, in rain with outliers left out, too, and draw its central view."""
    middle = clean.rows // 2, clean.cols // 2
    truth = clean.samples[middle]
    best: dict[str, float] = {}
    for peer, found in peers(given, depth_mm):
        best[peer] = max(dB(found, truth), best.get(peer, -np.inf))
    print(f"  {name}: " + ", ".join(f"{peer} {value:.1f}" for peer, value in best.items()))
    drawn = [given.samples[middle]]
    for kind in kinds:
        ends = (None, None) if kind == "hypercone" else (float(depth_mm.min()), float(depth_mm.max()))
        passband = Passband.of(given, kind, *ends)
        for leave_out in (False, True) if name.startswith("rain") else (False,):
            start = time.process_time()
            filtered = filter_light_field(given, passband, leave_out=leave_out)
            spent, found = time.process_time() - start, filtered.light_field.samples
            how = ", outliers left out" if leave_out else ""
            figures = f"{dB(found[middle], truth):.1f} (all views {dB(found, clean.samples):.1f})"
            print(
                f"    {kind}{how}: {figures}, {255 * filtered.outside:.1f} grey levels outside, {spent:.1f} s",
                flush=True,
            )
            drawn += [found[middle]] if kind == "hyperfan" else []
    if picture is not None:
        shown = np.hstack([*drawn, truth])
        write_image(
            picture / f"{name.replace(' ', '_')}.png", np.rint(255.0 * np.clip(shown, 0.0, 1.0)).astype(np.uint8)
        )


def changes(light_field: LightField, depths_mm: tuple[float, float]) -> str:
    """By how much the hyperfan between two depths changes views, grey levels."""
    whole = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
    passband = Passband.of(light_field, "hyperfan", *depths_mm)
    samples: Any = filter_light_field(light_field, passband).light_field.samples
    off = whole * np.abs(samples.astype(np.float64) - light_field.samples)
    central = (light_field.rows // 2, light_field.cols // 2)
    every, one = (
        np.sqrt(np.square(part[there]).mean())
        for part, there in ((off, light_field.valid), (off[central], light_field.valid[central]))
    )
    return f"{every:.1f}, the central one {one:.1f}, median {np.median(off[light_field.valid]):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE")
    parser.add_argument("--decoded", nargs="*", type=Path, default=(), metavar="FILE", help="light fields (.npz)")
    parser.add_argument("--depths-mm", nargs=2, type=float, default=(300.0, 650.0), help="of what they show")
    parser.add_argument("--step", type=int, default=1, help="use every STEP-th view from the central one")
    parser.add_argument("--side-px", type=int, default=320, help="use the upper left of the views up to this side")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--noise", type=float, nargs="*", default=(10.0, 25.0), help="grey levels")
    parser.add_argument("--rain", type=int, nargs="*", default=(40, 120), help="streaks")
    parser.add_argument("--picture", type=Path, metavar="FOLDER", help="folder for pictures")
    options = parser.parse_args()
    for path in options.decoded:
        changed = changes(load_npz(path), tuple(options.depths_mm))
        print(f"{path.name}: the hyperfan changes views by {changed} grey levels", flush=True)
    for folder in options.scenes:
        scene = read_hci(folder)
        clean = every(scene.light_field, options.step, options.side_px)
        if scene.depth_mm is None:
            parser.error(f"{folder}: no true disparity")
        depth_mm = scene.depth_mm[: clean.height_px, : clean.width_px].astype(np.float64)
        depths = float(depth_mm.min()), float(depth_mm.max())
        print(f"{folder.name}: {clean.rows}x{clean.cols} views of {clean.width_px}x{clean.height_px} px")
        print(f"  without noise, the hyperfan changes views by {changes(clean, depths)} grey levels")
        at = None if options.picture is None else options.picture / folder.name
        for grey in options.noise:
            judged(f"noise {grey:g}", with_noise(clean, grey), clean, depth_mm, at, options.kinds)
        for count in options.rain:
            rainy = with_noise(with_rain(clean, depths, count), RAIN_NOISE_GREY)
            judged(f"rain {count}", rainy, clean, depth_mm, at, options.kinds)


if __name__ == "__main__":
    main()
