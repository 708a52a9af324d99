"""Scenes of the 4D Light Field Benchmark: round trip, its formula, and depth compared with OpenCV's stereo."""

from __future__ import annotations

from configparser import ConfigParser
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.light_field_depth.scenes import render_hci
from benchmarks.light_field_depth.stereo import Disparity, best_stereo, scores
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pfm import read_pfm
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.io.formats.hci import HciScene, read_hci, write_hci
from mirrorcam.optics.light_field.light_field import LightField, Views
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph
from tests.soon import soon

SIDE = 128
SCENE = (
    Surface(640.0, slope=(0.3, -0.2), seed=1),
    Surface(430.0, bounds=(-45.0, -20.0, -8.0, 60.0), seed=2, mean=0.4),
    Surface(500.0, slope=(-0.4, 0.1), bounds=(10.0, -50.0, 50.0, 30.0), seed=3, mean=0.6),
)


def square_views(count: int) -> Views:
    """An even grid of square views with the principal point in the middle, as in the benchmark."""
    return grid_views(
        count,
        count,
        step_mm=4.0,
        uneven=False,
        focal_px=420.0,
        centre_px=np.full(2, (SIDE - 1) / 2),
        width_px=SIDE,
        height_px=SIDE,
        reference_depth_mm=430.0,
    )


@pytest.fixture(scope="module")
def nine(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, LightField, FloatArray]:
    """A scene of 9x9 views on disk, in memory, and its depth."""
    folder = tmp_path_factory.mktemp("hci") / "scene"
    light_field, depth, _ = photograph(square_views(9), SCENE, noise=0.01)
    write_hci(folder, light_field, depth.astype(np.float32))
    return folder, light_field, depth


def test_even_light_fields_survive_the_round_trip_without_our_own_files(
    nine: tuple[Path, LightField, FloatArray], tmp_path: Path
) -> None:
    folder, light_field, depth = nine
    plain = tmp_path / "plain"
    plain.mkdir()
    for file in folder.iterdir():
        (plain / file.name).write_bytes(file.read_bytes())
    parser = ConfigParser()
    parser.read(plain / "parameters.cfg", encoding="utf-8")
    parser.remove_section("mirrorcam")
    with (plain / "parameters.cfg").open("w", encoding="utf-8") as text:
        parser.write(text)
    read = read_hci(plain)
    assert np.array_equal(read.light_field.samples, light_field.samples)
    for name in ("positions_mm", "centre_px", "focal_px"):
        assert np.allclose(getattr(read.light_field, name), getattr(light_field, name), rtol=1e-12)
    assert read.light_field.reference_distance_mm == pytest.approx(light_field.reference_distance_mm)
    assert read.disparity_px is not None
    assert np.allclose(read.disparity_px, light_field.disparity_px_from_depth(depth), atol=1e-5)
    assert read.disparity_range_px is not None
    low, high = read.disparity_range_px
    assert low <= read.disparity_px.min() <= low + 0.1
    assert high - 0.1 <= read.disparity_px.max() <= high
    near, far = read.depth_range_mm or (0.0, 0.0)
    offset = light_field.reference_view_depth_mm
    assert near <= depth.min() - offset
    assert far >= depth.max() - offset


def test_uneven_light_fields_with_gaps_survive_the_round_trip(tmp_path: Path) -> None:
    light_field, _, _ = photograph(grid_views(2, 3), SCENE)
    weights = light_field.weights.copy()
    weights[0, 1, :20] = 0.0
    samples = (light_field.samples * (weights > 0)[..., None]).astype(np.uint8)[..., :1]
    cut = LightField.of(light_field, np.ascontiguousarray(samples), weights)
    write_hci(tmp_path / "a", cut)
    read = read_hci(tmp_path / "a")
    assert read.disparity_px is None
    for field in fields(LightField):
        assert np.array_equal(getattr(read.light_field, field.name), getattr(cut, field.name)), field.name


