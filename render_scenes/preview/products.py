"""Products of a preview: its decoded views, refocused pictures, and a depth map."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import UNVIGNETTED, Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.equalisation import Equalisation
from mirrorcam.optics.light_field.io.view_images import tiled_views
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus, to_bytes
from mirrorcam.render_scenes.preview.preview_frame import PreviewFrame
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm

NEAR_MARGIN, FAR_MARGIN = 0.85, 1.3
"""Limits of the depth search, relative to the nearest and the farthest depth of a design."""
MIN_DEPTH_FACTOR = 1.05
"""Minimum depth of the search, relative to that of the nearest possible object."""
SRGB_EXPONENT = 1.0 / 2.2
"""Approximate exponent of sRGB grey levels as a function of light."""
MIN_BRIGHTNESS = 0.25
"""Brightness of depths with zero confidence."""
UNKNOWN_GREY = 64


@dataclass(frozen=True, eq=False)
class PreviewProducts:
    """The preview of a layout, and its products.

    Attributes
    ----------
    frame
        The picture of the camera.
    light_field
        The views decoded from the picture.
    depth
        Depth of the reference view, measured in all views, with its confidence.
    search_range_mm
        Search range of depths.
    true_depth_mm
        (v, u): true depth in the reference view; infinite where there is no surface, NaN where the view has no sample
        or a vignetted one.
    """

    frame: PreviewFrame
    light_field: LightField
    depth: DepthMap
    search_range_mm: tuple[float, float]
    true_depth_mm: FloatArray

    def views_picture(self) -> NDArray[np.uint8]:
        """Return all views in one picture (h, w, 3), in the arrangement of the mirrors."""
        return tiled_views(self.light_field)

    def refocused(self, depth_mm: float, tilt_deg: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.uint8]:
        """Return the picture (v, u, 3) of all views in focus on a plane at a depth.

        Raises InputError if some views do not see the plane.
        """
        return to_bytes(refocus(self.light_field, FocalPlane.at_depth(self.light_field, depth_mm, tilt_deg)))

    def depth_picture(self, near_mm: float | None = None, far_mm: float | None = None) -> NDArray[np.uint8]:
        """Return the depth map (v, u, 3) in colours from near (red) to far (blue), darker where confidence is lower.

        Colours are linear in the reciprocal of depth, over the search range or the given one. Grey means no depth.
        """
        near, far = self.search_range_mm
        near, far = near if near_mm is None else near_mm, far if far_mm is None else far_mm
        fraction = (1.0 / self.depth.depth_mm - 1.0 / far) / (1.0 / near - 1.0 / far)
        level = np.rint(255.0 * np.clip(np.nan_to_num(fraction), 0.0, 1.0)).astype(np.uint8)
        colours = np.asarray(cv2.applyColorMap(level, cv2.COLORMAP_TURBO))[..., ::-1]
        brightness = (MIN_BRIGHTNESS + (1.0 - MIN_BRIGHTNESS) * self.depth.confidence)[..., None]
        grey = np.full_like(colours, UNKNOWN_GREY)
        return np.where(self.depth.valid[..., None], np.rint(colours * brightness).astype(np.uint8), grey)

    @property
    def median_error_mm(self) -> float:
        """Median error of the depth map on surfaces; NaN if no depth is known."""
        valid = self.depth.valid & np.isfinite(self.true_depth_mm)
        error = np.abs(self.depth.depth_mm[valid] - self.true_depth_mm[valid])
        return float(np.median(error)) if error.size else float("nan")


def preview_products(frame: PreviewFrame) -> PreviewProducts:
    """Decode a preview, and measure depth in it with the fast search.

    Raises InputError if a mirror shows nothing, views share no field of view, or there is only one view.
    """
    decoder = _decoder(frame)
    light_field = decoder.decode(frame.picture)
    near, far = _search_range_mm(frame.layout, light_field)
    depth = DepthEstimator(light_field, near_mm=near, far_mm=far, quality="fast").estimate(light_field)
    return PreviewProducts(frame, light_field, depth, (near, far), _true_depth(decoder, frame))


def _decoder(frame: PreviewFrame) -> Decoder:
    """Return the decoder of a preview, matched to the tone curve of its grey levels."""
    decoder = Decoder(frame.layout)
    if frame.sensor.tone_curve == "linear":
        return decoder
    unit_gain = np.ones((decoder.views.rows, decoder.views.cols, 3))
    identity = decoder.views.layout_identity
    return decoder.equalised(Equalisation(layout_identity=identity, gain=unit_gain, exponent=SRGB_EXPONENT))


def _search_range_mm(layout: Layout, views: LightField) -> tuple[float, float]:
    """Return the search range of a preview: the depths of its subject with a margin, but always beyond the mirrors."""
    depths = default_depths_mm(layout)
    foremost_mm = views.reference_view_depth_mm + float(views.positions_mm[..., 2].max())
    near = max(NEAR_MARGIN * min(depths), MIN_DEPTH_FACTOR * foremost_mm)
    return near, max(FAR_MARGIN * max(depths), FAR_MARGIN * near)


def _true_depth(decoder: Decoder, frame: PreviewFrame) -> FloatArray:
    """Return the depths (v, u) of the surfaces in the reference view."""
    reference = reference_index(decoder.views)
    is_background = np.isinf(frame.light.depth_mm)
    depth = np.where(is_background, 0.0, frame.light.depth_mm)
    farthest_mm = max(float(depth.max()), 1.0)
    channels = np.stack([depth / farthest_mm, is_background, is_background], axis=-1).astype(np.float32)
    decoded = decoder.decode(channels).samples[reference]
    # Pixels that mix a surface with the background have no depth.
    true_depth = np.where(decoded[..., 1] == 0.0, farthest_mm * decoded[..., 0].astype(np.float64), np.nan)
    true_depth[decoded[..., 1] == 1.0] = np.inf
    return np.where(decoder.weights[reference] >= UNVIGNETTED, true_depth, np.nan)
