"""Blur of what is out of focus, by how far away each pixel's object seems."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.fast.defocus import LEAST_BLUR_PX, defocused

MOST_BLUR_PX = 20.0
"""Sigma of the largest blur."""


def out_of_focus(radiance: NDArray[np.float32], along_axis_mm: FloatArray, camera: Camera) -> NDArray[np.float32]:
    """Blur a picture (h, w, 3) by the circle of confusion of a camera, at the distances (h, w) of what pixels show.

    A disc of the diameter f A |1 / focus - 1 / distance| has the variance of that squared over 16. Each pixel gathers
    the light of a disc of its own: at an edge, what is near does not spread over what is far.
    """
    if camera.aperture_mm == 0.0:
        return radiance
    nearness = 1.0 / along_axis_mm - 1.0 / camera.focus_mm
    variance = np.square(camera.fx_px * camera.aperture_mm / 4.0 * nearness).clip(max=MOST_BLUR_PX**2)
    if variance.max() < LEAST_BLUR_PX**2:
        return radiance
    share = variance.astype(np.float32)
    return np.stack([defocused(np.ascontiguousarray(radiance[..., c]), share, 1) for c in range(3)], axis=-1)
