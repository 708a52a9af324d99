"""Folders of one picture per view: the disparity that other readers find, and names of any kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.light_field.io.formats.registry import format_of, open_light_fields
from mirrorcam.optics.light_field.io.formats.stanford import read_stanford, write_stanford
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.io.view_order import POSITIONED
from tests.optics.light_field.io.formats.planes import CANDIDATES, plane, shift_that_agrees
from tests.optics.light_field.io.orders import GIVEN, scene


def numbers(file: Path) -> tuple[str, ...]:
    """Return row, column, y and x from a name."""
    match = POSITIONED.fullmatch(file.stem)
    assert match is not None
    return match.groups()


def test_stanfords_names_state_view_positions(tmp_path: Path) -> None:
    """Pictures read at u + k x, v + k y agree for the metric slope k, on any uneven grid: Y comes before X."""
    light_field = plane(3, 4, 1.3, uneven=True)
    write_stanford(tmp_path, light_field)
    files = sorted(tmp_path.glob("*.png"))
    places = np.array([numbers(file) for file in files]).astype(float)
    assert places[:, :2].tolist() == [[t, s] for t in range(3) for s in range(4)]
    # As LFReadGantryArray does: sorted by name, row by row.
    pictures = np.stack([read_image(file) for file in files]).reshape(3, 4, 90, 120, 3)
    y, x = places[:, 2].reshape(3, 4), places[:, 3].reshape(3, 4)
    slope = shift_that_agrees(pictures, lambda k, t, s: (k * x[t, s], k * y[t, s]), CANDIDATES / 10)
    assert slope == pytest.approx(-1.3 / 10, abs=0.002)


def test_stanfords_own_unit_is_scaled_to_a_step(tmp_path: Path) -> None:
    light_field = plane(2, 3, 1.0, uneven=True)
    write_stanford(tmp_path, light_field)
    (tmp_path / "views.json").unlink()
    for file in sorted(tmp_path.glob("*.png")):
        row, col, y, x = numbers(file)
        # The archive's unit, and names without the last underscore.
        file.rename(tmp_path / f"out_{row}_{col}_{5 * float(y) - 70:.6f}_{5 * float(x) + 900:.6f}.png")
    given = Assumed(focal_px=400.0, reference_depth_mm=455.0)
    (found,) = read_stanford(tmp_path, given.replaced(step_mm=light_field.step_mm())).frames
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-5)
    assert read_stanford(tmp_path, given).frames[0].step_mm() == pytest.approx(5 * light_field.step_mm(), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "first", "places"),
    [
        ("Original Camera_{t:02d}_{s:02d}_{y:.6f}_{x:.6f}_.png", 0, True),
        ("out_{t:02d}_{s:02d}_{y:.0f}_{x:.0f}.png", 0, True),
        ("2067_{t:02d}_{s:02d}.png", 1, False),
        ("IMG_2067_5_{t:02d}_{s:02d}.PNG", 0, False),
        ("{t}_{s}.jpeg", 1, False),
        ("view_{t:03d}_{s:03d}.JPG", 0, False),
    ],
)
def test_folders_of_pictures_may_have_any_names(tmp_path: Path, name: str, first: int, places: bool) -> None:
    light_field = plane(2, 3, 1.0)
    for t, s in np.ndindex(2, 3):
        x, y = light_field.positions_mm[t, s, :2]
        write_image(
            tmp_path / name.format(t=t + first, s=s + first, x=x, y=y), light_field.samples[t, s].astype(np.uint8)
        )
    (tmp_path / "cover.png").write_bytes(b"no view")
    given = Assumed(focal_px=400.0, reference_depth_mm=455.0, step_mm=None if places else 10.0)
    assert format_of(tmp_path).name == "stanford"
    contents = read_stanford(tmp_path, given)
    (found,) = contents.frames
    assert contents.notes == ("1 picture left out, not named as one of the 3x2 views, such as cover.png",)
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-6)
    assert np.abs(found.samples.astype(float) - light_field.samples).mean() < (8.0 if "JP" in name.upper() else 1e-9)
    if not places:
        with pytest.raises(InputError, match="does not state its step_mm"):
            read_stanford(tmp_path, given.replaced(step_mm=None))


def test_folders_of_pictures_that_form_no_grid_are_refused(tmp_path: Path) -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    for name in ("a_0_0.png", "a_0_1.png", "a_1_0.png"):
        write_image(tmp_path / "gap" / name, picture)
        write_image(tmp_path / "late" / name.replace("_1", "_7").replace("_0", "_6"), picture)
    for name in ("a_0_0.png", "b_0_0.jpg"):
        write_image(tmp_path / "twice" / name, picture)
    (tmp_path / "other").mkdir()
    for folder, message in (
        ("gap", r"lacks view \(1, 1\), expected NAME_ROW_COLUMN pictures of all 2x2"),
        ("late", r"lacks view \(7, 7\), expected NAME_ROW_COLUMN pictures of all 2x2"),
        ("twice", "a_0_0.png and b_0_0.jpg show the same view"),
        ("other", "has no pictures NAME_ROW_COLUMN_Y_X"),
    ):
        with pytest.raises(InputError, match=message):
            read_stanford(tmp_path / folder)


def test_plain_folders_are_read_with_rows_and_columns(tmp_path: Path) -> None:
    light_field = plane(2, 6, 1.0)
    for number, (t, s) in enumerate(np.ndindex(2, 6)):
        write_image(tmp_path / f"view{number}.png", light_field.samples[t, s].astype(np.uint8))
    given = Assumed(focal_px=400.0, reference_depth_mm=455.0, step_mm=10.0)
    with pytest.raises(InputError, match=r"give rows or cols in views\.toml, or --rows or --cols"):
        open_light_fields(tmp_path, assumed=given)
    (found,) = open_light_fields(tmp_path, assumed=given.replaced(rows=2)).frames
    assert np.array_equal(found.samples, light_field.samples)
    (tmp_path / "views.toml").write_text("rows = 2\ncols = 6\n", encoding="utf-8")
    (found,) = open_light_fields(tmp_path, assumed=given).frames
    assert np.array_equal(found.samples, light_field.samples)


def test_names_may_state_the_lens(tmp_path: Path) -> None:
    light_field = plane(2, 2, 1.0)
    for t, s in np.ndindex(2, 2):
        x, y = light_field.positions_mm[t, s, :2]
        name = f"Camera_{7 - t:02d}_{9 - s:02d}_{y:.6f}_{x:.6f}_30_36.png"
        write_image(tmp_path / name, light_field.samples[t, s].astype(np.uint8))
    (found,) = open_light_fields(tmp_path, assumed=Assumed(reference_depth_mm=455.0)).frames
    assert np.array_equal(found.samples, light_field.samples)
    assert found.focal_px == light_field.width_px * 30 / 36


def test_views_at_one_position_have_no_step(tmp_path: Path) -> None:
    write_stanford(tmp_path, plane(1, 2, 1.0))
    (tmp_path / "views.json").unlink()
    for number, file in enumerate(sorted(tmp_path.glob("*.png"))):
        file.rename(tmp_path / f"out_00_0{number}_1.0_2.0_.png")
    with pytest.raises(InputError, match="give all views the same position"):
        read_stanford(tmp_path, Assumed(step_mm=1.0, focal_px=400.0, reference_depth_mm=455.0))


def test_row_and_column_in_names_may_be_exchanged_and_numbered_in_a_snake(tmp_path: Path) -> None:
    """As in a Lytro set, IMG_0001_SEQUENCE_COLUMN_ROW: three of the numbers look like a row with positions."""
    light_field = scene(3, 4)
    for t, s in np.ndindex(3, 4):
        number = 3 * s + (t if s % 2 == 0 else 2 - t) + 1
        write_image(
            tmp_path / f"IMG_0001_{number:03d}_{s + 1:02d}_{t + 1:02d}.png", light_field.samples[t, s].astype(np.uint8)
        )
    contents = open_light_fields(tmp_path, assumed=GIVEN)
    assert contents.notes == ("the pictures show that views are column by column in 4 columns of 3: reordered",)
    assert np.array_equal(contents.frames[0].samples, light_field.samples)
    assert contents.frames[0].step_mm() == GIVEN.step_mm


def test_positions_that_contradict_the_pictures_are_refused(tmp_path: Path) -> None:
    light_field = scene(2, 3)
    for t, s in np.ndindex(2, 3):
        x, y = light_field.positions_mm[t, s, :2]
        write_image(tmp_path / f"out_{t:02d}_{s:02d}_{-y:.6f}_{x:.6f}_.png", light_field.samples[t, s].astype(np.uint8))
    with pytest.raises(InputError, match=r"^.*: the pictures show that rows run upwards, or columns leftwards"):
        open_light_fields(tmp_path, assumed=GIVEN)
