"""Keypoints and descriptors of the views, by OpenCV's detectors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.light_field.light_field import LightField

DetectorName = Literal["SIFT", "ORB", "AKAZE"]

# A keypoint this near to what a view does not show would be a corner of the border.
BORDER_PX = 5
ORB_SCALE_STEP = 1.2
# What OpenCV gives as the size of a keypoint of the finest scale: the diameter of ORB's patch; twice (AKAZE: three
# times) the scale 1.6 at which SIFT and AKAZE begin.
FINEST_SIZE_PX: dict[DetectorName, float] = {"SIFT": 2 * 1.6, "ORB": 31.0, "AKAZE": 3 * 1.6}


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
