"""Keypoints found in a light field beside those of its central view: `python -m benchmarks.light_field_matching`.

Pairs of rendered light fields (3x3 views of reliefs with cards before them) from two viewpoints, in light from two
sides, and in little light, where noise is as large as the texture. SIFT4D searches their focal stacks
(optics/light_field/features/keypoints.py); SIFT, ORB and AKAZE their central views, stretched to the same range of
grey levels. Each keeps as many of its strongest keypoints; mutual nearest neighbours are sorted by the ratio test. A
match is correct within 3 px of where the true depth and pose put the keypoint. Prints how many correct matches each has
where 2, 5 and 10 % of all accepted ones are false, and the processor time of a light field.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from benchmarks.records import Rows, add_json_option, write_record
from benchmarks.relief_scene import Card, Relief, even_views, light_field_of
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform
from mirrorcam.optics.light_field.features.keypoints import (
    all_distances,
    comparable,
    detector,
    grey_views,
    stack_keypoints,
)
from mirrorcam.optics.light_field.features.slope import Geometry
from mirrorcam.optics.light_field.light_field import LightField, Views

CORRECT_PX = 3.0
RATES = (0.02, 0.05, 0.1)
INVERSE_RANGE_MM = (1.0 / 650.0, 1.0 / 380.0)
FRONT, SIDE = (0.4, -0.3, -0.85), (-0.2, -0.1, -0.95)
PICTURE_DETECTORS = ("SIFT", "ORB", "AKAZE")
# Turn between the viewpoints in degrees, gain, noise in grey levels, and the light of the second one.
CONDITIONS = {
    "10 degrees": (10.0, 1.0, 1.5, FRONT),
    "25 degrees": (25.0, 1.0, 1.5, FRONT),
    "10 degrees, other light": (10.0, 1.0, 1.5, SIDE),
    "10 degrees, 15 % of the light": (10.0, 0.15, 3.0, FRONT),
    "25 degrees, 15 % of the light": (25.0, 0.15, 3.0, FRONT),
    "10 degrees, 8 % of the light": (10.0, 0.08, 3.0, FRONT),
}

Described = tuple[FloatArray, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two light fields, the true distances (v, u) in the first, and the second one's pose in the first's frame."""

    first: LightField
    second: LightField
    true_mm: FloatArray
    first_from_second: FloatArray


def pair_of(views: Views, seed: int, turn_deg: float, gain: float, noise_grey: float, light: Any) -> Pair:
    scene = Relief(
        seed=seed,
        heights_mm=((10.0, 6.0), (32.0, 20.0)),
        slants=(0.0, -0.15),
        cards=(Card(400.0, (-80.0, -50.0, -30.0, 10.0)), Card(430.0, (40.0, 20.0, 90.0, 60.0))),
    )
    turn = Rotation.from_euler("yz", [turn_deg, turn_deg / 3.0], degrees=True).as_matrix()
    about = np.array([0.0, 0.0, 480.0])
    pose = rigid(turn, about - turn @ about - [0.0, 0.0, 3.0 * turn_deg])
    given: dict[str, Any] = {"noise_grey": noise_grey, "gain": gain, "subsamples": 1}
    first, true_mm = light_field_of(scene, views, seed=seed, **given)
    second, _ = light_field_of(scene.lit_from(light), views, seed=seed + 77, world_from_view=pose, **given)
    return Pair(first, second, true_mm, pose)


def in_picture(light_field: LightField, name: Any, count: int) -> Described:
    """Keypoints (n, 2) of the central view and their descriptors."""
    image = grey_views(light_field)[(light_field.rows // 2) * light_field.cols + light_field.cols // 2]
    low, high = np.percentile(image, [0.5, 99.5])
    stretched = np.rint(np.clip((image - low) * (250.0 / max(high - low, 8.0)), 0.0, 255.0)).astype(np.uint8)
    found, descriptors = detector(name, count).detectAndCompute(stretched, None)
    return np.array([point.pt for point in found]).reshape(-1, 2), comparable(descriptors)


def in_light_field(light_field: LightField, count: int) -> Described:
    """Keypoints (n, 2) of the focal stack and their descriptors."""
    images = grey_views(light_field)
    everywhere = np.full(images.shape, 255, np.uint8)
    found, _ = stack_keypoints(Geometry.of(light_field), images, everywhere, everywhere[0], INVERSE_RANGE_MM, count)
    return found.pixels, found.descriptors


def matched(pair: Pair, first: Described, second: Described) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Ratios (m,) of the nearest distance to the second one, of mutual nearest neighbours, and which are correct."""
    apart = np.sqrt(np.maximum(all_distances(first[1], second[1]), 0.0))
    nearest = apart.argmin(axis=1)
    mutual = np.flatnonzero(apart.argmin(axis=0)[nearest] == np.arange(len(apart)))
    two = np.partition(apart, 1, axis=1)
    views = pair.first
    distance = map_coordinates(pair.true_mm, first[0][mutual].T[::-1], order=0, mode="nearest")
    directions = np.c_[(first[0][mutual] - views.centre_px) / views.focal_px, np.ones(len(mutual))]
    there = transform(inverse(pair.first_from_second), directions * distance[:, None])
    expected = there[:, :2] / there[:, 2:] * views.focal_px + views.centre_px
    off = np.linalg.norm(second[0][nearest[mutual]] - expected, axis=1)
    return two[mutual, 0] / np.maximum(two[mutual, 1], 1e-6), off < CORRECT_PX


def correct_at(ratios: FloatArray, correct: NDArray[np.bool_], rate: float) -> int:
    """Most correct matches of those up to some ratio of which at most `rate` are false."""
    right = np.cumsum(correct[np.argsort(ratios, kind="stable")])
    allowed = np.arange(1, len(right) + 1) - right <= rate * np.arange(1, len(right) + 1)
    return int(right[allowed].max(initial=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keypoints", type=int, default=500)
    parser.add_argument("--seeds", type=int, default=3)
    add_json_option(parser)
    given = parser.parse_args()
    views, count = even_views(3, 10.0), given.keypoints
    ways: dict[str, Callable[[LightField], Described]] = {
        **{name: partial(in_picture, name=name, count=count) for name in PICTURE_DETECTORS},
        "SIFT4D": partial(in_light_field, count=count),
    }
    rates = " / ".join(f"{100.0 * rate:g}" for rate in RATES)
    rows = Rows(f"correct matches at {rates} % of false ones", *ways)
    spent_s: dict[str, list[float]] = {name: [] for name in ways}
    for title, condition in CONDITIONS.items():
        pairs = [pair_of(views, seed, *condition) for seed in range(given.seeds)]
        cells = []
        for name, way in ways.items():
            start = time.process_time()
            found = [(way(pair.first), way(pair.second)) for pair in pairs]
            spent_s[name].append((time.process_time() - start) / (2 * len(pairs)))
            judged = [matched(pair, *each) for pair, each in zip(pairs, found, strict=True)]
            mean = [np.mean([correct_at(*each, rate) for each in judged]) for rate in RATES]
            cells.append(" / ".join(f"{each:.0f}" for each in mean))
        rows.add(title, *cells)
    figures = {f"{name.lower()}_s": float(np.mean(each)) for name, each in spent_s.items()}
    print("; ".join(f"{name} {each:.3g} s" for name, each in figures.items()) + " of processor time a light field")
    write_record(given.json, "light_field_matching", table=rows.table)
    write_record(given.json, "light_field_matching_time", figures)


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
