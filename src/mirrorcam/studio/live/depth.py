"""Depth of a live session, in its own process at its own rate, so that it never delays the views."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth
from mirrorcam.optics.light_field.io.view_images import INVALID_GREY
from mirrorcam.optics.light_field.light_field import LightField

JPEG_QUALITY = 85
WORKERS = 2
"""Number of threads that measure depth."""
MIN_CONFIDENCE = 0.5
"""Minimum confidence of depth that is shown in colour."""


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """Depth of the reference view.

    Attributes
    ----------
    jpeg
        Colours from near (red) to far (blue), linear in 1 / depth; grey where unknown.
    depth_mm
        Depth (v, u), rounded; 0 where unknown.
    median_mm
        Median depth in the centre of the picture; NaN if unknown.
    """

    jpeg: bytes
    depth_mm: NDArray[np.uint16]
    median_mm: float


class LiveDepth:
    """Measures depth in light fields of one layout, filtered in time.

    Raises InputError if the views have no common field.
    """

    def __init__(self, layout: Path, width_px: int) -> None:
        cv2.setNumThreads(1)
        decoder = Decoder(Layout.load(layout), width_px=width_px)
        self._views, self._weights = decoder.views, decoder.weights
        samples = np.zeros((*decoder.weights.shape, 3), np.uint8)
        self._estimator = DepthEstimator(self._light_field(samples), quality="fast", workers=WORKERS)
        self._video = VideoDepth(self._estimator)

    def measure(self, samples: NDArray[np.uint8]) -> DepthPicture:
        """Estimate depth in the next samples (t, s, v, u, 3) of the session."""
        return self._picture(self._video.estimate(self._light_field(samples)))

    def _light_field(self, samples: NDArray[np.uint8]) -> LightField:
        return LightField.of(self._views, samples, self._weights)

    def _picture(self, depth: DepthMap) -> DepthPicture:
        valid = np.isfinite(depth.depth_mm) & (depth.confidence >= MIN_CONFIDENCE)
        inverse_depth = 1.0 / np.where(valid, depth.depth_mm, 1.0)
        near, far = 1.0 / self._estimator.near_mm, 1.0 / self._estimator.far_mm
        level = np.clip(255.0 * (inverse_depth - far) / (near - far), 0.0, 255.0).astype(np.uint8)
        coloured: Any = cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[..., ::-1]
        picture = np.where(valid[..., None], coloured, np.uint8(INVALID_GREY))
        height, width = valid.shape
        centre = (slice(height // 3, -(height // 3)), slice(width // 3, -(width // 3)))
        inner = depth.depth_mm[centre][valid[centre]]
        return DepthPicture(
            simplejpeg.encode_jpeg(np.ascontiguousarray(picture), JPEG_QUALITY),
            np.where(valid, np.clip(np.nan_to_num(depth.depth_mm), 0.0, 65535.0), 0.0).round().astype(np.uint16),
            float(np.median(inner)) if len(inner) else float("nan"),
        )
