"""What was found in a picture is found again only where something decides otherwise about it."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.detection import detection_cache
from mirrorcam.optics.calibration.detection.detections import DetectedFrame, SeenGrid
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.targets import Charuco

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


def test_another_version_of_a_library_finds_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    version, now = detection_cache.version(), metadata.version
    monkeypatch.setattr(
        metadata, "version", lambda name: "999" if name == "opencv-contrib-python-headless" else now(name)
    )
    assert detection_cache.version.__wrapped__() != version


def test_the_key_follows_pixels_shape_and_board() -> None:
    key = detection_cache.key(GREY, BOARD, "none")
    assert key == detection_cache.key(GREY.copy(), BOARD, "none")
    others = (GREY + np.uint8(1), BOARD), (GREY.reshape(6, 4), BOARD), (GREY, BOARD.replaced(square_mm=21.0))
    assert len({key, *(detection_cache.key(grey, board, "none") for grey, board in others)}) == 4


def loaded(folder: Path) -> DetectedFrame | None:
    return detection_cache.load(folder, "a", views=2, corners=5)


def test_what_was_kept_comes_back_whole_or_not_at_all(tmp_path: Path) -> None:
    seen = Observations(np.zeros(2, np.int64), np.array([0, 1]), np.array([3, 4]), np.array([[1.5, 2.0], [3.0, 4.25]]))
    assert loaded(tmp_path) is None
    corners = Corners(np.arange(3), GRID["grid_pixels"])
    grid = SeenGrid(GRID["grid_places"], corners, GRID["grid_limits"][0])
    detection_cache.save(tmp_path, "a", DetectedFrame(seen, np.array([[7.25, 8.0]]), ((1, grid),)))
    found = loaded(tmp_path)
    assert found is not None and found.corners.pixels.tobytes() == seen.pixels.tobytes()
    assert found.unassigned_px.tolist() == [[7.25, 8.0]]
    ((mirror, kept),) = found.grids
    assert mirror == 1
    np.testing.assert_array_equal(kept.places, grid.places)
    np.testing.assert_array_equal(kept.corners.pixels, corners.pixels)
    np.testing.assert_array_equal(kept.limits, grid.limits)
    content = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(content[: len(content) // 2])
    assert loaded(tmp_path) is None


def test_what_is_there_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_text("mine")
    assert loaded(tmp_path) is None
    detection_cache.save(tmp_path, "a", DetectedFrame(Observations.none()))
    assert (tmp_path / "a.npz").read_text() == "mine"
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="file: is a file, expected a folder for found corners"):
        detection_cache.check_folder(tmp_path / "file")


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
def test_what_somebody_else_put_there_is_found_anew(arrays: dict[str, Any], tmp_path: Path) -> None:
    right: dict[str, Any] = {"view": np.array([0, 1]), "corner": np.array([3, 4]), "pixels": np.ones((2, 2))}
    right |= {"sigma_px": np.ones(2), "unassigned": np.empty((0, 2))} | GRID
    np.savez_compressed(tmp_path / "a.npz", **right)
    assert loaded(tmp_path) is not None
    np.savez_compressed(tmp_path / "a.npz", **(right | arrays))
    assert loaded(tmp_path) is None


def test_a_file_that_does_not_say_which_boards_are_left_over_is_found_anew(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "a.npz", view=np.array([0, 1]), corner=np.array([3, 4]), pixels=np.ones((2, 2)), sigma_px=np.ones(2)
    )
    assert loaded(tmp_path) is None


def test_nothing_is_kept_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "detections").symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="detections: is a link"):
        detection_cache.save(tmp_path / "detections", "a", DetectedFrame(Observations.none()))
    assert list((tmp_path / "theirs").iterdir()) == []
