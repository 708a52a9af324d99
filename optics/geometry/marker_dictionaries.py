"""OpenCV's predefined dictionaries of square markers."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

_SIZES = (50, 100, 250, 1000)
NAMES = (
    *(f"DICT_{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in _SIZES),
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_36h11",
)
FAMILIES = tuple(name for name in NAMES if not name.endswith(tuple(f"_{count}" for count in _SIZES[:-1])))
"""The largest dictionary of each family; the smaller ones hold its first markers."""


def dictionary(name: str, markers: int | None = None) -> cv2.aruco.Dictionary:
    """The dictionary with a name in `NAMES`, or its first `markers` markers."""
    full = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    if markers is None:
        return full
    return cv2.aruco.Dictionary(full.bytesList[:markers], full.markerSize, full.maxCorrectionBits)


def canonical_name(name: str) -> str | None:
    """The name in `NAMES` that equals `name` except for case; None if there is none."""
    return next((candidate for candidate in NAMES if candidate.lower() == name.lower()), None)


def family(name: str) -> str:
    """The largest dictionary that starts with a dictionary's markers."""
    return name if name in FAMILIES else f"{name.rsplit('_', 1)[0]}_{_SIZES[-1]}"


def smallest(name: str, markers: int) -> str:
    """The smallest dictionary of a family with at least `markers` markers."""
    return min((other for other in NAMES if family(other) == family(name) and count(other) >= markers), key=count)


def count(name: str) -> int:
    """Number of markers in a dictionary."""
    return len(dictionary(name).bytesList)


def modules(name: str) -> int:
    """Modules along one side of a marker, including its black border."""
    return int(dictionary(name).markerSize) + 2


@lru_cache(maxsize=32)
def white_modules(name: str) -> NDArray[np.bool_]:
    """Masks (count, modules, modules) of the white modules of all markers, including their black borders."""
    side, markers = modules(name), dictionary(name)
    images = [markers.generateImageMarker(number, side, borderBits=1) for number in range(count(name))]
    white = np.array(images) > 0
    white.flags.writeable = False
    return white
