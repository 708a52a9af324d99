"""Keypoints and descriptors of the views, from OpenCV's detectors or from extrema in the focal stack.

The focal stack averages the views after shifting them by a slope: objects with that slope are sharp, with less noise
than in any single view; others, including occluders in some views, are blurred. A keypoint is a local extremum of the
difference of Gaussians over position, scale and slope.

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
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from mirrorcam.optics.light_field.light_field import LightField

DetectorName = Literal["ORB", "AKAZE"]
# Keypoints closer to invalid pixels would be artefacts of the border.
BORDER_PX = 5
ORB_SCALE_STEP = 1.2
# OpenCV's keypoint size at the finest scale: ORB's patch diameter; for AKAZE (SIFT), three times (twice) the initial
# scale 1.6.
FINEST_SIZE_PX: dict[DetectorName, float] = {"ORB": 31.0, "AKAZE": 3 * 1.6}
SIFT_FINEST_SIZE_PX = 2 * 1.6
# Shift of the view with the longest baseline between adjacent slices of the focal stack.
STEP_PX = 1.0
# Distance, in px of its scale and octaves of scale, below which a weaker keypoint duplicates a stronger one.
DUPLICATE_PX, DUPLICATE_OCTAVES = 2.0, 0.6
# A duplicate at another slope competes if it predicts a position at least this far away, in px of its scale, in the
# view with the longest baseline, and has at least this fraction of the keypoint's strength.
COMPETING_PX, COMPETING_STRENGTH = 3.0, 0.8
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
        Downsampling factor (n,) of the scale at which the keypoint was detected.
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
    """Create an OpenCV detector of about this number of strongest keypoints, with thresholds for dim, blurred views.

    Raises InputError for an unknown name, and if this OpenCV lacks AKAZE (since version 5, it is a contributed module).
    """
    if name == "ORB":
        return cv2.ORB.create(keypoints, scaleFactor=ORB_SCALE_STEP, edgeThreshold=8, fastThreshold=7)
    if name != "AKAZE":
        raise InputError(f"detector {name!r}, expected {', '.join(get_args(DetectorName))}")
    if not hasattr(cv2, "xfeatures2d"):
        raise InputError(
            "detector AKAZE is not in this OpenCV: install opencv-contrib-python-headless instead of "
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
    """Return masks (t * s, v, u), 255 where keypoints are allowed: away from invalid pixels and the views' borders."""
    size = 2 * BORDER_PX + 1
    kernel = np.ones((size, size), np.uint8)
    valid = light_field.valid.reshape(-1, light_field.height_px, light_field.width_px).astype(np.uint8) * 255
    padded = [cv2.copyMakeBorder(view, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=[0]) for view in valid]
    return np.stack([cv2.erode(view, kernel)[1:-1, 1:-1] for view in padded])


def detect(
    images: NDArray[np.uint8],
    masks: NDArray[np.uint8],
    detectors: list[Any],
    name: DetectorName,
    run: Callable[..., Any],
) -> list[Keypoints]:
    """Detect keypoints in every image (n, v, u) by its own detector; `run` is `map`, or the `map` of a thread pool."""

    def detect_in(image: NDArray[np.uint8], mask: NDArray[np.uint8], detector: Any) -> Keypoints:
        detected, descriptors = detector.detectAndCompute(image, mask)
        if descriptors is None:
            descriptors = np.zeros((0, detector.descriptorSize()), np.uint8)
        return _keypoints(detected, descriptors, name)

    return list(run(detect_in, images, masks, detectors))


def _keypoints(detected: Any, descriptors: NDArray[Any], name: DetectorName) -> Keypoints:
    """Convert OpenCV's keypoints to arrays."""
    numbers = np.array([(*point.pt, point.size, point.angle) for point in detected], dtype=np.float64).reshape(-1, 4)
    return Keypoints(
        pixels=numbers[:, :2],
        scale_px=np.maximum(numbers[:, 2] / FINEST_SIZE_PX[name], 1.0),
        angle=np.deg2rad(numbers[:, 3]),
        descriptors=to_comparable(descriptors),
    )


