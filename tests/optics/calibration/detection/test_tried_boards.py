"""Boards of other programs and prints, against the truth of pictures that once failed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.calibration.detection.charuco import find_marked_boards
from mirrorcam.optics.geometry.boards import Charuco, load_board

TRIED = Path(__file__).parents[5] / "shared" / "data" / "tried"


@pytest.mark.parametrize(
    ("folder", "changes"),
    [
        ("charuco_inverted", {"inverted": True}),
        ("charuco_old_pattern", {"legacy": True}),
        ("charuco_first_marker_24", {"first_marker": 24}),
        ("dictionary_6x6_250", {}),
        ("dictionary_apriltag_36h11", {}),
    ],
)
@pytest.mark.parametrize("mirrored", [False, True])
def test_corners_are_where_they_are(folder: str, changes: dict[str, Any], *, mirrored: bool) -> None:
    if not (TRIED / folder).is_dir():
        pytest.skip(f"the pictures of {TRIED / folder} are not here")
    board = load_board(TRIED / folder / "board.toml")
    assert isinstance(board, Charuco)
    truth = json.loads((TRIED / folder / "truth.json").read_text())["corners_px_in_order_of_id"]["p00.jpg"]
    picture = read_image(TRIED / folder / "p00.jpg", grey=True)
    (corners,) = find_marked_boards(picture, board.replaced(**changes), mirrored=mirrored, max_boards=2)
    expected = np.array(truth["mirror" if mirrored else "direct"], dtype=np.float64)
    assert len(corners) == len(expected)
    assert np.abs(corners.pixels - expected[corners.ids]).max() < 0.25
