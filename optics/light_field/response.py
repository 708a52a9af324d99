"""How grey levels grow with light, measured where a lens sees less and less of the scene.

Towards the border of a view its mirror serves a known share s of the pupil. There a camera of linear response gives s
times what it gives just inside, one with a gamma curve about s to the power of the curve's exponent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField

LINEAR = 1.0
NEARLY_LINEAR = 0.1
"""What one frame of a linear camera gives is no farther from 1: nearer exponents count as 1."""
LEAST, MOST = 0.2, 2.0
MOST_SHARE = 0.9
"""Share above which light hardly falls."""
DARK, BRIGHT = 10.0, 200.0
OUTLIER = 0.1
"""Difference of logarithms from which on a place probably shows something else than the one inside."""
ROUNDS = 20
FEWEST_PLACES = 1000


@dataclass(frozen=True)
class Fading:
    """Logarithms (n,) of shares of the pupil, and of grey levels over those of the nearest place with all of it."""

    share: FloatArray
    level: FloatArray

    @classmethod
    def of(cls, light_field: LightField) -> Self:
        """That of a light field brightened as one of a linear camera."""
        scale = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
        shares, levels = [np.zeros(0)], [np.zeros(0)]
        for index in np.ndindex(light_field.rows, light_field.cols):
            weights = light_field.weights[index]
            whole = weights == 1.0
            if not whole.any():
                continue
            grey = light_field.samples[index].astype(np.float32).mean(axis=-1) * np.float32(scale)
            inside = np.asarray(cv2.blur(grey, (3, 3))).ravel()[_nearest(whole)]
            there = (weights > 0.0) & (weights < MOST_SHARE)
            for level in (grey * weights, inside):
                there &= (level > DARK) & (level < BRIGHT)
            shares.append(np.log(weights[there].astype(np.float64)))
            levels.append(np.log(grey[there].astype(np.float64) / inside[there]))
        return cls(np.concatenate(shares), np.concatenate(levels))


def measured_exponent(fading: Sequence[Fading]) -> float:
    """Exponent of grey levels over light; 1 where it is hardly another, or there are too few places to measure it."""
    share, level = (np.concatenate(each) for each in zip(*((f.share, f.level) for f in fading), strict=True))
    if len(share) < FEWEST_PLACES:
        return LINEAR
    slope, trust = 0.0, np.ones(len(share))
    for _ in range(ROUNDS):
        slope = float((trust * share * level).sum() / (trust * share * share).sum())
        trust = 1.0 / (1.0 + np.square((level - slope * share) / OUTLIER))
    return LINEAR if abs(slope) < NEARLY_LINEAR else float(np.clip(LINEAR + slope, LEAST, MOST))


def _nearest(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Index (v, u) of the nearest pixel of a mask (v, u)."""
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros(int(labels.max()) + 1, np.intp)
    places[labels[mask]] = np.flatnonzero(mask)
    return places[labels]
