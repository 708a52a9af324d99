"""Keypoints and descriptors of the views, by OpenCV's detectors or by extrema in the focal stack.

In the focal stack, views moved and added for one slope show sharply the objects with that slope, with less noise than
any single view; everything else is blurred, and so are objects that hide it in some views. A keypoint is the strongest
difference of Gaussians around, over place, scale and slope at once.

Dansereau, Girod and Wetzstein, "LiFF: Light field features in scale and depth", CVPR 2019.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.slope import Geometry
from mirrorcam.optics.light_field.light_field import LightField

DetectorName = Literal["SIFT", "ORB", "AKAZE"]
# A keypoint this near to what a view does not show would be a corner of the border.
BORDER_PX = 5
ORB_SCALE_STEP = 1.2
# What OpenCV gives as the size of a keypoint of the finest scale: the diameter of ORB's patch; twice (AKAZE: three
# times) the scale 1.6 at which SIFT and AKAZE begin.
FINEST_SIZE_PX: dict[DetectorName, float] = {"SIFT": 2 * 1.6, "ORB": 31.0, "AKAZE": 3 * 1.6}
# The step from slope to slope moves the view farthest from the reference view by this.
STEP_PX = 1.0
# Keypoints nearer to a stronger one than this, in px of its scale and octaves of scale, are the same.
SAME_PX, SAME_OCTAVES = 2.0, 0.6
# Less contrast than of one picture is enough where noise is less.
CONTRAST = 0.01
DARKEST, BRIGHTEST = 0.5, 99.5
LEAST_RANGE_GREY = 8.0


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one view.

    Attributes
    ----------
    pixels
        Pixels (n, 2) as (u, v).
    scale_px
        Size (n,), in pixels of the view, of one pixel of the image scale that a keypoint was found at.
    angle
        Orientation (n,), radians.
    descriptors
        Descriptors (n, d): binary ones as uint64 words, those of SIFT as float32 of unit length.
    """

    pixels: FloatArray
    scale_px: FloatArray
    angle: FloatArray
    descriptors: NDArray[Any]


def detector(name: DetectorName, keypoints: int) -> Any:
    """Make an OpenCV detector that keeps about this number of the strongest keypoints; thresholds suit dim, soft views.

    Raises InputError for another name, and where this OpenCV comes without AKAZE (since version 5 it is among the
    contributed modules).
    """
    if name == "SIFT":
        return cv2.SIFT.create(keypoints, contrastThreshold=0.015)
    if name == "ORB":
        return cv2.ORB.create(keypoints, scaleFactor=ORB_SCALE_STEP, edgeThreshold=8, fastThreshold=7)
    if name != "AKAZE":
        raise InputError(f"detector {name!r}, expected {', '.join(get_args(DetectorName))}")
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            "detector AKAZE is not in this OpenCV, expected opencv-contrib-python-headless in place of "
            "opencv-python-headless"
        )
    return cv2.xfeatures2d.AKAZE.create(threshold=2e-4, max_points=keypoints)


def grey_views(light_field: LightField) -> NDArray[np.uint8]:
    """The views in 8-bit grey (t * s, v, u)."""
    samples: Any = light_field.samples.reshape(-1, *light_field.samples.shape[2:])
    if samples.dtype == np.float32:
        samples = np.rint(np.clip(samples, 0.0, 1.0) * np.float32(255.0)).astype(np.uint8)
    if samples.shape[-1] == 1:
        return np.asarray(samples[..., 0])
    return np.stack([np.asarray(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), dtype=np.uint8) for view in samples])


def inner_masks(light_field: LightField) -> NDArray[np.uint8]:
    """Masks (t * s, v, u), 255 where keypoints may be: away from unseen pixels and from the frames of the views."""
    size = 2 * BORDER_PX + 1
    kernel = np.ones((size, size), np.uint8)
    valid = light_field.valid.reshape(-1, light_field.height_px, light_field.width_px).astype(np.uint8) * 255
    framed = [cv2.copyMakeBorder(view, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=[0]) for view in valid]
    return np.stack([cv2.erode(view, kernel)[1:-1, 1:-1] for view in framed])


def detect(
    images: NDArray[np.uint8],
    masks: NDArray[np.uint8],
    detectors: list[Any],
    name: DetectorName,
    run: Callable[..., Any],
) -> list[Keypoints]:
    """Keypoints of every image (n, v, u) by its own detector; `run` is `map`, or that of a pool of threads."""

    def one(image: NDArray[np.uint8], mask: NDArray[np.uint8], with_: Any) -> Keypoints:
        found, descriptors = with_.detectAndCompute(image, mask)
        if descriptors is None:
            descriptors = np.zeros((0, with_.descriptorSize()), np.float32 if name == "SIFT" else np.uint8)
        return _keypoints(found, descriptors, name)

    return list(run(one, images, masks, detectors))


def _keypoints(found: Any, descriptors: NDArray[Any], name: DetectorName) -> Keypoints:
    """OpenCV's keypoints as arrays."""
    numbers = np.array([(*point.pt, point.size, point.angle) for point in found], dtype=np.float64).reshape(-1, 4)
    return Keypoints(
        pixels=numbers[:, :2],
        scale_px=np.maximum(numbers[:, 2] / FINEST_SIZE_PX[name], 1.0),
        angle=np.deg2rad(numbers[:, 3]),
        descriptors=comparable(descriptors),
    )


def comparable(descriptors: NDArray[Any]) -> NDArray[Any]:
    """Descriptors as they are compared: bits in words of 64; SIFT's by the square roots of their parts (RootSIFT).

    Arandjelovic and Zisserman, "Three things everyone should know to improve object retrieval", CVPR 2012.
    """
    if descriptors.dtype == np.uint8:
        padding = -descriptors.shape[1] % 8
        return np.pad(descriptors, ((0, 0), (0, padding))).view(np.uint64)
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), np.float32(1e-6))
    return np.sqrt(descriptors / total)


def distances(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.float32]:
    """Distances of descriptors (n, d) pair by pair: bits that differ, or 1 less the cosine."""
    if one.dtype == np.uint64:
        return np.bitwise_count(one ^ other).sum(axis=1).astype(np.float32)
    return 1.0 - np.einsum("nd,nd->n", one, other)


def nearest_pairs(
    one: NDArray[Any], other: NDArray[Any], ratio: float = 0.8
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers (m,) and (m,) of descriptors that are each other's nearest, and nearer than `ratio` times the second.

    Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004.
    """
    if len(one) < 2 or len(other) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    apart = all_distances(one, other)
    nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
    rows = np.arange(len(one))
    best = apart[rows, nearest]
    second = np.partition(apart, 1, axis=1)[:, 1]
    # Of unit vectors, 1 less the cosine is half the squared distance.
    limit = ratio if one.dtype == np.uint64 else ratio**2
    chosen = (back[nearest] == rows) & (best < limit * second)
    return np.flatnonzero(chosen), nearest[chosen]


def all_distances(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.float32]:
    """Distances (n, m) of all descriptors of two pictures, as `distances` has them."""
    if one.dtype != np.uint64:
        return np.asarray(1.0 - one @ other.T, dtype=np.float32)
    bits = np.zeros((len(one), len(other)), np.float32)
    for word in range(one.shape[1]):
        bits += np.bitwise_count(one[:, None, word] ^ other[None, :, word])
    return bits


def stack_slopes(geometry: Geometry, inverse_range_mm: tuple[float, float]) -> FloatArray:
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
        Largest number of keypoints.
    run
        `map`, or that of a pool of threads.
    """
    slopes = stack_slopes(geometry, inverse_range_mm)
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