def test_disparities_follow_the_benchmarks_formula(nine: tuple[Path, LightField, FloatArray]) -> None:
    """d = B f / sensor size * resolution * (1 / Z - 1 / focus distance), as the benchmark's toolkit converts."""
    folder = nine[0]
    parser = ConfigParser()
    parser.read(folder / "parameters.cfg", encoding="utf-8")
    numbers = {key: float(parser[section][key]) for section in ("intrinsics", "extrinsics") for key in parser[section]}
    depth_m = read_pfm(folder / "gt_depth_lowres.pfm").astype(float)
    scale = numbers["baseline_mm"] / 1000 * numbers["focal_length_mm"] * SIDE
    focus_m = numbers["focus_distance_m"]
    theirs = (scale * focus_m / depth_m - scale) / focus_m / numbers["sensor_size_mm"]
    assert np.abs(theirs - read_pfm(folder / "gt_disp_lowres.pfm")).max() < 1e-4


def test_pictures_move_by_their_disparities(nine: tuple[Path, LightField, FloatArray]) -> None:
    """The view one to the right, shifted by the disparity of a patch, shows that patch: rows of views, then columns."""
    folder = nine[0]
    disparity = read_pfm(folder / "gt_disp_lowres.pfm").astype(float)
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    centre = read_image(folder / "input_Cam040.png").astype(float)
    inside = slice(20, -20)
    for name, across, down in (("044", 4, 0), ("036", -4, 0), ("076", 0, 4), ("004", 0, -4)):
        other = read_image(folder / f"input_Cam{name}.png")

        def unlike(sign: int, other: Any = other, across: int = across, down: int = down) -> float:
            columns, rows = u - sign * across * disparity, v - sign * down * disparity
            moved = cv2.remap(other, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR)
            return float(np.median(np.abs(moved - centre)[inside, inside]))

        assert unlike(1) < 6.0
        assert unlike(1) < 0.5 * unlike(-1)


def test_every_fourth_view_has_four_times_the_disparity(nine: tuple[Path, LightField, FloatArray]) -> None:
    folder, light_field, _ = nine
    whole, part = read_hci(folder), read_hci(folder, every=4)
    assert part.light_field.samples.shape[:2] == (3, 3)
    assert np.array_equal(part.light_field.samples, light_field.samples[::4, ::4])
    assert part.light_field.step_mm() == pytest.approx(4 * whole.light_field.step_mm())
    assert part.disparity_px is not None
    assert whole.disparity_px is not None
    assert np.allclose(part.disparity_px, 4 * whole.disparity_px)
    with pytest.raises(InputError, match="9x9 views, but every 3th must include the central one"):
        read_hci(folder, every=3)


def our_disparity(scene: HciScene) -> Disparity:
    """Disparity (v, u) of the central view from all views."""
    near, far = scene.depth_range_mm or (None, None)
    found = DepthEstimator(scene.light_field, near_mm=near, far_mm=far).estimate(scene.light_field)
    return found.disparity_px().astype(np.float32)


def test_nine_views_beat_the_best_stereo_pair(nine: tuple[Path, LightField, FloatArray]) -> None:
    """Pair and settings of OpenCV's StereoSGBM are chosen with knowledge of the truth."""
    scene = read_hci(nine[0], every=4)
    assert scene.disparity_px is not None
    ours = scores(our_disparity(scene), scene.disparity_px, 4)
    best, _ = best_stereo(scene, 4)
    assert ours["bad"] < 0.6 * best["bad"]
    # The remaining errors are in pixels across a depth edge, whose truth is that of their centre.
    assert ours["mse"] < best["mse"]
    # A scene that stereo cannot solve at all would prove nothing.
    assert best["bad"] < 15.0


@pytest.mark.slow
def test_nine_views_of_a_rendered_tabletop_beat_the_best_stereo_pair(tmp_path: Path) -> None:
    render_hci(tmp_path / "tabletop", size_px=256)
    scene = read_hci(tmp_path / "tabletop", every=4)
    assert scene.disparity_px is not None
    ours = scores(our_disparity(scene), scene.disparity_px, 4)
    best, _ = best_stereo(scene, 4)
    assert ours["bad"] < best["bad"]
    assert ours["mse"] < best["mse"]


