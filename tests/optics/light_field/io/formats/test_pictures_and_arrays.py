"""Stanford's folders, ESLF, tiles, plenpy and PlenoptiCam: the disparity that their own readers would find."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.optics.base.files import read_image, write_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.formats.plenopticam import read_plenopticam, write_plenopticam
from mirrorcam.optics.light_field.io.formats.registry import format_of, write_light_field
from mirrorcam.optics.light_field.io.formats.stanford import PLACED, read_stanford, write_stanford
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.io.mosaic import read_mosaic, write_mosaic
from mirrorcam.optics.light_field.io.view_images import write_rgba
from tests.optics.light_field.io.formats.planes import plane, shift_that_agrees


def numbers(file: Path) -> tuple[str, ...]:
    """Row, column, y and x of a name."""
    match = PLACED.fullmatch(file.stem)
    assert match is not None
    return match.groups()


CANDIDATES = np.linspace(-3, 3, 61)


def test_stanfords_names_tell_where_views_are(tmp_path: Path) -> None:
    """Pictures read at u + k x, v + k y agree for the metric slope k, however uneven the grid: Y comes before X."""
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
    found = read_stanford(tmp_path, replace(given, step_mm=light_field.step_mm()))
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-5)
    assert read_stanford(tmp_path, given).step_mm() == pytest.approx(5 * light_field.step_mm(), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "first", "places"),
    [
        ("Original Camera_{t:02d}_{s:02d}_{y:.6f}_{x:.6f}_.png", 0, True),
        ("out_{t:02d}_{s:02d}_{y:.0f}_{x:.0f}.png", 0, True),
        ("2067_{t:02d}_{s:02d}.png", 1, False),
        ("IMG_2067_5_{t:02d}_{s:02d}.PNG", 0, False),
        ("{t}_{s}.webp", 1, False),
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
    found = read_stanford(tmp_path, given)
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-6)
    assert np.abs(found.samples.astype(float) - light_field.samples).mean() < (8.0 if "JPG" in name else 1e-9)
    if not places:
        with pytest.raises(InputError, match="does not state its step_mm"):
            read_stanford(tmp_path, replace(given, step_mm=None))


def test_folders_of_pictures_that_are_no_grid_are_refused(tmp_path: Path) -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    for name in ("a_0_0.png", "a_0_1.png", "a_1_0.png"):
        write_image(tmp_path / "gap" / name, picture)
        write_image(tmp_path / "late" / name.replace("_1", "_7").replace("_0", "_6"), picture)
    for name in ("a_0_0.png", "b_0_0.jpg"):
        write_image(tmp_path / "twice" / name, picture)
    (tmp_path / "other").mkdir()
    for folder, message in (
        ("gap", r"lacks view \(1, 1\), expected NAME_ROW_COLUMN pictures of all 2x2"),
        ("late", r"its first view is \(6, 6\), expected rows and columns from 0 or from 1"),
        ("twice", "a_0_0.png and b_0_0.jpg are of one view"),
        ("other", "has no pictures NAME_ROW_COLUMN_Y_X"),
    ):
        with pytest.raises(InputError, match=message):
            read_stanford(tmp_path / folder)


def test_views_in_one_place_have_no_step(tmp_path: Path) -> None:
    write_stanford(tmp_path, plane(1, 2, 1.0))
    (tmp_path / "views.json").unlink()
    for number, file in enumerate(sorted(tmp_path.glob("*.png"))):
        file.rename(tmp_path / f"out_00_0{number}_1.0_2.0_.png")
    with pytest.raises(InputError, match="give all views one place"):
        read_stanford(tmp_path, Assumed(step_mm=1.0, focal_px=400.0, reference_depth_mm=455.0))


def test_eslf_has_a_picture_of_the_aperture_for_every_pixel(tmp_path: Path) -> None:
    light_field = plane(2, 3, -1.7)
    write_mosaic(tmp_path / "a.png", light_field, "eslf")
    picture = read_image(tmp_path / "a.png")
    assert picture.shape == (2 * 90, 3 * 120, 3)
    views = np.array([[picture[t::2, s::3] for s in range(3)] for t in range(2)])
    assert shift_that_agrees(views, lambda k, t, s: (-k * s, -k * t), CANDIDATES) == pytest.approx(-1.7, abs=0.02)


def test_tiles_are_the_views_beside_each_other(tmp_path: Path) -> None:
    light_field = plane(2, 3, 0.8)
    write_mosaic(tmp_path / "a.png", light_field, "tiles")
    picture = read_image(tmp_path / "a.png")
    views = np.array([[picture[90 * t :, 120 * s :][:90, :120] for s in range(3)] for t in range(2)])
    assert shift_that_agrees(views, lambda k, t, s: (-k * s, -k * t), CANDIDATES) == pytest.approx(0.8, abs=0.02)


def test_colours_of_pixels_without_weight_are_dropped(tmp_path: Path) -> None:
    """Painting programs leave any colour where a picture is transparent."""
    light_field = plane(2, 3, 0.8)
    write_mosaic(tmp_path / "a.png", light_field, "tiles")
    opacity = np.full((180, 360), 255, np.uint8)
    opacity[:90, :120] = 0
    write_rgba(tmp_path / "a.png", read_image(tmp_path / "a.png"), opacity)
    found = read_mosaic(tmp_path / "a.png", "tiles")
    assert not found.samples[0, 0].any()
    assert not found.weights[0, 0].any()
    assert np.array_equal(found.samples[1], light_field.samples[1])


def test_mosaics_must_divide_into_views(tmp_path: Path) -> None:
    write_mosaic(tmp_path / "a.png", plane(2, 3, 0.0), "tiles")
    (tmp_path / "a.json").unlink()
    with pytest.raises(InputError, match="do not divide into 7x2 views"):
        read_mosaic(
            tmp_path / "a.png", "tiles", Assumed(rows=2, cols=7, step_mm=1.0, focal_px=1.0, reference_depth_mm=9.0)
        )


def test_plenpys_disparity_is_that_of_its_planes(tmp_path: Path) -> None:
    """Its fit of planes reads view n at + linspace(-0.5, 0.5, N) N slope, and calls -slope the disparity."""
    light_field = plane(3, 4, 1.5)
    write_light_field(tmp_path, light_field, "plenpy")
    array = np.load(tmp_path / "light_field.npy")
    assert array.shape == (3, 4, 90, 120, 3)
    assert 0.0 <= array.min() < array.max() <= 1.0
    v_steps = np.linspace(-0.5, 0.5, 4) * 4
    row = shift_that_agrees(array[1:2] * 255, lambda k, u, v: (-k * v_steps[v], 0.0), CANDIDATES)
    assert row == pytest.approx(1.5 * (4 - 1) / 4, abs=0.02)
    u_steps = np.linspace(-0.5, 0.5, 3) * 3
    column = shift_that_agrees(array[:, 1:2] * 255, lambda k, u, v: (0.0, -k * u_steps[u]), CANDIDATES)
    assert column == pytest.approx(1.5 * (3 - 1) / 3, abs=0.02)


def test_plenopticams_parameter_is_our_disparity(tmp_path: Path) -> None:
    """It pads picture i by a i on the left: what is at u comes to u + a i."""
    light_field = plane(3, 3, 2.0)
    write_plenopticam(tmp_path, light_field)
    array = np.load(tmp_path / "vp_img_arr.npy")
    assert 255 < array.max() <= 65535
    sharp = {}
    for a in (-2, -1, 0, 1, 2):
        slices = []
        for j, i in np.ndindex(3, 3):
            down, across = (
                ((abs(a) * n, abs(a) * (2 - n)) if a >= 0 else (abs(a) * (2 - n), abs(a) * n)) for n in (j, i)
            )
            slices.append(np.pad(array[j, i], (down, across, (0, 0)), "edge")[20:-20, 20:-20])
        sharp[a] = np.mean(slices, axis=0).std()
    assert max(sharp, key=lambda a: sharp[a]) == 2


def test_plenopticams_viewpoints_are_enough(tmp_path: Path) -> None:
    light_field = plane(3, 3, 1.0)
    write_plenopticam(tmp_path, light_field)
    assert sorted(file.name for file in (tmp_path / "viewpoints_3px").iterdir())[3] == "01_00.png"
    for name in ("vp_img_arr.npy", "weights.npy", "views.json"):
        (tmp_path / name).unlink()
    found = read_plenopticam(tmp_path, Assumed(step_mm=10.0, focal_px=400.0, reference_depth_mm=455.0))
    assert np.array_equal(found.samples, light_field.samples)
    (tmp_path / "viewpoints_3px" / "01_00.png").unlink()
    with pytest.raises(InputError, match=r"8 views ROW_COLUMN\.png, expected 9"):
        read_plenopticam(tmp_path, Assumed(step_mm=10.0, focal_px=400.0, reference_depth_mm=455.0))


def test_plenopticam_knows_square_grids_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="as many down as across"):
        write_plenopticam(tmp_path, plane(2, 3, 1.0))
