"""Corners as tables: written tables give the same calibration, and each bad line is refused by its number."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.corner_files import HEADER, CornerTable, load_corners, save_corners
from mirrorcam.optics.calibration.diagnostics.calibration_difference import calibration_difference
from mirrorcam.optics.calibration.solver.observations import DIRECT
from tests.optics.calibration.sound_calibration import BOARD, nominal_layout, sound_calibration

HEADS = "picture,view,corner,x_px,y_px"
CORNERS = len(BOARD.corners_in_board_mm)
LEGEND = "# filename x y level"


def read(path: Path) -> CornerTable:
    return load_corners(path, nominal_layout(), CORNERS)


def table(path: Path, *lines: str, heads: str = HEADS) -> Path:
    path.write_text("\n".join((heads, *lines)) + "\n")
    return path


def view(picture: str, name: str, count: int, ending: str = "") -> list[str]:
    """Lines of some corners of a view."""
    return [f"{picture},{name},{corner},{100 + corner},{200.5 + corner}{ending}" for corner in range(count)]


def test_written_corners_give_the_same_calibration(tmp_path: Path) -> None:
    first = sound_calibration()
    save_corners(tmp_path / "corners.csv", first)
    found = read(tmp_path / "corners.csv")
    assert (len(found.mirrored), len(found.base), found.notes) == (12, 5, ())
    assert (*found.mirrored, *found.base) == first.pictures
    again = calibrate_corners(
        [*found.mirrored.values()], [*found.base.values()], nominal_layout(), BOARD.corners_in_board_mm
    )
    assert again.layout.provenance == first.layout.provenance
    difference = calibration_difference(first.layout, again.layout, range_mm=400.0)
    figures = difference.metrics(difference.views)
    assert figures["max_px"].value < 0.002
    assert figures["ratio"].value < 0.05  # the noise of each view is found again, from standardised residuals
    np.testing.assert_allclose(difference.b_from_a, np.eye(4), atol=0.01)


def test_the_file_states_its_conventions_and_omissions(tmp_path: Path) -> None:
    calibration = sound_calibration()
    inliers = calibration.inliers.copy()
    inliers[3] = False
    save_corners(tmp_path / "corners.csv", replace(calibration, inliers=inliers))
    text = (tmp_path / "corners.csv").read_text()
    assert text.startswith(HEADER)
    lines = text.splitlines()[HEADER.count("\n") :]
    assert lines[0] == f"{HEADS},sigma_px,used"
    assert [line[-2:] for line in lines[1:7]] == [",1", ",1", ",1", ",0", ",1", ",1"]
    rows, again = calibration.observations, read(tmp_path / "corners.csv").mirrored
    assert rows.corner[:5].tolist() == [0, 1, 2, 3, 4]
    assert again["frame 0"].corner[:4].tolist() == [0, 1, 2, 4]
    assert sum(map(len, again.values())) == (rows.view >= 0).sum() - 1


def test_names_of_pictures_may_be_anything(tmp_path: Path) -> None:
    calibration = sound_calibration()
    names = [f"{number}" for number in range(len(calibration.pictures))]
    names[:4] = ["# one, two", 'a "b"', "two\nlines", "not text \udcff"]
    save_corners(tmp_path / "corners.csv", replace(calibration, pictures=tuple(names)))
    assert [*read(tmp_path / "corners.csv").mirrored][:4] == ["# one, two", 'a "b"', "two lines", "not text ?"]


def test_a_foreign_table_needs_neither_sigmas_nor_order(tmp_path: Path) -> None:
    lines = [*view("a.png", "0-1", 7), *view("b.png", "direct", 8), *view("a.png", "1-0", 6)]
    path = tmp_path / "others.csv"
    path.write_bytes(("# mine\r\n\r\n" + "\r\n".join([HEADS, *lines])).encode("utf-8-sig"))
    found = read(path)
    assert [*found.mirrored] == ["a.png"]
    assert found.mirrored["a.png"].view.tolist() == [1] * 7 + [2] * 6
    np.testing.assert_array_equal(found.mirrored["a.png"].pixels[1], [101.0, 201.5])
    assert found.base["b.png"].view.tolist() == [-1] * 8
    assert set(found.base["b.png"].sigma_px) == {1.0}


def test_columns_may_stand_in_any_order_and_few_corners_are_left_out(tmp_path: Path) -> None:
    heads = "sigma_px,corner,view,picture,y_px,x_px"
    lines = [f"0.0{corner + 1},{corner},0-0,a,20,{corner}" for corner in range(6)]
    lines += [f"0.02,{corner},0-1,a,20,{corner}" for corner in range(5)]
    found = read(table(tmp_path / "t.csv", *lines, heads=heads))
    np.testing.assert_allclose(found.mirrored["a"].sigma_px, [0.01, 0.02, 0.03, 0.04, 0.05, 0.06])
    assert found.notes == ("t.csv: 5 corners in views of fewer than 6, not used",)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("a,2-0,0,1,2", "line 3: view '2-0', expected direct or a mirror from 0-0 to 1-1"),
        ("a,0-0,54,1,2", "line 3: corner '54', expected a whole number from 0 to 53, as the board has"),
        ("a,0-0,-1,1,2", "line 3: corner '-1', expected a whole number"),
        ("a,0-0,1.5,1,2", "line 3: corner '1.5', expected a whole number"),
        ("a,0-0,1,nan,2", "line 3: x_px 'nan', expected a number from -0.5 to 1919.5"),
        ("a,0-0,1,1,1080", "line 3: y_px '1080', expected a number from -0.5 to 1079.5"),
        ("a,0-0,1,1,", "line 3: y_px '', expected a number"),
        ("a,0-0,1,1", "line 3: 4 cells, expected 5: picture, view, corner, x_px, y_px"),
        (",0-0,1,1,2", "line 3: picture '', expected a name"),
        ("a,0-0,0,1,2", "line 3: corner '0', expected each corner of a view once in a picture"),
        ("a,direct,1,1,2", "line 3: view 'direct', expected pictures that show the board in mirrors or directly"),
        ('a,0-0,"1,1,2', "line 3: unexpected end of data, expected cells between commas"),
    ],
)
def test_a_bad_line_is_refused_by_its_number(line: str, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape(f"t.csv, {expected}")):
        read(table(tmp_path / "t.csv", "a,0-0,0,1,2", line))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("a,0-0,1,1,2,0,1", "sigma_px '0', expected a number from 1e-06 to 1000"),
        ("a,0-0,1,1,2,,1", "sigma_px '', expected a number in every line, or in none"),
        ("a,0-0,1,1,2,0.1,yes", "used 'yes', expected 0 or 1"),
    ],
)
def test_a_bad_sigma_or_use_is_refused(line: str, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape(expected)):
        read(table(tmp_path / "t.csv", "a,0-0,0,1,2,0.1,1", line, heads=f"{HEADS},sigma_px,used"))


@pytest.mark.parametrize("heads", ["picture,view,corner,x,y", f"{HEADS},weight", f"{HEADS},x_px", "a,0-0,0,1,2"])
def test_other_heads_are_refused(heads: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"t\.csv, line 1: expected the columns picture, view, corner, x_px, y_px and"):
        read(table(tmp_path / "t.csv", heads=heads))


def test_files_that_are_not_tables_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no corners, expected lines with the columns"):
        read(table(tmp_path / "t.csv"))
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not text in UTF-8"):
        read(tmp_path / "t.csv")
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "none.csv")


def lines(picture: str, unseen: tuple[int, ...] = (), ending: str = " 0") -> list[str]:
    """Return the lines of a picture with all corners, some of them unseen."""
    seen = [f"{picture} {100 + corner} {200.5 + corner}{ending}" for corner in range(CORNERS)]
    return [f"{picture} -{' -' * (1 + bool(ending))}" if place in unseen else line for place, line in enumerate(seen)]


def read_vnl(folder: Path, *content: str, name: str = "corners.vnl") -> CornerTable:
    path = folder / name
    path.write_text("\n".join(content) + "\n")
    return load_corners(path, nominal_layout(), CORNERS)


@pytest.mark.parametrize("name", ["corners.vnl", "corners.txt"])
def test_unseen_corners_are_left_out_and_the_others_keep_their_numbers(tmp_path: Path, name: str) -> None:
    unseen = (0, 3, CORNERS - 1)
    found = read_vnl(tmp_path, "## made by", LEGEND, *lines("a.png", unseen), "b.png - - -", *lines("c.png"), name=name)
    assert not found.mirrored and list(found.base) == ["a.png", "c.png"]
    rows = found.base["a.png"]
    assert rows.corner.tolist() == [corner for corner in range(CORNERS) if corner not in unseen]
    np.testing.assert_array_equal(rows.pixels[:, 0], 100 + rows.corner)
    assert set(rows.view.tolist()) == {DIRECT}


def test_levels_and_weights_are_standard_deviations(tmp_path: Path) -> None:
    levels = read_vnl(tmp_path, LEGEND, *lines("a.png", ending=" 2"), *lines("b.png")).base
    ratio = levels["a.png"].sigma_px / levels["b.png"].sigma_px
    np.testing.assert_allclose(ratio, 4.0)
    weights = read_vnl(
        tmp_path, "# filename x y weight", *lines("a.png", ending=" 0.5"), *lines("b.png", ending=" 1")
    ).base
    np.testing.assert_allclose(weights["a.png"].sigma_px / weights["b.png"].sigma_px, 2.0)
    plain = read_vnl(tmp_path, "# filename x y", *lines("a.png", (1,), ending="")).base
    assert len(plain["a.png"]) == CORNERS - 1


@pytest.mark.parametrize("ending", [" -", " -1"])
def test_corners_of_no_level_are_left_out(tmp_path: Path, ending: str) -> None:
    found = read_vnl(tmp_path, LEGEND, *lines("a.png", ending=ending), *lines("b.png"))
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
        (lines("view_0_1/a.png"), "is a mirror's view, expected a table like corners.csv"),
    ],
)
def test_content_that_mrcal_would_not_accept_is_named(tmp_path: Path, content: list[str], complaint: str) -> None:
    with pytest.raises(InputError, match=r"an mrcal \.vnl: ") as caught:
        read_vnl(tmp_path, LEGEND, *content)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_columns_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"an mrcal \.vnl: columns 'filename x y level cid'"):
        read_vnl(tmp_path, f"{LEGEND} cid", *lines("a.png"))


def test_an_invalid_number_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2: x_px 'left'"):
        read_vnl(tmp_path, LEGEND, *["a.png left 2 0"] * CORNERS)
