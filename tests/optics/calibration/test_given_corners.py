"""Calibration from arrays of corners: the same as from observations, by index or by name, and what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.page_code import blocks
from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.given_corners import GivenCorners, calibrate_from_corners
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.sound_calibration import (
    BOARD,
    NOISE_PX,
    board_poses,
    nominal_layout,
    sound_calibration,
    true_layout,
)
from tests.optics.calibration.synthetic_corners import views_of

PAGE = Path(__file__).parents[3] / "docs" / "calibration.md"
CORNERS = len(BOARD.corners_in_board_mm)


def given() -> tuple[list[dict[int | str, GivenCorners]], list[GivenCorners]]:
    """The corners of the sound calibration, with views by index in even pictures and by name in odd ones."""
    views = views_of(true_layout(), BOARD, *board_poses(), noise_px=NOISE_PX)
    frames: list[dict[int | str, GivenCorners]] = []
    for number, seen in enumerate(views.mirrored):
        parts = [(view, seen.where(seen.view == view)) for view in np.unique(seen.view).tolist()]
        if number % 2:
            named = ((nominal_layout().mirror_names[view], part) for view, part in parts)
            frames.append({name: (part.corner.tolist(), part.pixels.tolist()) for name, part in named})
        else:
            frames.append({view: (part.corner, part.pixels, part.sigma_px) for view, part in parts})
    return frames, [(seen.corner, seen.pixels) for seen in views.base]


def test_arrays_calibrate_like_observations() -> None:
    frames, base = given()
    names = [f"a{number}" for number in range(len(frames))], [f"b{number}" for number in range(len(base))]
    found = calibrate_from_corners(frames, base, nominal_layout(), BOARD, names=names)
    assert found.layout.identity == sound_calibration().layout.identity
    assert found.pictures == (*names[0], *names[1])


GOOD = list(range(8)), np.full((8, 2), 100.0)


@pytest.mark.parametrize(
    ("view", "corners", "message"),
    [
        ("0-9", GOOD, r"view '0-9', expected 0 to 3, or '0-0' to '1-1'"),
        (4, GOOD, r"view 4, expected 0 to 3"),
        (-1, GOOD, r"view -1, expected 0 to 3"),
        (True, GOOD, r"view True, expected 0 to 3"),
        ("0-1", ([CORNERS, *range(7)], GOOD[1]), rf"\['0-1'\]: corner {CORNERS}, expected .* from 0 to {CORNERS - 1}"),
        ("0-1", ([0.5, *range(7)], GOOD[1]), r"corner 0\.5, expected different whole numbers"),
        (0, ([0, 0, *range(1, 7)], GOOD[1]), r"\[0\]: a corner twice"),
        (0, (range(8), [[-3.0, 1.0]] * 8), r"pixel \(-3, 1\), expected one in the picture of 1920 x 1080"),
        (0, (range(7), GOOD[1]), r"7 numbers, 8 pixels"),
        (0, (range(8), np.ones((8, 3))), r"pixels: shape \(8, 3\), expected \(n, 2\)"),
        (0, (range(8), [[1.0, 2.0], [3.0]]), r"pixels: rows of different lengths, expected \(n, 2\)"),
        (0, (range(8), np.full((8, 2), np.nan)), r"pixels: holds a value that is NaN or infinite"),
        (0, (*GOOD, [0.0] * 8), r"sigma 0, expected positive"),
        (0, GOOD[1], r"expected a pair of numbers"),
    ],
)
def test_corners_that_cannot_be_are_refused_by_their_place(view: Any, corners: Any, message: str) -> None:
    with pytest.raises(InputError, match=rf"^frames\[1\].*{message}"):
        calibrate_from_corners([{}, {view: corners}], [], nominal_layout(), BOARD)


def test_a_view_is_given_once() -> None:
    with pytest.raises(InputError, match=r"^frames\[0\]: view '0-1' again, expected either '0-1' or 1"):
        calibrate_from_corners([{1: GOOD, "0-1": GOOD}], [], nominal_layout(), BOARD)


def test_views_of_few_corners_are_noted() -> None:
    frames, base = given()
    few = ([0, 1], [[5.0, 5.0], [9.0, 5.0]])
    found = calibrate_from_corners([{"0-0": few}, *frames], base, nominal_layout(), BOARD)
    assert found.notes[0] == "frames[0]['0-0']: 2 corners, not used; expected 6 or more"
    assert found.layout.identity == sound_calibration().layout.identity


def test_names_and_pictures_are_as_many() -> None:
    with pytest.raises(InputError, match=r"^names: 1 for 2 pictures"):
        calibrate_from_corners([{}, {}], [], nominal_layout(), BOARD, names=(["a"], []))
    with pytest.raises(InputError, match=r"^frames: no pictures given"):
        calibrate_from_corners([], [], nominal_layout(), BOARD)


def test_the_program_of_the_page_calibrates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = next(
        block.text for block in blocks(PAGE.read_text(encoding="utf-8"), "python") if "corners" in block.text
    )
    frames, _ = given()
    nominal_layout().save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", BOARD)
    for number, views in enumerate(frames):
        arrays = dict[str, Any]()
        for view, (numbers, pixels, *_) in views.items():
            name = view if isinstance(view, str) else nominal_layout().mirror_names[view]
            arrays |= {f"{name}/numbers": np.asarray(numbers), f"{name}/pixels": np.asarray(pixels)}
        np.savez(tmp_path / f"corners_{number}.npz", **arrays)
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    found = calibrate_from_corners(frames, [], nominal_layout(), BOARD)
    assert Layout.load("calibrated.json").identity == found.layout.identity