def changed(folder: Path, tmp_path: Path, **changes: Any) -> Path:
    """A copy of a scene's parameters and one picture, with some text of the parameters replaced."""
    broken = tmp_path / "broken"
    broken.mkdir()
    text = (folder / "parameters.cfg").read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in text
        text = "\n".join(f"{old} = {new}" if line.startswith(f"{old} =") else line for line in text.splitlines())
    (broken / "parameters.cfg").write_text(text, encoding="utf-8")
    (broken / "input_Cam000.png").write_bytes((folder / "input_Cam000.png").read_bytes())
    return broken


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, r"input_Cam001.png: no such file"),
        ({"baseline_mm": "-1"}, "baseline_mm is -1, expected a positive number"),
        ({"num_cams_x": "nan"}, "num_cams_x is nan, expected a positive whole number"),
        ({"focal_length_mm": "long"}, "not the parameters of a light field"),
        ({"num_cams_x": "7"}, "9x9 positions for 7x9 views"),
        ({"image_resolution_x_px": "64"}, "input_Cam000.png: 128x128 px, expected 64x128"),
        ({"positions_mm": "[1, 2]"}, "section 'mirrorcam': does not describe views"),
        ({"reference_depth_mm": "nan"}, "section 'mirrorcam': does not describe views"),
    ],
)
def test_folders_that_are_not_scenes_are_refused(
    nine: tuple[Path, LightField, FloatArray], tmp_path: Path, changes: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_hci(changed(nine[0], tmp_path, **changes))
    assert "\n" not in str(caught.value)


def test_a_truth_of_another_size_and_a_folder_without_parameters_are_refused(tmp_path: Path) -> None:
    light_field, depth, _ = photograph(grid_views(1, 3), SCENE)
    write_hci(tmp_path / "a", light_field, depth.astype(np.float32))
    (tmp_path / "a/gt_disp_lowres.pfm").write_bytes(b"Pf\n2 2\n-1\n" + bytes(16))
    with pytest.raises(InputError, match=r"gt_disp_lowres.pfm: 2x2, expected 120x90"):
        read_hci(tmp_path / "a")
    with pytest.raises(InputError, match=r"parameters.cfg: no such file"):
        read_hci(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_cams_x": "1000000"}, "num_cams_x is 1e\\+06, expected a positive whole number up to 1000"),
        ({"num_cams_y": "8.5"}, "num_cams_y is 8.5, expected a positive whole number"),
        ({"channels": "2"}, "channels is neither 1 nor 3"),
        ({"focal_px": "'x'"}, "section 'mirrorcam': does not describe views"),
    ],
)
def test_numbers_that_no_scene_has_are_refused(
    nine: tuple[Path, LightField, FloatArray], tmp_path: Path, changes: dict[str, str], message: str
) -> None:
    folder = changed(nine[0], tmp_path, **changes)
    for picture in nine[0].glob("*.png"):
        (folder / picture.name).write_bytes(picture.read_bytes())
    with pytest.raises(InputError, match=message):
        read_hci(folder)


def test_blanks_in_a_row_are_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "parameters.cfg").write_text("[intrinsics]\na" + " " * 60_000 + "b\n")
    with soon(), pytest.raises(InputError, match="not the parameters of a light field: a hundred blanks in a row"):
        read_hci(tmp_path)


def test_a_scene_of_too_many_pictures_is_refused_before_they_are_searched(
    nine: tuple[Path, LightField, FloatArray], tmp_path: Path
) -> None:
    text = (nine[0] / "parameters.cfg").read_text().replace("= 9\n", "= 999\n")
    (tmp_path / "parameters.cfg").write_text(text)
    with pytest.raises(InputError, match="999x999 views, expected at most 100000"):
        read_hci(tmp_path)
