"""The page of a decoded frame: one HTML file, in which the browser refocuses and moves the viewpoint."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.html.templates import render
from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.features import Features
from mirrorcam.optics.light_field.io.view_images import INVALID_GREY
from mirrorcam.optics.light_field.render.perspective import orbit
from mirrorcam.optics.light_field.render.view_depths import AGREEMENT_PX, px_per_inverse_mm
from mirrorcam.studio.demo.decoded_frame import BETWEEN, DecodedFrame
from mirrorcam.studio.page import WEB, script_json

SCRIPTS = ("dom.js", "light_field.js", "demo.js")
JPEG_QUALITY = 88
LEVELS = 255
"""Depths are stored in equal steps of inverse distance, in 8 bits."""
NEAREST, FARTHEST = 99.5, 0.5
"""Percentiles of inverse distance between which depths are stored."""
MARGIN = 0.06
"""Share of that range by which it is extended: the ends of the colours are nearly black."""
CORNERS = 4
"""Viewpoints of an orbit that span its extent."""


def demo_page(decoded: DecodedFrame, folder: Path) -> str:
    """Render the page of a decoded frame whose inputs lie in a folder."""
    field, dense, features = decoded.light_field, decoded.dense, decoded.features
    inverse = decoded.depths.inverse_distance
    reference = reference_index(field)
    far, near = (float(np.percentile(inverse[reference], percentile)) for percentile in (FARTHEST, NEAREST))
    far, near = far - MARGIN * (near - far), near + MARGIN * (near - far)
    level = np.rint(np.clip((inverse - far) / (near - far), 0.0, 1.0) * LEVELS).astype(np.uint8)
    flags = [(mask * LEVELS).astype(np.uint8) for mask in (decoded.depths.measured, field.valid)]
    shown = np.where(dense.valid[..., None], dense.samples, np.uint8(INVALID_GREY))
    extent = np.array(list(orbit(field, CORNERS)))
    start: dict[str, Any] = {
        "size_px": [field.width_px, field.height_px],
        "focal_px": field.focal_px,
        "centre_px": field.centre_px.tolist(),
        "reference_inverse_mm": 1.0 / field.reference_distance_mm,
        "pupil_offset_mm": field.reference_view_depth_mm,
        "grid": [field.rows, field.cols],
        "reference": list(reference),
        "step": BETWEEN + 1,
        "positions_mm": dense.positions_mm.round(4).tolist(),
        "inverse_mm": [far, near],
        "tolerance_per_mm": AGREEMENT_PX / px_per_inverse_mm(field),
        "viewpoint_mm": [extent.min(axis=0)[:2].tolist(), extent.max(axis=0)[:2].tolist()],
        "colours": turbo(),
        "features": [_feature(features, number) for number in range(len(features))],
        "views_jpg": _uri(encoded_image(tiled(shown), ".jpg", JPEG_QUALITY), "jpeg"),
        "valid_png": _uri(encoded_image(tiled(dense.valid[..., None].repeat(3, -1) * np.uint8(255)), ".png"), "png"),
        "depths_png": _uri(encoded_image(tiled(np.stack([level, *flags], axis=-1)), ".png"), "png"),
    }
    return render(
        WEB,
        "demo.html",
        start=script_json(start),
        scripts=SCRIPTS,
        nonce="",
        frame=_uri(decoded.frame_jpeg, "jpeg"),
        size_px=(field.width_px, field.height_px),
        views=field.rows * field.cols,
        grid=(field.rows, field.cols),
        apart_mm=abs(field.step_mm("s")),
        features=len(features),
        depth_percent=100.0 * float(decoded.depths.measured[reference].mean()),
        inputs=folder.as_posix(),
    )


def tiled(views: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Arrange views (t, s, v, u, 3) in one picture (t * v, s * u, 3) without gaps."""
    rows, cols, height, width, channels = views.shape
    return np.ascontiguousarray(views.transpose(0, 2, 1, 3, 4).reshape(rows * height, cols * width, channels))


def turbo() -> list[str]:
    """Return the colours of depth, from far to near, in hexadecimal digits."""
    levels = np.arange(LEVELS + 1, dtype=np.uint8)[:, None]
    bgr = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_TURBO)).reshape(-1, 3)
    return [f"{red:02x}{green:02x}{blue:02x}" for blue, green, red in bgr.tolist()]


def _feature(features: Features, number: int) -> list[Any]:
    """Return depth and its sigma, mm, the pixel in the reference view, and those in all views, or None if not seen."""
    pixels = np.where(features.seen[number][..., None], features.seen_px[number], np.nan).reshape(-1, 2)
    seen = [None if np.isnan(pixel).any() else [round(float(value), 1) for value in pixel] for pixel in pixels]
    pixel = [round(float(value), 1) for value in features.pixels[number]]
    return [round(float(features.depth_mm[number]), 1), round(float(features.depth_sigma_mm[number]), 2), pixel, seen]


def _uri(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{b64encode(content).decode()}"
