"""All formats: round trips, and refusals of invalid files."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.disk import array_files
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.light_field.io.formats.registry import (
    NAMES,
    format_of,
    formats,
    name_of,
    open_light_field,
    write_light_field,
)
from mirrorcam.optics.light_field.io.light_field_format import Assumed, views_toml
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views
from tests.optics.light_field.io.bags import HAS_ROSBAGS
from tests.optics.light_field.io.formats.planes import plane, with_gaps

# Bags need the extra robot.
READABLE = [name for name in NAMES if name != "ply" and (HAS_ROSBAGS or name != "mcap")]
EXACT = [name for name in ("npz", "zarr", "lftoolbox", "plenpy", "plenopticam", "mcap") if name in READABLE]


def noise(rows: int, cols: int, *, channels: int = 3, kind: Any = np.uint8) -> LightField:
    """Random samples and weights of uneven views, with pixels that have no sample."""
    views = grid_views(rows, cols, width_px=23, height_px=17, centre_px=np.array([-2.5, 8.0]))
    random = np.random.default_rng(rows + 10 * cols)
    shape = (rows, cols, 17, 23)
    opacity = random.choice([0, 1, 128, 255], shape, p=[0.2, 0.1, 0.1, 0.6])
    samples: Any = random.integers(0, 256, (*shape, channels)).astype(np.uint8)
    if kind == np.float32:
        samples = random.random((*shape, channels), dtype=np.float32)
    samples[opacity == 0] = 0
    return LightField.of(views, samples, opacity.astype(np.float32) / np.float32(255))


def assert_same(found: LightField, expected: LightField) -> None:
    for field in fields(LightField):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        assert np.asarray(one).dtype == np.asarray(other).dtype, field.name
        assert np.array_equal(one, other), field.name


@pytest.mark.parametrize("to", READABLE)
@pytest.mark.parametrize(("size", "channels"), [((3, 3), 3), ((2, 2), 1)])
def test_light_fields_survive_the_round_trip(tmp_path: Path, to: Any, size: tuple[int, int], channels: int) -> None:
    expected = noise(*size, channels=channels)
    if to in ("hci", "colmap"):
        # Their masks only distinguish samples from none.
        expected = LightField.of(expected, expected.samples, (expected.weights > 0).astype(np.float32))
    path = tmp_path / f"a{formats()[to].ending}"
    write_light_field(path, expected, to)
    assert format_of(path).name == to
    assert name_of(path) == "a"
    assert_same(open_light_field(path), expected)


@pytest.mark.parametrize("to", [name for name in READABLE if name != "plenopticam"])
def test_grids_of_one_row_survive_the_round_trip(tmp_path: Path, to: Any) -> None:
    expected = with_gaps(plane(1, 3, 1.0))
    path = tmp_path / f"a{formats()[to].ending}"
    write_light_field(path, expected, to)
    assert_same(open_light_field(path), expected)


@pytest.mark.parametrize("to", READABLE)
def test_a_reference_plane_at_infinity_survives_the_round_trip(tmp_path: Path, to: Any) -> None:
    near = noise(2, 2)
    views = grid_views(2, 2, width_px=23, height_px=17, uneven=False, reference_depth_mm=np.inf)
    expected = LightField.of(views, near.samples, (near.weights > 0).astype(np.float32))
    path = tmp_path / f"a{formats()[to].ending}"
    write_light_field(path, expected, to)
    assert_same(open_light_field(path), expected)
    for own in path.glob("views.json"):
        # Cameras with one principal point, and files that leave it to the reader.
        own.unlink()
        given = Assumed(step_mm=20.0, focal_px=400.0, reference_depth_mm=np.inf)
        found = open_light_field(path, assumed=given)
        assert found.reference_depth_mm == np.inf
        assert np.allclose(found.step_mm(), 20.0)


@pytest.mark.parametrize("to", EXACT)
def test_float_samples_survive_the_round_trip(tmp_path: Path, to: Any) -> None:
    expected = noise(3, 3, kind=np.float32)
    path = tmp_path / f"a{formats()[to].ending}"
    write_light_field(path, expected, to)
    found = open_light_field(path)
    assert found.samples.dtype == np.float32
    # PlenoptiCam's range is 16 bits.
    assert np.abs(found.samples.astype(float) - expected.samples).max() < (1e-7 if to == "plenopticam" else 1e-30)
    assert np.array_equal(found.weights, expected.weights)


@pytest.mark.parametrize("to", [name for name in READABLE if name not in ("npz", "zarr")])
def test_the_same_light_field_gives_the_same_bytes(tmp_path: Path, to: Any) -> None:
    light_field = noise(2, 2)
    for name in ("a", "b"):
        write_light_field(tmp_path / name / f"x{formats()[to].ending}", light_field, to)
    files = sorted(file for file in (tmp_path / "a").rglob("*") if file.is_file())
    assert files
    for file in files:
        assert file.read_bytes() == (tmp_path / "b" / file.relative_to(tmp_path / "a")).read_bytes(), file.name


@pytest.mark.parametrize("to", [name for name in NAMES if "." not in formats()[name].ending])
def test_folders_that_are_not_empty_are_not_written(tmp_path: Path, to: Any) -> None:
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="expected a new or empty folder"):
        write_light_field(tmp_path, noise(2, 2), to)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


def test_files_that_are_not_light_fields_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"not MATLAB")
    (tmp_path / "a.png").write_bytes(b"not PNG")
    (tmp_path / "empty").mkdir()
    for path, message in (
        (tmp_path / "a.mat", "not a .mat file"),
        (tmp_path / "a.png", "not an image"),
        (tmp_path / "empty", "the folder does not have a known format"),
        (tmp_path / "missing.mat", "no such file"),
        (tmp_path / "a.txt", "its name is not that of a light field"),
        (tmp_path / "a.bag", "a ROS 1 bag; rosbags-convert turns it into a ROS 2 bag"),
        (tmp_path / "a.db3", "a file of a ROS 2 bag; give its folder"),
    ):
        with pytest.raises(InputError, match=message) as refused:
            open_light_field(path)
        assert "\n" not in str(refused.value)
    write_light_field(tmp_path / "b.mat", noise(2, 2), "lftoolbox")
    with pytest.raises(InputError, match="has 1 frame, but not frame 2"):
        open_light_field(tmp_path / "b.mat", frame=2)
    (tmp_path / "a.ply").write_bytes(b"ply")
    with pytest.raises(InputError, match="ply can only be written"):
        open_light_field(tmp_path / "a.ply")


@pytest.mark.parametrize("to", ["eslf", "tiles", "stanford", "plenpy", "plenopticam"])
def test_geometry_that_a_file_lacks_is_given_or_in_views_toml(tmp_path: Path, to: Any) -> None:
    light_field = plane(3, 3, 1.0)
    path = tmp_path / f"a{formats()[to].ending}"
    write_light_field(path, light_field, to)
    (path.with_suffix(".json") if path.is_file() else path / "views.json").unlink()
    sidecar = views_toml(path)
    assert sidecar == (tmp_path / f"{path.stem}.views.toml" if path.is_file() else path / "views.toml")
    with pytest.raises(InputError, match=r"no a_\w+\.json.* rows and cols|does not state its .*focal_px") as refused:
        open_light_field(path)
    assert f"in {sidecar.relative_to(tmp_path)}" in str(refused.value)
    given = Assumed(rows=3, cols=3, step_mm=10.0, focal_px=400.0, reference_depth_mm=455.0)
    found = open_light_field(path, assumed=given)
    sidecar.write_text("".join(f"{name} = {value}\n" for name, value in given), encoding="utf-8")
    assert_same(open_light_field(path), found)
    assert open_light_field(path, assumed=Assumed(focal_px=300.0)).focal_px == 300.0  # arguments take precedence
    assert np.allclose(found.positions_mm, light_field.positions_mm)
    assert found.reference_distance_mm == pytest.approx(light_field.reference_distance_mm)
    if to == "plenpy" or (to == "plenopticam" and found.samples.dtype == np.float32):
        assert np.abs(found.samples.astype(float) * 255 - light_field.samples).max() < 1e-3
    else:
        assert np.array_equal(found.samples, light_field.samples)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rows = 2\ncols = 2", r"its step_mm, focal_px, reference_depth_mm: expected in a_tiles\.views\.toml"),
        ("step = 2.0", r"a_tiles\.views\.toml: step: not known, did you mean step_mm\?"),
        ("rows = 0", "rows: Input should be greater than or equal to 1"),
        ("rows = true", "rows: bool, expected a number"),
        ("focal_px = nan", "focal_px: Input should be"),
        ("reference_depth_mm = 2e6", "reference_depth_mm: expected 0.001 to 1000000 or inf"),
        ("rows 2", "not valid TOML"),
    ],
)
def test_a_views_toml_is_checked(tmp_path: Path, text: str, message: str) -> None:
    write_light_field(tmp_path / "a_tiles.png", noise(2, 2), "tiles")
    (tmp_path / "a_tiles.json").unlink()
    (tmp_path / "a_tiles.views.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        open_light_field(tmp_path / "a_tiles.png")


def test_views_files_of_something_else_are_refused(tmp_path: Path) -> None:
    write_light_field(tmp_path / "a_tiles.png", noise(2, 2), "tiles")
    for text, message in (
        ("{}", "schema: Field required"),
        ("[1, 2]", "should be an object"),
        ("{", "not valid JSON"),
        ('{"schema": "mirrorcam.views/1"}', "views: Field required"),
        ('{"schema": "mirrorcam.views/1", "views": {"width_px": 3}}', "does not describe views"),
    ):
        (tmp_path / "a_tiles.json").write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=message):
            open_light_field(tmp_path / "a_tiles.png")


def test_pictures_that_are_missing_or_of_another_size_are_refused(tmp_path: Path) -> None:
    light_field = noise(2, 2)
    for to, picture in (
        ("stanford", "out_00_00_*.png"),
        ("nerfstudio", "images/view_00_00.png"),
        ("colmap", "images/view_00_00/0000.png"),
    ):
        folder = tmp_path / to
        write_light_field(folder, light_field, to)
        file = next(folder.glob(picture))
        other = next(each for each in folder.glob("**/*.png") if each != file and "masks" not in each.parts)
        good = other.read_bytes()
        from mirrorcam.core.images.pictures import write_image

        write_image(other, np.zeros((5, 6, 3), np.uint8))
        with pytest.raises(InputError, match="6x5 px, expected"):
            open_light_field(folder)
        other.write_bytes(good)
        file.unlink()
        with pytest.raises(InputError, match=r"lacks view|no such file"):
            open_light_field(folder)


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    for to, array in (("plenpy", "light_field.npy"), ("plenopticam", "vp_img_arr.npy")):
        write_light_field(tmp_path / to, noise(2, 2), to)
        values = np.load(tmp_path / to / array)
        values[0, 0, 0, 0, 0] = np.nan
        np.save(tmp_path / to / array, values)
        with pytest.raises(InputError, match="NaN or infinite"):
            open_light_field(tmp_path / to)


@pytest.mark.parametrize("to", ["eslf", "stanford", "nerfstudio", "colmap", "hci", "tiles"])
def test_pictures_that_take_too_much_memory_in_total_are_refused(
    tmp_path: Path, to: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{formats()[to].ending}"
    light_field = plane(3, 3, 1.0)
    write_light_field(path, light_field, to)
    monkeypatch.setattr(array_files, "LARGEST_BYTES", 9 * 90 * 120 * 7)
    monkeypatch.setattr(array_files, "MAX_GROWTH", 0)
    if to != "colmap":  # its pictures have margins
        open_light_field(path)
    monkeypatch.setattr(array_files, "LARGEST_BYTES", 9 * 90 * 120 * 7 - 1)
    with pytest.raises(InputError, match=r"states arrays of 0 MB, expected at most 0 MB"):
        open_light_field(path)


def test_messages_are_short_and_name_the_file(tmp_path: Path) -> None:
    write_light_field(tmp_path / "a_tiles.png", noise(2, 2), "tiles")
    text = json.loads((tmp_path / "a_tiles.json").read_text(encoding="utf-8"))
    (tmp_path / "a_tiles.json").write_text(json.dumps(text | {"x" * 1000: 1}), encoding="utf-8")
    with pytest.raises(InputError, match=r"a_tiles\.json") as refused:
        open_light_field(tmp_path / "a_tiles.png")
    assert len(str(refused.value)) <= 300


@pytest.mark.parametrize("to", READABLE)
def test_formats_of_grids_refuse_a_pattern_and_the_others_store_it(tmp_path: Path, to: Any) -> None:
    places = 20.0 * Pattern.hexagonal(1).positions
    grid = noise(1, 7)
    positions = np.column_stack([places - places[3], np.zeros(7)])[None]
    hexagon = LightField.of(replace(grid, positions_mm=positions), grid.samples, (grid.weights > 0).astype(np.float32))
    path = tmp_path / f"a{formats()[to].ending}"
    if not formats()[to].needs_grid:
        write_light_field(path, hexagon, to)
        assert np.allclose(open_light_field(path).positions_mm, hexagon.positions_mm)
        return
    with pytest.raises(InputError, match=f"{to} holds rows and columns of views, but these form another pattern"):
        write_light_field(path, hexagon, to)
    assert not path.exists()