def to_comparable(descriptors: NDArray[Any]) -> NDArray[Any]:
    """Convert descriptors for comparison: bits to 64-bit words, SIFT to square roots of its elements (RootSIFT).

    Arandjelovic and Zisserman, "Three things everyone should know to improve object retrieval", CVPR 2012.
    """
    if descriptors.dtype == np.uint8:
        padding = -descriptors.shape[1] % 8
        return np.pad(descriptors, ((0, 0), (0, padding))).view(np.uint64)
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), np.float32(1e-6))
    return np.sqrt(descriptors / total)


def differing_bits(first: NDArray[np.uint64], second: NDArray[np.uint64]) -> NDArray[np.float32]:
    """Return the numbers (n,) of bits in which pairs of binary descriptors (n, d) differ."""
    return np.bitwise_count(first ^ second).sum(axis=1).astype(np.float32)


def nearest_pairs(
    first: NDArray[Any], second: NDArray[Any], ratio: float = 0.8
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices (m,) and (m,) of mutual nearest neighbours closer than `ratio` times the second-nearest.

    Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004.
    """
    if len(first) < 2 or len(second) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    descriptor_distances = pairwise_distances(first, second)
    nearest, nearest_back = descriptor_distances.argmin(axis=1), descriptor_distances.argmin(axis=0)
    rows = np.arange(len(first))
    best = descriptor_distances[rows, nearest]
    next_best = np.partition(descriptor_distances, 1, axis=1)[:, 1]
    # For unit vectors, 1 minus the cosine is half the squared distance.
    limit = ratio if first.dtype == np.uint64 else ratio**2
    chosen = (nearest_back[nearest] == rows) & (best < limit * next_best)
    return np.flatnonzero(chosen), nearest[chosen]


def pairwise_distances(first: NDArray[Any], second: NDArray[Any]) -> NDArray[np.float32]:
    """Return the distances (n, m) between all descriptors of two pictures: differing bits, or 1 minus the cosine."""
    if first.dtype != np.uint64:
        return np.asarray(1.0 - first @ second.T, dtype=np.float32)
    bits = np.zeros((len(first), len(second)), np.float32)
    for word in range(first.shape[1]):
        bits += np.bitwise_count(first[:, None, word] ^ second[None, :, word])
    return bits


def slice_inverse_distances(geometry: ViewGeometry, inverse_distance_range: tuple[float, float]) -> FloatArray:
    """Return the inverse distances (n,), 1/mm, of the slices of a focal stack, far to near."""
    far, nearby = min(inverse_distance_range), max(inverse_distance_range)
    max_rate_px_mm = np.hypot(*geometry.lateral_mm.T).max() * geometry.focal_px[geometry.reference]
    return np.linspace(far, nearby, max(int(np.ceil((nearby - far) * max_rate_px_mm / STEP_PX)) + 1, 2))


def focal_slice(
    geometry: ViewGeometry, images: NDArray[Any], valid: NDArray[np.uint8], inverse_distance: float
) -> NDArray[np.float32]:
    """Return the mean (v, u), focused at an inverse distance, 1/mm, of the views that see each pixel; 0 without any."""
    height, width = images.shape[1:]
    total, weight = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height]])
    directions = geometry.directions(corners)
    for view, (image, mask) in enumerate(zip(images, valid, strict=True)):
        affine = cv2.getAffineTransform(
            corners.astype(np.float32), geometry.predict(view, directions, inverse_distance).astype(np.float32)
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
    geometry: ViewGeometry,
    images: NDArray[Any],
    valid: NDArray[np.uint8],
    inner: NDArray[np.uint8],
    inverse_distance_range: tuple[float, float],
    count: int,
    run: Callable[..., Any] = map,
) -> tuple[Keypoints, NDArray[np.int64], FloatArray]:
    """Detect the strongest keypoints of a light field, and return their rows (n,) and inverse distances (n,), 1/mm.

    The row of a keypoint comes again with each inverse distance that shows it as clearly, as in a repetitive pattern.

    Parameters
    ----------
    geometry
        Geometry of the views.
    images, valid
        Grey views (views, v, u), and masks of their valid pixels.
    inner
        Mask (v, u) of where keypoints of the reference view are allowed.
    inverse_distance_range
        Range of inverse distances to search, 1/mm.
    count
        Maximum number of keypoints.
    run
        `map`, or the `map` of a thread pool.
    """
    inverse_distances = slice_inverse_distances(geometry, inverse_distance_range)
    reference = images[geometry.reference]
    greys = reference[valid[geometry.reference] > 0]
    low, high = np.percentile(greys, [DARK_PERCENTILE, BRIGHT_PERCENTILE]) if len(greys) else (0.0, 255.0)
    gain = 250.0 / max(high - low, MIN_RANGE_GREY)

    # Exclude pixels that cubic interpolation blends with invalid ones.
    interior = np.stack([np.asarray(cv2.erode(mask, np.ones((5, 5), np.uint8)), dtype=np.uint8) for mask in valid])

    def detect_in_slice(inverse_distance: float) -> tuple[Any, Any]:
        grey = (focal_slice(geometry, images, interior, inverse_distance) - low) * gain
        picture = np.rint(np.clip(grey, 0.0, 255.0)).astype(np.uint8)
        return cv2.SIFT.create(2 * count, contrastThreshold=CONTRAST).detectAndCompute(picture, inner)

    slices = list(run(detect_in_slice, inverse_distances))
    points = [point for slice_points, _ in slices for point in slice_points]
    numbers = np.array([(*point.pt, point.size, point.angle, point.response) for point in points]).reshape(-1, 5)
    descriptors = [values for _, values in slices if values is not None]
    all_descriptors = np.concatenate(descriptors) if descriptors else np.zeros((0, 128), np.float32)
    inverse_distance = np.repeat(inverse_distances, [len(slice_points) for slice_points, _ in slices])
    scale = np.maximum(numbers[:, 2] / SIFT_FINEST_SIZE_PX, 1e-3)
    strength = numbers[:, 4]
    chosen, duplicates = _strongest(numbers[:, :2], scale, strength)
    chosen = chosen[:count]
    keypoints = Keypoints(
        pixels=numbers[chosen, :2],
        scale_px=np.maximum(scale[chosen], 1.0),
        angle=np.deg2rad(numbers[chosen, 3]),
        descriptors=to_comparable(all_descriptors[chosen]),
    )
    row = np.full(len(numbers), -1)
    row[chosen] = np.arange(len(chosen))
    stronger, weaker = duplicates.T
    max_rate_px_mm = np.hypot(*geometry.lateral_mm.T).max() * geometry.focal_px[geometry.reference]
    shift_px = np.abs(inverse_distance[stronger] - inverse_distance[weaker]) * max_rate_px_mm
    competes = (row[stronger] >= 0) & (shift_px > COMPETING_PX * scale[stronger])
    competes &= strength[weaker] >= COMPETING_STRENGTH * strength[stronger]
    rows = np.concatenate([np.arange(len(chosen)), row[stronger[competes]]])
    return keypoints, rows, np.concatenate([inverse_distance[chosen], inverse_distance[weaker[competes]]])


def _strongest(
    pixels: FloatArray, scale_px: FloatArray, strength: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices (m,) of keypoints without a stronger one at the same position and scale, strongest first, and
    pairs (p, 2) of a keypoint and a duplicate that is not stronger.
    """
    octave = np.log2(scale_px)
    # Neighbours are searched scale by scale, within a distance in the coarser scale.
    duplicates = [np.zeros((0, 2), np.int64)]
    for level in range(int(np.floor(octave.min(initial=0.0))), int(np.ceil(octave.max(initial=0.0))) + 1):
        nearby = np.flatnonzero(np.abs(octave - level) <= 1.0)
        if len(nearby) < 2:
            continue
        unit = DUPLICATE_PX * 2.0**level
        tree = cKDTree(np.c_[pixels[nearby] / unit, octave[nearby] / DUPLICATE_OCTAVES])
        pairs = tree.query_pairs(1.0, output_type="ndarray")
        first, second = nearby[pairs[:, 0]], nearby[pairs[:, 1]]
        for one, other in ((first, second), (second, first)):
            not_stronger = strength[other] <= strength[one]
            duplicates.append(np.column_stack([one[not_stronger], other[not_stronger]]))
    pairs = np.concatenate(duplicates)
    # Several orientations of one keypoint are equally strong.
    is_weaker = strength[pairs[:, 1]] < strength[pairs[:, 0]]
    remaining = np.setdiff1d(np.arange(len(pixels)), pairs[is_weaker, 1])
    return remaining[np.argsort(-strength[remaining], kind="stable")], pairs
