"""Sub-images found where the picture changes, against the outlines of the mirrors that made it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from optics.calibration.detection.corners import Grey
from optics.calibration.detection.segmentation import Extremes, segment
from optics.camera import Camera
from optics.layout import Layout
from optics.spec import DesignSpec
from optics.values import FloatArray
from tests.optics.conftest import faceted_parabola

CAMERA = Camera(width_px=1920, height_px=1080, fx_px=1360.0, fy_px=1360.0, cx_px=959.5, cy_px=539.5)
NOMINAL = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.88)
FINE = 4  # parts of a pixel to which outlines are drawn


def strayed() -> Layout:
    """Mirrors tilted by 2 degrees and moved by 1 mm, each another way."""
    mirrors = tuple(
        mirror.moved(
            Rotation.from_rotvec(
                np.radians(2.0) * mirror.rig_from_plane[:3, :2] @ [np.cos(turn), np.sin(turn)]
            ).as_matrix(),
            away * mirror.normal_in_rig,
        )
        for mirror, turn, away in zip(NOMINAL.mirrors, (0.4, 2.1, 3.5, 5.2), (1.0, -1.0, 0.5, -1.0), strict=True)
    )
    return NOMINAL.replaced(kind="as-built", mirrors=mirrors)


BUILT = strayed()


def corners_px(layout: Layout, index: int) -> FloatArray:
    return layout.camera.pixels_from_normalized(layout.mirrors[index].outline_normalized)


def frames(count: int) -> list[Grey]:
    """Patches of random brightness in each sub-image, blurred by a lens, on a holder that reflects a little."""
    random = np.random.default_rng(3)
    masks = []
    for index in range(len(BUILT.mirrors)):
        canvas = np.zeros((1080 * FINE, 1920 * FINE), np.uint8)
        corners = np.rint((corners_px(BUILT, index) + 0.5) * FINE - 0.5).astype(np.int32)
        filled = cv2.fillConvexPoly(canvas, corners, (255,))
        small = cv2.resize(filled, (1920, 1080), interpolation=cv2.INTER_AREA)
        masks.append(np.asarray(small, dtype=np.float32) / np.float32(255.0))
    pictures = []
    for _ in range(count):
        light: NDArray[np.float32] = np.full((1080, 1920), 20.0, np.float32)
        for mask in masks:
            patches = random.choice([30.0, 200.0], (27, 48)).astype(np.float32)
            shown = cv2.resize(patches, (1920, 1080), interpolation=cv2.INTER_NEAREST)
            light = np.asarray(light + mask * (shown - light), dtype=np.float32)
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), 1.0), dtype=np.float32)
        light += random.normal(0.0, 2.0, light.shape).astype(np.float32)
        pictures.append(np.clip(np.rint(light), 0, 255).astype(np.uint8))
    return pictures


def test_edges_are_found_where_tilted_mirrors_have_them() -> None:
    extremes = Extremes()
    for picture in frames(10):
        extremes.add(picture)
    for index, outline in enumerate(segment(extremes, NOMINAL)):
        assert outline is not None
        true, nominal = corners_px(BUILT, index), corners_px(NOMINAL, index)
        assert np.linalg.norm(nominal - true, axis=1).max() > 8.0
        on_sensor = ((true > 0) & (true < [1919, 1079])).all(axis=1)
        assert on_sensor.sum() >= 3
        assert outline.seen.sum() >= 3
        sure = on_sensor & outline.seen & np.roll(outline.seen, 1)
        assert np.linalg.norm(outline.corners_px - true, axis=1)[sure].max() < 0.6
        assert outline.rms_px[outline.seen].max() < 0.5


def test_where_nothing_changes_there_is_no_outline() -> None:
    extremes = Extremes()
    with pytest.raises(ValueError, match="no frame"):
        extremes.change()
    for _ in range(3):
        extremes.add(np.full((1080, 1920), 90, np.uint8))
    assert segment(extremes, NOMINAL) == [None] * 4
