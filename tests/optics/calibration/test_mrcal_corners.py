"""mrcal's tables of corners: unseen corners are left out, the others keep their numbers, and all else is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.corner_files import CornerTable, load_corners
from mirrorcam.optics.calibration.solver.observations import DIRECT
from tests.optics.calibration.sound_calibration import BOARD, nominal_layout

CORNERS = len(BOARD.corners_in_board_mm)
LEGEND = "# filename x y level"


def lines(picture: str, unseen: tuple[int, ...] = (), ending: str = " 0") -> list[str]:
    """A picture of all corners, but those that are not seen."""
    seen = [f"{picture} {100 + corner} {200.5 + corner}{ending}" for corner in range(CORNERS)]
    return [f"{picture} -{' -' * (1 + bool(ending))}" if place in unseen else line for place, line in enumerate(seen)]


def read(folder: Path, *content: str, name: str = "corners.vnl") -> CornerTable:
    path = folder / name
    path.write_text("\n".join(content) + "\n")
    return load_corners(path, nominal_layout(), CORNERS)


@pytest.mark.parametrize("name", ["corners.vnl", "corners.txt"])
def test_unseen_corners_are_left_out_and_the_others_keep_their_numbers(tmp_path: Path, name: str) -> None:
    unseen = (0, 3, CORNERS - 1)
    found = read(tmp_path, "## made by", LEGEND, *lines("a.png", unseen), "b.png - - -", *lines("c.png"), name=name)
    assert not found.seen and list(found.base) == ["a.png", "c.png"]
    rows = found.base["a.png"]
    assert rows.corner.tolist() == [corner for corner in range(CORNERS) if corner not in unseen]
    np.testing.assert_array_equal(rows.pixels[:, 0], 100 + rows.corner)
    assert set(rows.view.tolist()) == {DIRECT}


def test_levels_and_weights_are_standard_deviations(tmp_path: Path) -> None:
    levels = read(tmp_path, LEGEND, *lines("a.png", ending=" 2"), *lines("b.png")).base
    ratio = levels["a.png"].sigma_px / levels["b.png"].sigma_px
    np.testing.assert_allclose(ratio, 4.0)
    weights = read(tmp_path, "# filename x y weight", *lines("a.png", ending=" 0.5"), *lines("b.png", ending=" 1")).base
    np.testing.assert_allclose(weights["a.png"].sigma_px / weights["b.png"].sigma_px, 2.0)
    plain = read(tmp_path, "# filename x y", *lines("a.png", (1,), ending="")).base
    assert len(plain["a.png"]) == CORNERS - 1


@pytest.mark.parametrize("ending", [" -", " -1"])
def test_corners_of_no_level_are_left_out(tmp_path: Path, ending: str) -> None:
    found = read(tmp_path, LEGEND, *lines("a.png", ending=ending), *lines("b.png"))
    assert list(found.base) == ["b.png"]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (lines("a.png")[:-1], f"'a.png' has {CORNERS - 1} lines, expected {CORNERS}"),
        ([*lines("a.png")[:-1], *lines("b.png")], "'a.png' has"),
        ([*lines("a.png"), *lines("b.png"), *lines("a.png")], "'a.png' again"),
        (["a.png 1"], "line 2: 2 values"),
        (["a.png 1 2 3 4"], "line 2: 5 values"),
        (lines("a.png", ending=" high"), "line 2: 'high', expected a level"),
        (lines("a.png", ending=" 1e9"), "line 2: '1e9', expected a level"),
        (lines("view_0_1/a.png"), "is of a mirror, expected a table like corners.csv"),
    ],
)
def test_what_mrcal_would_not_take_for_this_board_is_named(tmp_path: Path, content: list[str], complaint: str) -> None:
    with pytest.raises(InputError, match=r"an mrcal \.vnl: ") as caught:
        read(tmp_path, LEGEND, *content)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_columns_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"an mrcal \.vnl: columns 'filename x y level cid'"):
        read(tmp_path, f"{LEGEND} cid", *lines("a.png"))


def test_a_number_that_is_none_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2: x_px 'left'"):
        read(tmp_path, LEGEND, *["a.png left 2 0"] * CORNERS)
