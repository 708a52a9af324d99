"""Keypoints and descriptors of the views, from OpenCV's detectors or from extrema in the focal stack.

The focal stack averages the views after shifting them by a slope: objects with that slope are sharp, with less noise
than in any single view; others, including occluders in some views, are blurred. A keypoint is a local extremum of the
difference of Gaussians over place, scale and slope.

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
# Closer to unseen pixels, keypoints would be corners of the border.
BORDER_PX = 5
ORB_SCALE_STEP = 1.2
# OpenCV's keypoint size at the finest scale: ORB's patch diameter; for SIFT (AKAZE), twice (three times) the initial
# scale 1.6.
FINEST_SIZE_PX: dict[DetectorName, float] = {"SIFT": 2 * 1.6, "ORB": 31.0, "AKAZE": 3 * 1.6}
# Motion of the view farthest from the reference view, from slope to slope.
STEP_PX = 1.0
# Distance, in px of its scale and octaves of scale, below which a weaker keypoint duplicates a stronger one.
DUPLICATE_PX, DUPLICATE_OCTAVES = 2.0, 0.6
# Lower contrast than in a single picture suffices, because noise is lower.
CONTRAST = 0.01
DARK_PERCENTILE, BRIGHT_PERCENTILE = 0.5, 99.5
MIN_RANGE_GREY = 8.0


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one view.

    Attributes
    ----------
    pixels
        Pixels (n, 2), (u, v).
    scale_px
        Size (n,), in pixels of the view, of a pixel at the scale of detection.
    angle
        Orientation (n,), radians.
    descriptors
        Descriptors (n, d): binary ones as uint64 words, SIFT's as float32 of unit length.
    """

    pixels: FloatArray
    scale_px: FloatArray
    angle: FloatArray
    descriptors: NDArray[Any]


def detector(name: DetectorName, keypoints: int) -> Any:
    """Create an OpenCV detector for about this number of the strongest keypoints, with thresholds for dim, soft views.

    Raises InputError for an unknown name, and if this OpenCV lacks AKAZE (since version 5, it is a contributed module).
    """
    if name == "SIFT":
        return cv2.SIFT.create(keypoints, contrastThreshold=0.015)
    if name == "ORB":
        return cv2.ORB.create(keypoints, scaleFactor=ORB_SCALE_STEP, edgeThreshold=8, fastThreshold=7)
    if name != "AKAZE":
        raise InputError(f"detector {name!r}, expected {', '.join(get_args(DetectorName))}")
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            "detector AKAZE is not in this OpenCV, expected opencv-contrib-python-headless instead of "
            "opencv-python-headless"
        )
    return cv2.xfeatures2d.AKAZE.create(threshold=2e-4, max_points=keypoints)


def grey_views(light_field: LightField) -> NDArray[np.uint8]:
    """Convert the views to 8-bit grey (t * s, v, u)."""
    samples: Any = light_field.samples.reshape(-1, *light_field.samples.shape[2:])
    if samples.dtype == np.float32:
        samples = np.rint(np.clip(samples, 0.0, 1.0) * np.float32(255.0)).astype(np.uint8)
    if samples.shape[-1] == 1:
        return np.asarray(samples[..., 0])
    return np.stack([np.asarray(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), dtype=np.uint8) for view in samples])


def inner_masks(light_field: LightField) -> NDArray[np.uint8]:
    """Masks (t * s, v, u), 255 where keypoints are allowed: away from invalid pixels and from the views' frames."""
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
    """Detect keypoints in every image (n, v, u) by its own detector; `run` is `map`, or the `map` of a thread pool."""

    def detect_in(image: NDArray[np.uint8], mask: NDArray[np.uint8], detector: Any) -> Keypoints:
        found, descriptors = detector.detectAndCompute(image, mask)
        if descriptors is None:
            descriptors = np.zeros((0, detector.descriptorSize()), np.float32 if name == "SIFT" else np.uint8)
        return _keypoints(found, descriptors, name)

    return list(run(detect_in, images, masks, detectors))


def _keypoints(found: Any, descriptors: NDArray[Any], name: DetectorName) -> Keypoints:
    """Convert OpenCV's keypoints to arrays."""
    numbers = np.array([(*point.pt, point.size, point.angle) for point in found], dtype=np.float64).reshape(-1, 4)
    return Keypoints(
        pixels=numbers[:, :2],
        scale_px=np.maximum(numbers[:, 2] / FINEST_SIZE_PX[name], 1.0),
        angle=np.deg2rad(numbers[:, 3]),
        descriptors=comparable(descriptors),
    )


def comparable(descriptors: NDArray[Any]) -> NDArray[Any]:
    """Convert descriptors for comparison: bits to 64-bit words, SIFT to square roots of its elements (RootSIFT).

    Arandjelovic and Zisserman, "Three things everyone should know to improve object retrieval", CVPR 2012.
    """
    if descriptors.dtype == np.uint8:
        padding = -descriptors.shape[1] % 8
        return np.pad(descriptors, ((0, 0), (0, padding))).view(np.uint64)
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), np.float32(1e-6))
    return np.sqrt(descriptors / total)


def distances(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.float32]:
    """Distances of pairs of descriptors (n, d): number of different bits, or 1 minus the cosine."""
    if one.dtype == np.uint64:
        return np.bitwise_count(one ^ other).sum(axis=1).astype(np.float32)
    return 1.0 - np.einsum("nd,nd->n", one, other)


