"""Keypoints of a light field over place, scale and slope at once: extrema in its focal stack.

Views moved and added for one slope show sharply what has it, with less noise than any of them; all else is blurred, and
so is what hides it in some views. A keypoint is the strongest difference of Gaussians around, also among slopes.

Dansereau, Girod and Wetzstein, "LiFF: Light field features in scale and depth", CVPR 2019.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.keypoints import FINEST_SIZE_PX, Keypoints, comparable
from mirrorcam.optics.light_field.features.slope import Geometry

# The step from slope to slope moves the view farthest from the reference view by this.
STEP_PX = 1.0
# Keypoints nearer to a stronger one than this, in px of its scale and octaves of scale, are the same.
SAME_PX, SAME_OCTAVES = 2.0, 0.6
# Less contrast than of one picture is enough where noise is less.
CONTRAST = 0.01
DARKEST, BRIGHTEST = 0.5, 99.5
LEAST_RANGE_GREY = 8.0


def slopes_of(geometry: Geometry, inverse_range_mm: tuple[float, float]) -> FloatArray:
    """Inverse distances (n,) of the slices of a focal stack, from far to near."""
    far, near = min(inverse_range_mm), max(inverse_range_mm)
    farthest = np.hypot(*geometry.across_mm.T).max() * geometry.focal_px[geometry.reference]
    return np.linspace(far, near, max(int(np.ceil((near - far) * farthest / STEP_PX)) + 1, 2))


def slice_of(
    geometry: Geometry, images: NDArray[Any], seen: NDArray[np.uint8], inverse_mm: float
) -> NDArray[np.float32]:
    """The mean (v, u), at an inverse distance, of the views (views, v, u) that see each pixel; 0 without any."""
    height, width = images.shape[1:]
    total, weight = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height]])
    directions = geometry.directions(corners)
    for view, (image, mask) in enumerate(zip(images, seen, strict=True)):
        to = cv2.getAffineTransform(
            corners.astype(np.float32), geometry.predict(view, directions, inverse_mm).astype(np.float32)
        )
        size, nearest, cubic = (width, height), cv2.INTER_NEAREST, cv2.INTER_CUBIC
        shown = cv2.warpAffine(mask, to, size, flags=nearest | cv2.WARP_INVERSE_MAP) > 0
        moved = cv2.warpAffine(
            image.astype(np.float32), to, size, flags=cubic | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
        )
        total += np.where(shown, moved, np.float32(0.0))
        weight += shown
    return np.asarray(total / np.maximum(weight, 1.0), dtype=np.float32)


def stack_keypoints(
    geometry: Geometry,
    images: NDArray[Any],
    seen: NDArray[np.uint8],
    inner: NDArray[np.uint8],
    inverse_range_mm: tuple[float, float],
    count: int,
    run: Callable[..., Any] = map,
) -> tuple[Keypoints, FloatArray]:
    """The strongest keypoints of a light field, and their inverse distances (n,), 1/mm.

    Parameters
    ----------
    geometry
        Geometry of the views.
    images, seen
        Grey views (views, v, u), and masks of what they show.
    inner
        Mask (v, u) of where keypoints of the reference view may be.
    inverse_range_mm
        Inverse distances between which they are sought.
    count
        At most so many.
    run
        `map`, or that of a pool of threads.
    """
    slopes = slopes_of(geometry, inverse_range_mm)
    reference = images[geometry.reference]
    shown = reference[seen[geometry.reference] > 0]
    low, high = np.percentile(shown, [DARKEST, BRIGHTEST]) if len(shown) else (0.0, 255.0)
    gain = 250.0 / max(high - low, LEAST_RANGE_GREY)

    # What a cubic mixes with pixels that are not seen is left out.
    whole = np.stack([np.asarray(cv2.erode(mask, np.ones((5, 5), np.uint8)), dtype=np.uint8) for mask in seen])

    def one(inverse_mm: float) -> tuple[Any, Any]:
        grey = (slice_of(geometry, images, whole, inverse_mm) - low) * gain
        picture = np.rint(np.clip(grey, 0.0, 255.0)).astype(np.uint8)
        return cv2.SIFT.create(2 * count, contrastThreshold=CONTRAST).detectAndCompute(picture, inner)

    found = list(run(one, slopes))
    points = [point for each, _ in found for point in each]
    numbers = np.array([(*point.pt, point.size, point.angle, point.response) for point in points]).reshape(-1, 5)
    descriptors = [each for _, each in found if each is not None]
    described = np.concatenate(descriptors) if descriptors else np.zeros((0, 128), np.float32)
    inverse_mm = np.repeat(slopes, [len(each) for each, _ in found])
    scale = np.maximum(numbers[:, 2] / FINEST_SIZE_PX["SIFT"], 1e-3)
    chosen = _strongest(numbers[:, :2], scale, numbers[:, 4])[:count]
    keypoints = Keypoints(
        pixels=numbers[chosen, :2],
        scale_px=np.maximum(scale[chosen], 1.0),
        angle=np.deg2rad(numbers[chosen, 3]),
        descriptors=comparable(described[chosen]),
    )
    return keypoints, inverse_mm[chosen]


def _strongest(pixels: FloatArray, scale_px: FloatArray, strength: FloatArray) -> NDArray[np.int64]:
    """Numbers of keypoints without a stronger one at the same place and scale, the strongest first."""
    octave = np.log2(scale_px)
    # Neighbours within the distance of the coarser scale, found scale by scale.
    weaker = np.zeros(len(pixels), dtype=bool)
    for level in range(int(np.floor(octave.min(initial=0.0))), int(np.ceil(octave.max(initial=0.0))) + 1):
        near = np.flatnonzero(np.abs(octave - level) <= 1.0)
        if len(near) < 2:
            continue
        unit = SAME_PX * 2.0**level
        tree = cKDTree(np.c_[pixels[near] / unit, octave[near] / SAME_OCTAVES])
        pairs = tree.query_pairs(1.0, output_type="ndarray")
        one, other = near[pairs[:, 0]], near[pairs[:, 1]]
        # Orientations of one keypoint are as strong as each other.
        weaker[one[strength[one] < strength[other]]] = True
        weaker[other[strength[other] < strength[one]]] = True
    kept = np.flatnonzero(~weaker)
    return kept[np.argsort(-strength[kept], kind="stable")]
