"""Features of tabletop scenes beside plain pairwise matching: `python -m benchmarks.light_field_features SCENE...`.

SCENE: folders of `mirrorcam scene`. For each detector prints, over all scenes: how many features are accepted, how many
of them are where the surface at their pixel is (inliers), the part they are of all (precision), and the time of a
frame. A feature is an inlier where its depth is within 2 % (also printed: 1 %) of the true depth of its pixel or one of
the eight around it, in whatever material; what is seen by glass or in a glossy surface hardly ever is.

The baseline detects alike, and matches the reference view's descriptors with those of one other view: two nearest
neighbours and the ratio test (.8), then the depth of the match. `pair`: the other view with the most inliers
(as if one knew); `pair, on line`: also within a pixel of the epipolar line; `all pairs, on line`: whatever is matched
into any view, at the median of its slopes. All within the same range of depths.

The light field's features are those that the two-slope test lets pass. Last, how many it flags: of features on matte
things, none of which should be, and of those on glossy things and glass.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.records import Rows, add_json_option, table, write_record
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.features import DetectorName, FeatureFinder, Features
from mirrorcam.optics.light_field.features.keypoints import detector, grey_views, inner_masks
from mirrorcam.optics.light_field.features.slope import Geometry
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.render_scenes.tabletop.tabletop_set import MASK, TabletopSet, read_map

RATIO = 0.8
ON_LINE_PX = 1.0
WITHIN = (0.02, 0.01)
ROUNDS = 15


@dataclass(frozen=True)
class TabletopRecording:
    """The frame of a rendered tabletop scene, its decoder, and the true central view's depths and surfaces (v, u)."""

    name: str
    frame: Any
    decoder: Decoder
    depth_mm: FloatArray
    kind: NDArray[np.uint8]


def read_recording(folder: Path) -> TabletopRecording:
    """Read a tabletop scene, decoded by the layout as built: errors of features, not of a calibration, are measured."""
    manifest = TabletopSet.load(folder)
    decoder = Decoder(Layout.load(folder / "truth/layout.json"))
    t, s = manifest.central_view
    depth = read_map(folder / f"truth/depth/{t}_{s}.exr", "depth")
    kind = read_image(folder / f"truth/mask/{t}_{s}.png", grey=True)
    return TabletopRecording(folder.name, read_image(folder / manifest.frame_name), decoder, depth, kind)


def relative_error(pixels: FloatArray, depth_mm: FloatArray, true_mm: FloatArray) -> FloatArray:
    """Relative errors of depths (n,) at pixels (n, 2) against the true ones (v, u), the least of 3x3 pixels."""
    height, width = true_mm.shape
    u, v = np.rint(pixels).astype(np.int64).T
    errors = []
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            true = true_mm[np.clip(v + down, 0, height - 1), np.clip(u + across, 0, width - 1)]
            errors.append(np.abs(depth_mm - true) / true)
    return np.min(errors, axis=0) if len(pixels) else np.zeros(0)


def pairs(
    light_field: LightField, name: DetectorName, keypoints: int
) -> dict[str, tuple[FloatArray, list[FloatArray]]]:
    """The baseline: pixels (n, 2) of the reference view's keypoints and, for each other view, inverse distances (n,).

    NaN where a keypoint has no match; by the names of the ways to match.
    """
    finder = FeatureFinder(light_field, name, keypoints=keypoints)
    geometry, (far, near) = Geometry.of(light_field), finder.inverse_range_mm
    images, masks = grey_views(light_field), inner_masks(light_field)
    detectors = [detector(name, keypoints) for _ in images]
    with ThreadPoolExecutor() as pool:
        found = list(pool.map(lambda d, image, mask: d.detectAndCompute(image, mask), detectors, images, masks))
    matcher = cv2.BFMatcher(cv2.NORM_L2 if name == "SIFT" else cv2.NORM_HAMMING)
    points = [np.array([point.pt for point in points]).reshape(-1, 2) for points, _ in found]
    reference = geometry.reference
    ways: dict[str, list[FloatArray]] = {"pair": [], "pair, on line": []}
    for view in range(len(images)):
        if view == reference:
            continue
        best = [
            two[0]
            for two in matcher.knnMatch(found[reference][1], found[view][1], 2)
            if len(two) == 2 and two[0].distance < RATIO * two[1].distance
        ]
        first, second = np.array([(m.queryIdx, m.trainIdx) for m in best], dtype=np.int64).reshape(-1, 2).T
        a_, b = geometry.terms(view, points[view][second])
        rest = b - geometry.focal_px[view] * geometry.directions(points[reference][first])
        inverse = (a_ * rest).sum(axis=1) / (a_**2).sum(axis=1)
        off = np.abs(a_[:, 0] * rest[:, 1] - a_[:, 1] * rest[:, 0]) / np.hypot(*a_.T)
        for way, most in (("pair", np.inf), ("pair, on line", ON_LINE_PX)):
            estimate = np.full(len(points[reference]), np.nan)
            ok = (inverse > far) & (inverse <= near) & (off <= most)
            estimate[first[ok]] = inverse[ok]
            ways[way].append(estimate)
    on_line = np.array(ways["pair, on line"])
    ordered = np.sort(on_line, axis=0)
    middle = (np.maximum(np.isfinite(on_line).sum(axis=0), 1) - 1) // 2
    median = np.take_along_axis(ordered, middle[None], axis=0)[0]
    everything = {**ways, "all pairs, on line": [median]}
    return {way: (points[reference], estimate) for way, estimate in everything.items()}


