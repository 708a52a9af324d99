"""Detections are loaded as they were saved, or not at all."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.disk.program import program_of
from mirrorcam.core.disk.results import Results
from mirrorcam.optics.calibration.detection import detection_cache
from mirrorcam.optics.calibration.detection.detections import DetectedFrame, DetectedGrid
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.boards import Charuco

BOARD = Charuco(cols=5, rows=4, square_mm=20.0, marker_mm=15.0)
GREY = np.arange(24, dtype=np.uint8).reshape(4, 6)


GRID = {
    "grid_mirror": np.array([1]),
    "grid_of": np.zeros(3, np.int64),
    "grid_places": np.arange(6).reshape(3, 2),
    "grid_pixels": np.arange(6.0).reshape(3, 2),
    "grid_sigma_px": np.ones(3),
    "grid_limits": np.array([[[-np.inf, 0.0], [np.inf, np.inf]]]),
}


def test_the_name_depends_on_pixels_shape_and_board() -> None:
    name = detection_cache.name_of(GREY, BOARD, 0)
    assert name == detection_cache.name_of(GREY.copy(), BOARD, 0)
    others = (
        detection_cache.name_of(GREY + np.uint8(1), BOARD, 0),
        detection_cache.name_of(GREY.reshape(6, 4), BOARD, 0),
        detection_cache.name_of(GREY, BOARD, 18),
        detection_cache.name_of(GREY, BOARD.replaced(square_mm=21.0), 0),
    )
    assert len({name, *others}) == 5


def loaded(folder: Path) -> DetectedFrame | None:
    return detection_cache.load(Results(folder), "a", views=2, corners=5)


def test_saved_detections_are_loaded(tmp_path: Path) -> None:
    seen = Observations(np.zeros(2, np.int64), np.array([0, 1]), np.array([3, 4]), np.array([[1.5, 2.0], [3.0, 4.25]]))
    assert loaded(tmp_path) is None
    corners = Corners(np.arange(3), GRID["grid_pixels"])
    grid = DetectedGrid(GRID["grid_places"], corners, GRID["grid_limits"][0])
    detection_cache.save(Results(tmp_path), "a", DetectedFrame(seen, np.array([[7.25, 8.0]]), ((1, grid),)))
    found = loaded(tmp_path)
    assert found is not None and found.corners.pixels.tobytes() == seen.pixels.tobytes()
    assert found.unassigned_px.tolist() == [[7.25, 8.0]]
    ((mirror, kept),) = found.grids
    assert mirror == 1
    np.testing.assert_array_equal(kept.grid_xy, grid.grid_xy)
    np.testing.assert_array_equal(kept.corners.pixels, corners.pixels)
    np.testing.assert_array_equal(kept.limits, grid.limits)


@pytest.mark.parametrize(
    "arrays",
    [
        {"view": np.array([0, 2])},
        {"view": np.array([-2, 0])},
        {"corner": np.array([3, 5])},
        {"corner": np.array([-1, 0])},
        {"pixels": np.full((2, 2), np.nan)},
        {"pixels": np.zeros((3, 2))},
        {"sigma_px": np.array([1.0, 0.0])},
        {"view": np.array(["a", "b"])},
        {"view": np.zeros(2_000_000, np.int64)},
        {"unassigned": np.zeros(2)},
        {"unassigned": np.full((1, 2), np.inf)},
        {"unassigned": np.array([["a", "b"]])},
        {"grid_mirror": np.array([2])},
        {"grid_places": np.zeros((2, 2))},
        {"grid_pixels": np.full((3, 2), np.inf)},
        {"grid_sigma_px": np.zeros(3)},
        {"grid_limits": np.zeros((2, 2))},
    ],
)
def test_invalid_content_is_ignored(arrays: dict[str, Any], tmp_path: Path) -> None:
    right: dict[str, Any] = {"view": np.array([0, 1]), "corner": np.array([3, 4]), "pixels": np.ones((2, 2))}
    right |= {"sigma_px": np.ones(2), "unassigned": np.empty((0, 2))} | GRID
    for content, valid in ((right, True), (right | arrays, False)):
        stream = io.BytesIO()
        np.savez_compressed(stream, **content)
        kept = {"frame.npz": stream.getvalue()}
        Results(tmp_path).put("a", program_of(detection_cache.CODE), kept)
        assert (loaded(tmp_path) is not None) == valid
