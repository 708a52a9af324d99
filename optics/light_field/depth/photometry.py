"""Making pictures of views comparable: equal local contrast for the search, equal brightness for the refinement.

Mirrors reflect unevenly and a lens darkens its corners, so that the same thing differs by up to a fifth between views.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.light_field.light_field import LightField

Float32 = NDArray[np.float32]

NO_SAMPLE = -1e4
"""What a grey picture holds where there is no sample: whatever is blended with some of it is negative."""
WINDOW_PX = 7
"""Side of the square over which brightness and contrast are made alike."""
NOISE = 4.0
"""Standard deviation, of 255, below which contrast is not raised further."""
CONTRAST = 50.0
LEAST_GAIN, MOST_GAIN = np.float32(0.4), np.float32(2.5)
GAIN_STRIDE_PX = 8
GAIN_PATCH_PX = 5
FEWEST_SAMPLES = 50
HIDDEN = (24.0, 12.0, 6.0, 6.0)
"""Difference, of 255, from which on two samples probably do not show the same place, round after round."""


def grey(light_field: LightField, index: tuple[int, int]) -> Float32:
    """A view (v, u) in grey, 0 to 255, `NO_SAMPLE` where there is none."""
    samples: Any = light_field.samples[index]
    picture: Any = samples[..., 0] if samples.shape[-1] == 1 else cv2.cvtColor(samples, cv2.COLOR_RGB2GRAY)
    if samples.dtype == np.uint8:
        picture = picture.astype(np.float32)
    else:
        picture = np.clip(picture, np.float32(0.0), np.float32(1.0)) * np.float32(255.0)
    picture[light_field.weights[index] <= 0] = NO_SAMPLE
    return np.asarray(picture)


def normalised(picture: Float32) -> NDArray[np.uint8]:
    """A grey picture (v, u) with its local mean taken off and its local contrast made alike; mid-grey has no contrast.

    Local means leave out what is no sample; there the result is mid-grey.
    """
    size = (WINDOW_PX, WINDOW_PX)
    known = (picture >= 0).astype(np.float32)
    part = np.maximum(cv2.boxFilter(known, -1, size), np.float32(1e-3))
    centred = picture - cv2.boxFilter(picture * known, -1, size) / part
    centred *= known
    variance = np.maximum(cv2.boxFilter(np.square(centred), -1, size) / part, np.float32(0.0))
    centred *= np.float32(CONTRAST) / (np.sqrt(variance) + np.float32(NOISE))
    centred += np.float32(128.5)
    return np.clip(centred, 0.0, 255.0).astype(np.uint8)


def patches(picture: Float32) -> Float32:
    """Means over small squares of a grey picture (v, u); negative where one holds no sample."""
    return np.asarray(cv2.blur(picture, (GAIN_PATCH_PX, GAIN_PATCH_PX)))


def brightened(picture: Float32, across: Float32, down: Float32, reference: Float32) -> Float32:
    """A grey view (v, u) brought to the brightness of the reference view.

    The gain is a plane over the view, g = a + b u + c v, fitted to what both show of the same places; places that
    differ too much, hidden in one of them, lose their say round after round (Geman-McClure weights).

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
        return picture
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
    return np.asarray(np.clip(plane, LEAST_GAIN, MOST_GAIN) * picture)