def nearest_pairs(
    one: NDArray[Any], other: NDArray[Any], ratio: float = 0.8
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices (m,) and (m,) of descriptors that are mutual nearest neighbours, at under `ratio` times the second's
    distance.

    Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004.
    """
    if len(one) < 2 or len(other) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    descriptor_distances = all_distances(one, other)
    nearest, nearest_back = descriptor_distances.argmin(axis=1), descriptor_distances.argmin(axis=0)
    rows = np.arange(len(one))
    best = descriptor_distances[rows, nearest]
    second = np.partition(descriptor_distances, 1, axis=1)[:, 1]
    # For unit vectors, 1 minus the cosine is half the squared distance.
    limit = ratio if one.dtype == np.uint64 else ratio**2
    chosen = (nearest_back[nearest] == rows) & (best < limit * second)
    return np.flatnonzero(chosen), nearest[chosen]


def all_distances(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.float32]:
    """Distances (n, m) between all descriptors of two pictures, as in `distances`."""
    if one.dtype != np.uint64:
        return np.asarray(1.0 - one @ other.T, dtype=np.float32)
    bits = np.zeros((len(one), len(other)), np.float32)
    for word in range(one.shape[1]):
        bits += np.bitwise_count(one[:, None, word] ^ other[None, :, word])
    return bits


def stack_slopes(geometry: Geometry, inverse_range_mm: tuple[float, float]) -> FloatArray:
    """Inverse distances (n,) of the slices of a focal stack, far to near."""
    far, near = min(inverse_range_mm), max(inverse_range_mm)
    farthest = np.hypot(*geometry.across_mm.T).max() * geometry.focal_px[geometry.reference]
    return np.linspace(far, near, max(int(np.ceil((near - far) * farthest / STEP_PX)) + 1, 2))


def slice_of(
    geometry: Geometry, images: NDArray[Any], seen: NDArray[np.uint8], inverse_mm: float
) -> NDArray[np.float32]:
    """Mean (v, u), at an inverse distance, over the views (views, v, u) that see each pixel; 0 without any."""
    height, width = images.shape[1:]
    total, weight = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height]])
    directions = geometry.directions(corners)
    for view, (image, mask) in enumerate(zip(images, seen, strict=True)):
        affine = cv2.getAffineTransform(
            corners.astype(np.float32), geometry.predict(view, directions, inverse_mm).astype(np.float32)
        )
        size, nearest, cubic = (width, height), cv2.INTER_NEAREST, cv2.INTER_CUBIC
        visible = cv2.warpAffine(mask, affine, size, flags=nearest | cv2.WARP_INVERSE_MAP) > 0
        shifted = cv2.warpAffine(
            image.astype(np.float32), affine, size, flags=cubic | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
        )
        total += np.where(visible, shifted, np.float32(0.0))
        weight += visible
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
    """Detect the strongest keypoints of a light field, with inverse distances (n,), 1/mm.

    Parameters
    ----------
    geometry
        Geometry of the views.
    images, seen
        Grey views (views, v, u), and masks of their valid pixels.
    inner
        Mask (v, u) of where keypoints of the reference view are allowed.
    inverse_range_mm
        Range of inverse distances to search.
    count
        Largest number of keypoints.
    run
        `map`, or the `map` of a thread pool.
    """
    slopes = stack_slopes(geometry, inverse_range_mm)
    reference = images[geometry.reference]
    greys = reference[seen[geometry.reference] > 0]
    low, high = np.percentile(greys, [DARK_PERCENTILE, BRIGHT_PERCENTILE]) if len(greys) else (0.0, 255.0)
    gain = 250.0 / max(high - low, MIN_RANGE_GREY)

    # Exclude pixels that cubic interpolation blends with invalid ones.
    valid = np.stack([np.asarray(cv2.erode(mask, np.ones((5, 5), np.uint8)), dtype=np.uint8) for mask in seen])

    def detect_in_slice(inverse_mm: float) -> tuple[Any, Any]:
        grey = (slice_of(geometry, images, valid, inverse_mm) - low) * gain
        picture = np.rint(np.clip(grey, 0.0, 255.0)).astype(np.uint8)
        return cv2.SIFT.create(2 * count, contrastThreshold=CONTRAST).detectAndCompute(picture, inner)

    found = list(run(detect_in_slice, slopes))
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
    """Indices (m,) of keypoints without a stronger one at the same place and scale, the strongest first."""
    octave = np.log2(scale_px)
    # Neighbours are searched scale by scale, within a distance in the coarser scale.
    weaker = np.zeros(len(pixels), dtype=bool)
    for level in range(int(np.floor(octave.min(initial=0.0))), int(np.ceil(octave.max(initial=0.0))) + 1):
        near = np.flatnonzero(np.abs(octave - level) <= 1.0)
        if len(near) < 2:
            continue
        unit = DUPLICATE_PX * 2.0**level
        tree = cKDTree(np.c_[pixels[near] / unit, octave[near] / DUPLICATE_OCTAVES])
        pairs = tree.query_pairs(1.0, output_type="ndarray")
        one, other = near[pairs[:, 0]], near[pairs[:, 1]]
        # Several orientations of one keypoint are equally strong.
        weaker[one[strength[one] < strength[other]]] = True
        weaker[other[strength[other] < strength[one]]] = True
    kept = np.flatnonzero(~weaker)
    return kept[np.argsort(-strength[kept], kind="stable")]