def counts(pixels: FloatArray, depth_mm: FloatArray, recorded: TabletopRecording) -> tuple[int, ...]:
    """Count accepted depths, and those that are right within each of WITHIN; several at one place count as one."""
    _, first = np.unique(pixels, axis=0, return_index=True)
    error = relative_error(pixels[first], depth_mm[first], recorded.depth_mm)
    return (len(first), *(int((error <= within).sum()) for within in WITHIN))


def flagged(features: Features, recorded: TabletopRecording) -> tuple[int, int, int, int]:
    """Count features with two slopes and all features, on matte things; the same on glossy ones and glass."""
    u, v = np.rint(features.pixels).astype(np.int64).T
    matte = recorded.kind[v, u] == MASK["matte"]
    marked = features.refracted
    return int((marked & matte).sum()), int(matte.sum()), int((marked & ~matte).sum()), int((~matte).sum())


def baseline(
    recorded: TabletopRecording, light_field: LightField, name: DetectorName, keypoints: int
) -> dict[str, tuple[int, ...]]:
    """Counts of every way to match, of the view with the most inliers."""
    pupil_mm = light_field.reference_view_depth_mm
    found = {}
    for way, (pixels, views) in pairs(light_field, name, keypoints).items():
        each = [
            counts(pixels[known], 1.0 / inverse[known] + pupil_mm, recorded)
            for inverse, known in ((inverse, np.isfinite(inverse)) for inverse in views)
        ]
        found[way] = max(each, key=lambda count: count[1])
    return found


def median_ms(job: Callable[[], object]) -> float:
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        job()
        times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE")
    parser.add_argument("--keypoints", type=int, default=600, help="of each view, at most")
    add_json_option(parser)
    given = parser.parse_args()
    scenes = [read_recording(folder) for folder in given.scenes]
    views = scenes[0].decoder.views
    print(
        f"{', '.join(recorded.name for recorded in scenes)}: {views.rows}x{views.cols} views of {views.width_px}x"
        f"{views.height_px} px, at most {given.keypoints} keypoints a view, {cv2.getNumThreads()} threads"
    )
    rows = Rows("", "accepted", "inliers", "precision", "within 1 %", "ms a frame", "frames/s")
    beside: list[tuple[str, ...]] = []

    def row(title: str, each: list[tuple[int, ...]], ms: float | None, whole_ms: float | None = None) -> None:
        accepted, inliers, finer = np.sum(each, axis=0)
        shares = f"{inliers / max(accepted, 1):.3f}", f"{finer / max(accepted, 1):.3f}"
        times = "" if ms is None else f"{ms:.1f}", "" if whole_ms is None else f"{1e3 / whole_ms:.1f}"
        rows.add(title, f"{accepted}", f"{inliers}", *shares, *times)

    slopes: list[str] = []
    for name in cast(tuple[DetectorName, ...], get_args(DetectorName)):
        try:
            detector(name, given.keypoints)
        except InputError as error:
            print(f"{name}: {error}")
            continue
        plain: dict[str, list[tuple[int, ...]]] = {}
        found: list[tuple[int, ...]] = []
        marked: list[tuple[int, ...]] = []
        times: list[tuple[float, float, float]] = []
        for recorded in scenes:
            light_field = recorded.decoder.decode(recorded.frame)
            for way, count in baseline(recorded, light_field, name, given.keypoints).items():
                plain.setdefault(way, []).append(count)
            finder = FeatureFinder(recorded.decoder.views, name, keypoints=given.keypoints)
            features = finder.find(light_field)
            sure = ~features.refracted
            marked.append(flagged(features, recorded))
            found.append(counts(features.pixels[sure], features.depth_mm[sure], recorded))
            times.append(
                (
                    median_ms(lambda: pairs(light_field, name, given.keypoints)),  # noqa: B023  # called at once
                    median_ms(lambda: finder.find(light_field)),  # noqa: B023
                    median_ms(lambda: finder.find(recorded.decoder.decode(recorded.frame))),  # noqa: B023
                )
            )
        pairs_ms, find_ms, whole_ms = np.median(times, axis=0)
        for way, each in plain.items():
            row(f"{name}: {way}", each, pairs_ms if way.startswith("all") else None)
        row(f"{name}: light field", found, find_ms, whole_ms)
        both = np.array([np.sum(each, axis=0)[:2] for each in (plain["pair"], found)])
        shares = "; ".join(f"{inliers / max(accepted, 1):.3f}" for accepted, inliers in both)
        title = f"{name}: pair{' with the ratio test' if not beside else ''}; light field"
        beside.append((title, *("; ".join(map(str, column)) for column in both.T), shares))
        matte, all_matte, other, all_other = np.sum(marked, axis=0)
        slopes.append(f"{name}, two slopes: {matte} of {all_matte} matte, {other} of {all_other} glossy ones and glass")
    print("\n".join(slopes))
    head = ("", "accepted", "inliers", "precision")
    write_record(given.json, "light_field_features", table=table(head, beside))


if __name__ == "__main__":
    main()
