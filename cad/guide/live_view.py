"""The expected live view of the assembled device: a picture, and an overlay of outlines for the camera's frames."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.guide.labels import WEIGHT
from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

PICTURE, OVERLAY = "live_view", "live_overlay"
"""Names of the two files in `pictures/`; the transparent overlay has the size of the camera's frames."""

SURROUNDINGS, PART, MIRROR = 226, 46, 203
"""Grey levels of the surroundings, of printed parts viewed head-on, and of the scene in the mirrors."""

LINE_RGB = (240, 120, 20)
TEXT_RGB = (28, 33, 45)
# Fractional bits of OpenCV's fixed-point pixel coordinates.
SUBPIXEL_BITS = 4
MIN_DEPTH_MM = 1.0
MAX_WIDTH_PX = 1400
# Minimum ratio of the frame's width to the height of a name.
MIN_WIDTH_TO_NAME = 32.0


def write_live_view(folder: Path, layout: Layout, components: Iterable[Component]) -> None:
    """Write `pictures/live_view.png` and `pictures/live_overlay.png` below a device's folder."""
    image = live_view(layout, components)
    scale = min(1.0, MAX_WIDTH_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    write_image(folder / "pictures" / f"{PICTURE}.png", np.asarray(small, dtype=np.uint8))
    encoded, data = cv2.imencode(".png", live_overlay(layout))
    if not encoded:
        raise OSError("the PNG encoder failed")
    write_bytes(folder / "pictures" / f"{OVERLAY}.png", data.tobytes())


def live_view(layout: Layout, components: Iterable[Component]) -> NDArray[np.uint8]:
    """The frame (h, w, 3) of the layout's camera: printed parts, the scene in each mirror, and the mirrors' names."""
    camera = layout.camera
    image = np.full((camera.height_px, camera.width_px, 3), SURROUNDINGS, dtype=np.uint8)
    triangles = [np.asarray(component.mesh.triangles) for component in components if component.kind == "part"]
    if triangles:
        _fill_parts(image, layout, np.concatenate(triangles))
    for index, name in enumerate(layout.mirror_names):
        usable = layout.outline_px(index, usable=True)
        if len(usable):
            cv2.fillPoly(image, [_fixed_point(usable)], (MIRROR,) * 3, cv2.LINE_AA, SUBPIXEL_BITS)
        outline = layout.outline_px(index)
        cv2.polylines(image, [_fixed_point(outline)], True, LINE_RGB, _line_px(layout), cv2.LINE_AA, SUBPIXEL_BITS)
        _draw_name(image, name, outline, TEXT_RGB)
    return image


def live_overlay(layout: Layout) -> NDArray[np.uint8]:
    """The same outlines and names on a transparent background, as BGRA (h, w, 4)."""
    camera = layout.camera
    image = np.zeros((camera.height_px, camera.width_px, 4), dtype=np.uint8)
    colour = (*LINE_RGB[::-1], 255)
    for index, name in enumerate(layout.mirror_names):
        outline = layout.outline_px(index)
        cv2.polylines(image, [_fixed_point(outline)], True, colour, _line_px(layout), cv2.LINE_8, SUBPIXEL_BITS)
        _draw_name(image, name, outline, colour)
    return image


def _fill_parts(image: NDArray[np.uint8], layout: Layout, triangles: FloatArray) -> None:
    """Draw triangles (n, 3, 3) in the rig frame as the camera sees them, farthest first, darker at grazing angles."""
    in_front = triangles[(triangles[..., 2] > MIN_DEPTH_MM).all(axis=1)]
    normals = np.cross(in_front[:, 1] - in_front[:, 0], in_front[:, 2] - in_front[:, 0])
    centroids = in_front.mean(axis=1)
    cosines = -(normals * centroids).sum(axis=1)
    norms = np.linalg.norm(normals, axis=1) * np.linalg.norm(centroids, axis=1)
    facing_camera = cosines > 1e-6 * norms
    corners = layout.camera.project(in_front[facing_camera])
    order = np.argsort(-centroids[facing_camera, 2], kind="stable")
    shade = 0.35 + 0.65 * cosines[facing_camera] / norms[facing_camera]
    for index in order:
        if np.isfinite(corners[index]).all():
            grey = int(PART * shade[index] * 1.6)
            cv2.fillConvexPoly(image, _fixed_point(corners[index]), (grey,) * 3, cv2.LINE_AA, SUBPIXEL_BITS)


def _fixed_point(points_px: FloatArray) -> NDArray[np.int32]:
    """Points (n, 2) as OpenCV's fixed-point integers with `SUBPIXEL_BITS` fractional bits, clipped to their range."""
    return np.asarray(np.round(np.clip(points_px, -1e5, 1e5) * (1 << SUBPIXEL_BITS)), dtype=np.int32)


def _line_px(layout: Layout) -> int:
    return max(2, round(layout.camera.width_px / 640))


def _draw_name(image: NDArray[np.uint8], name: str, outline: FloatArray, colour: tuple[int, ...]) -> None:
    """Draw a mirror's name at the centre of its outline, at most a sixth of its height."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    height, width = image.shape[:2]
    size = int(np.clip((high[1] - low[1]) / 6.0, 12.0, width / MIN_WIDTH_TO_NAME))
    font = cv2.FontFace("sans")
    box = cv2.getTextSize((width, height), name, (0, 0), font, size, WEIGHT)
    position = (low + high) / 2.0 - (box[2] / 2.0, -0.36 * size)
    cv2.putText(image, name, (int(position[0]), int(position[1])), colour, font, size, WEIGHT)
