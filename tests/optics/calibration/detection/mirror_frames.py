"""Frames of mirrors cut and glued with errors, for tests that find their edges."""

from __future__ import annotations

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.segmentation import Extremes, detected_edges, with_detected_outlines
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.layouts import faceted_parabola

PINHOLE = Camera(width_px=1920, height_px=1080, fx_px=1360.0, fy_px=1360.0, cx_px=959.5, cy_px=539.5)
CAMERA = PINHOLE.replaced(distortion=[0.05, -0.1, 0.0, 0.0, 0.0])
MEANT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.9).replaced(kind="calibrated")
FINE = 4  # parts of a pixel to which outlines are drawn


def cut_and_glued(mirror: Mirror, scale: tuple[float, float], by_mm: tuple[float, float], turn_deg: float) -> Mirror:
    """Return the mirror cut smaller, shifted and rotated in its own plane."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    outline = mirror.outline_in_plane_mm * scale @ rotation.T + by_mm
    frame = mirror.rig_from_plane
    return mirror.replaced(outline_in_rig_mm=frame[:3, 3] + outline @ frame[:3, :2].T)


SLIPS = [
    ((0.97, 0.98), (0.3, -0.3), 0.4),
    ((0.98, 0.96), (-0.3, 0.2), -0.3),
    ((0.96, 0.98), (0.2, 0.3), 0.2),
    ((1.0, 1.0), (0.0, 0.0), 0.0),
]
BUILT = MEANT.replaced(
    mirrors=tuple(cut_and_glued(mirror, *slip) for mirror, slip in zip(MEANT.mirrors, SLIPS, strict=True))
)


def worst_px(layout: Layout, index: int) -> float:
    """Return the largest error of the outline's corners on the sensor, relative to the device as built."""
    true, found = BUILT.outline_px(index, 1), layout.outline_px(index, 1)
    on_sensor = ((true > 2) & (true < [1917, 1077])).all(axis=1)
    assert on_sensor.sum() >= 3
    return float(np.linalg.norm(found - true, axis=1)[on_sensor].max())


def masks(of: Layout) -> list[NDArray[np.float32]]:
    """Return the part of each pixel (h, w) that each sub-image covers."""
    drawn = []
    for index, mirror in enumerate(of.mirrors):
        if mirror.is_second_surface:
            drawn.append(traced(mirror))
            continue
        canvas = np.zeros((1080 * FINE, 1920 * FINE), np.uint8)
        corners = np.rint((of.outline_px(index) + 0.5) * FINE - 0.5).astype(np.int32)
        filled = cv2.fillPoly(canvas, [corners], (255,))
        small = cv2.resize(filled, (1920, 1080), interpolation=cv2.INTER_AREA)
        drawn.append(np.asarray(small, dtype=np.float32) / np.float32(255.0))
    return drawn


def traced(mirror: Mirror) -> NDArray[np.float32]:
    """Mask (h, w) of the pixels whose light enters and leaves through the front face, by Snell's law."""
    x, y = np.meshgrid(np.arange(1920.0), np.arange(1080.0))
    rays = np.stack([(x - 959.5) / 1360.0, (y - 539.5) / 1360.0, np.ones_like(x)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    normal = mirror.normal_in_rig
    inwards = -rays @ normal
    at = rays * ((mirror.distance_mm - mirror.thickness_mm) / inwards)[:, None]
    across = (rays + inwards[:, None] * normal) / mirror.refractive_index
    out = at + 2.0 * mirror.thickness_mm * across / np.sqrt(1.0 - np.sum(across**2, axis=1, keepdims=True))
    axes, middle = mirror.rig_from_plane[:3, :2], mirror.rig_from_plane[:3, 3]
    front = shapely.Polygon(mirror.outline_in_plane_mm)
    shapely.prepare(front)
    inside = [shapely.contains_xy(front, *((points - middle) @ axes).T) for points in (at, out)]
    return np.asarray(np.logical_and(*inside).reshape(1080, 1920), dtype=np.float32)


def frames(count: int, layout: Layout = BUILT, *, inner: Layout | None = None) -> list[Grey]:
    """Patches of random brightness in each sub-image, blurred by a lens, on a holder that reflects a little.

    With `inner`, patches of every other frame end at the edges of those sub-images.
    """
    random = np.random.default_rng(3)

    outer = masks(layout)
    by_turns = [outer, outer if inner is None else masks(inner)]
    pictures = []
    for number in range(count):
        light: NDArray[np.float32] = np.full((1080, 1920), 20.0, np.float32)
        for mask in by_turns[number % 2]:
            patches = random.choice([30.0, 200.0], (27, 48)).astype(np.float32)
            shown = cv2.resize(patches, (1920, 1080), interpolation=cv2.INTER_NEAREST)
            light = np.asarray(light + mask * (shown - light), dtype=np.float32)
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), 1.0), dtype=np.float32)
        light += random.normal(0.0, 2.0, light.shape).astype(np.float32)
        pictures.append(np.clip(np.rint(light), 0, 255).astype(np.uint8))
    return pictures


def seen_in(pictures: list[Grey]) -> Extremes:
    extremes = Extremes()
    for picture in pictures:
        extremes.add(picture)
    return extremes


def outlined_in(layout: Layout, extremes: Extremes) -> tuple[Layout, tuple[str, ...]]:
    return with_detected_outlines(layout, detected_edges(layout, extremes))
