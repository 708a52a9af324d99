"""Making pictures of views comparable: equal brightness, roughly before depth is known and to a plane after.

Mirrors reflect unevenly and a lens darkens its corners, so that the same thing differs by up to a fifth between views.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.light_field import LightField

Float32 = NDArray[np.float32]

NO_SAMPLE = -1e4
"""What a grey picture holds where there is no sample: whatever is blended with some of it is negative."""
FILL_PX = 5
"""Side of the square whose mean stands where a sample is missing, so that no false edge is seen beside it."""
LEAST_GAIN, MOST_GAIN = np.float32(0.4), np.float32(2.5)
GAIN_STRIDE_PX = 8
GAIN_PATCH_PX = 5
FEWEST_SAMPLES = 50
SURE_GAIN = 0.03
"""Part by which views must differ in brightness before anything is known of depth, to be made alike."""
HIDDEN = (24.0, 12.0, 6.0, 6.0)
"""Difference, of 255, from which on two samples probably do not show the same place, round after round."""


@dataclass(frozen=True, eq=False)
class ViewPicture:
    """A view made ready for comparison.

    Attributes
    ----------
    colours
        (v, u, 3), 0 to 255, the means of samples near by where there is none.
    known
        Mask (v, u) of samples.
    """

    colours: Float32
    known: NDArray[np.bool_]

    @classmethod
    def of(cls, light_field: LightField, index: tuple[int, int]) -> ViewPicture:
        """View (t, s) of a light field; a grey one has three like colours."""
        samples: Any = light_field.samples[index]
        colours = samples.astype(np.float32)
        if samples.dtype == np.float32:
            colours = np.clip(colours, np.float32(0.0), np.float32(1.0)) * np.float32(255.0)
        colours = np.broadcast_to(colours, (*samples.shape[:2], 3)).copy()
        known = light_field.weights[index] > 0
        if not known.all():
            share = cv2.blur(known.astype(np.float32), (FILL_PX, FILL_PX))
            mean = cv2.blur(colours * known[..., None], (FILL_PX, FILL_PX)) / np.maximum(share, 1e-3)[..., None]
            colours[~known] = mean[~known]
        return cls(colours, known)

    @property
    def brightness(self) -> Float32:
        """Brightness (v, u) of the colours, 0 to 255."""
        return np.asarray(cv2.cvtColor(self.colours, cv2.COLOR_RGB2GRAY))

    @property
    def grey(self) -> Float32:
        """Brightness (v, u), 0 to 255, `NO_SAMPLE` where there is no sample."""
        return np.where(self.known, self.brightness, np.float32(NO_SAMPLE))

    @property
    def seen(self) -> NDArray[np.uint8]:
        """Mask (v, u) of samples whose neighbours are samples, too, as uint8."""
        return np.asarray(cv2.erode(self.known.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1))

    def halved(self) -> ViewPicture:
        """Two by two pixels joined; what one of them lacks is unknown. An odd last column or row is left out."""
        rows, columns = self.known.shape[0] // 2, self.known.shape[1] // 2
        even = (slice(2 * rows), slice(2 * columns))
        joined = cv2.resize(self.colours[even], (columns, rows), interpolation=cv2.INTER_AREA)
        known = self.known[even]
        both = known[::2] & known[1::2]
        return ViewPicture(np.asarray(joined), both[:, ::2] & both[:, 1::2])

    def brighter(self, gain: Float32 | float) -> ViewPicture:
        """The view with its brightness times a gain, a number or a map (v, u)."""
        factor = np.asarray(gain, dtype=np.float32)
        if factor.ndim == 0 and factor == 1:
            return self
        return ViewPicture(self.colours * (factor[..., None] if factor.ndim else factor), self.known)


def first_gain(picture: Float32, reference: Float32) -> float:
    """Factor that makes a grey view (v, u) about as bright as the reference view, before depth is known; else 1.

    The median ratio of means over large squares; below `SURE_GAIN`, depth itself may explain it.
    """
    side = max(3, min(picture.shape) // 8)
    both = (picture >= 0) & (reference >= 0)

    def mean(of: Float32) -> Float32:
        means: Any = cv2.blur(np.where(both, of, np.float32(0.0)), (side, side))
        return np.asarray(means[side // 2 :: side, side // 2 :: side])

    ours, theirs = mean(reference), mean(picture)
    usable = (ours > 1.0) & (theirs > 1.0)
    if not usable.any():
        return 1.0
    gain = float(np.median(ours[usable] / theirs[usable]))
    return float(np.clip(gain, LEAST_GAIN, MOST_GAIN)) if abs(gain - 1.0) > SURE_GAIN else 1.0


def patches(picture: Float32) -> Float32:
    """Means over small squares of a grey picture (v, u); negative where one holds no sample."""
    return np.asarray(cv2.blur(picture, (GAIN_PATCH_PX, GAIN_PATCH_PX)))


def matching_gain(picture: Float32, across: Float32, down: Float32, reference: Float32) -> Float32:
    """Gain (v, u) that brings a grey view to the brightness of the reference view; ones where too little is shared.

    The gain is a plane over the view, g = a + b u + c v, fitted to what both show of the same places; places that
    differ too much, hidden in one of them, lose weight round after round (Geman-McClure).

    Parameters
    ----------
    picture
        The view (v, u), 0 to 255, `NO_SAMPLE` where there is none.
    across, down
        Pixels u, v (m, n) of the view that show some places of the reference view.
    reference
        Brightness (m, n) of these places in the reference view, as `patches` gives it.
    """
    theirs = np.asarray(
        cv2.remap(patches(picture), across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
    )
    both = (theirs >= 0) & (reference >= 0)
    if np.count_nonzero(both) < FEWEST_SAMPLES:
        return np.ones_like(picture)
    height, width = picture.shape
    basis = np.stack([np.ones_like(across), across / width - 0.5, down / height - 0.5], axis=-1)[both].astype(float)
    target = reference[both].astype(float)
    terms, weight = basis * theirs[both].astype(float)[:, None], np.ones(len(target))
    for hidden in HIDDEN:
        weighted = terms * weight[:, None]
        # A trifle of a gain of one, so that a black picture has a gain.
        gain = np.linalg.solve(weighted.T @ terms + np.eye(3), weighted.T @ target + [1.0, 0.0, 0.0])
        weight = 1.0 / np.square(1.0 + np.square((terms @ gain - target) / hidden))
    columns = np.arange(width, dtype=np.float32) / np.float32(width) - np.float32(0.5)
    rows = np.arange(height, dtype=np.float32)[:, None] / np.float32(height) - np.float32(0.5)
    plane = (np.float32(gain[0]) + np.float32(gain[1]) * columns) + np.float32(gain[2]) * rows
    return np.asarray(np.clip(plane, LEAST_GAIN, MOST_GAIN))
