"""`mirrorcam features`: what it writes is what the library finds, and bad input is one line."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.core.images.pictures import read_image
from mirrorcam.lightfield import light_field_inputs
from mirrorcam.lightfield.features_command import draw_features, write_features
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, NamedLightField
from mirrorcam.lightfield.requests import FeaturesRequest
from mirrorcam.optics.light_field.features import FeatureFinder
from mirrorcam.optics.light_field.features.feature_set import COLUMNS
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import assert_refused_here, results
from tests.drawn import drawn, values_of
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph
from tests.optics.light_field.features.scenes import of_planes, uneven_views


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A light field of a board before a wall."""
    planes = [(560.0, (0.1, -0.2), None, 1), (430.0, (0.6, 0.2), (-30.0, -60.0, 55.0, 25.0), 2)]
    path = tmp_path_factory.mktemp("features") / "board.npz"
    save_npz(path, of_planes(uneven_views(), planes)[0])
    return path


def test_pictures_tables_and_arrays_are_those_of_the_features(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["features", str(stored), "--detector", "ORB", "--out", str(tmp_path)]) == 0
    light_field = load_npz(stored)
    found = FeatureFinder(light_field, "ORB").find(light_field)
    assert len(found) > 100
    assert f"board: {len(found)} features, {found.refracted.sum()} of them with two slopes" in capsys.readouterr().out

    with np.load(tmp_path / "board_features.npz") as arrays:
        assert np.array_equal(arrays["points_in_rig_mm"], found.points_in_rig_mm)
        assert np.array_equal(arrays["seen_px"], found.seen_px, equal_nan=True)
        assert np.array_equal(arrays["descriptors"], found.descriptors)
        assert str(arrays["layout_identity"]) == light_field.layout_identity
    with (tmp_path / "board_features.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == len(found)
    columns = {name: np.array([float(row[name] or "nan") for row in rows]) for name in COLUMNS}
    assert np.allclose(np.stack([columns["u_px"], columns["v_px"]], axis=1), found.pixels, rtol=1e-6)
    rig = np.stack([columns[f"{axis}_rig_mm"] for axis in "xyz"], axis=1)
    assert np.allclose(rig, found.points_in_rig_mm, rtol=1e-6, atol=1e-5)
    assert np.allclose(columns["depth_mm"], found.depth_mm, rtol=1e-6)
    assert (columns["views"] == found.seen.sum(axis=(1, 2))).all()
    assert (columns["refracted"] == found.refracted).all()

    # Far things are blue, near ones red: look at the disc of the farthest and of the nearest plain feature.
    picture = read_image(tmp_path / "board_features.png").astype(int)
    assert 900 < picture.shape[1] < 1100
    colourful = picture.max(axis=2) - picture.min(axis=2) > 120
    assert (colourful & (picture[..., 0] > 200) & (picture[..., 2] < 100)).sum() > 300
    assert (colourful & (picture[..., 2] > 150) & (picture[..., 0] < 100)).sum() > 300


@pytest.mark.slow
def test_options_reach_the_finder(stored: Path, tmp_path: Path) -> None:
    def count(*options: str) -> int:
        assert cli.main(["features", str(stored), "--out", str(tmp_path), *options]) == 0
        return len(np.load(tmp_path / "board_features.npz")["pixels"])

    usual = count("--detector", "ORB")
    assert count("--detector", "ORB", "--keypoints", "150") < 0.7 * usual
    assert count("--detector", "ORB", "--min-views", "8") < usual
    assert 0 < count("--detector", "ORB", "--near-mm", "250", "--far-mm", "420") < usual
    assert str(np.load(tmp_path / "board_features.npz")["detector"]) == "ORB"
    count()
    assert str(np.load(tmp_path / "board_features.npz")["detector"]) == "SIFT4D"


def test_scenes_are_searched_at_the_depths_that_they_state(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    light_field = load_npz(stored)
    ranges = {"near": (250.0, 420.0), "far": (420.0, 900.0), "any": None}
    opened = [NamedLightField(name, light_field, known) for name, known in ranges.items()]
    monkeypatch.setattr(light_field_inputs, "open_inputs", lambda *asked: opened)
    assert cli.main(["features", str(stored), "--detector", "ORB", "--out", str(tmp_path)]) == 0
    depths = {name: np.load(tmp_path / f"{name}_features.npz")["depth_mm"] for name in ranges}
    assert 0 < len(depths["near"]) < len(depths["any"])
    assert depths["near"].max() < 420 <= depths["far"].min()


def test_a_light_field_without_features_is_reported(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light_field = load_npz(stored)
    blank = LightField.of(light_field, np.full_like(light_field.samples, 90), light_field.weights)
    save_npz(tmp_path / "blank.npz", blank)
    assert cli.main(["features", str(tmp_path / "blank.npz"), "--out", str(tmp_path)]) == 1
    assert "blank: 0 features, 0 of them with two slopes\n" in capsys.readouterr().out
    assert (tmp_path / "blank_features.csv").read_text(encoding="utf-8") == ",".join(COLUMNS) + "\n"
    assert read_image(tmp_path / "blank_features.png").shape[2] == 3


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("gone.npz", "gone.npz"),
        ("frame.png", "frame.png: no such file"),
        ("STORED STORED", "two light fields are called 'board'"),
        ("STORED --detector SURF", "--detector"),
        ("STORED --min-views 9", "minimum number of views is 9 besides the reference view, expected 1 to 8"),
        ("STORED --near-mm 500 --far-mm 400", "the nearest depth must be less than the farthest"),
        ("STORED --keypoints 0", "--keypoints"),
    ],
)
def test_bad_input_is_one_line(
    arguments: str, complaint: str, stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(stored) if word == "STORED" else word for word in arguments.split()]
    assert_refused_here(["features", *given, "--out", str(tmp_path / "out")], capsys, complaint)
    assert not (tmp_path / "out").exists()


def test_features_are_counted_as_they_are_written(tmp_path: Path) -> None:
    save_npz(tmp_path / "wall.npz", photograph(grid_views(), [Surface(520.0)])[0])
    inputs = LightFieldInputs((tmp_path / "wall.npz",))
    (found,) = write_features(inputs, tmp_path / "out", FeaturesRequest(detector="ORB"))
    assert results(tmp_path / "out") == ["wall_features.csv", "wall_features.npz", "wall_features.png"]
    with np.load(tmp_path / "out" / "wall_features.npz") as arrays:
        assert found.count == len(arrays["pixels"]) > 0
        assert found.refracted == arrays["refracted"].sum()
        assert found.median_sigma_mm == pytest.approx(np.median(arrays["depth_sigma_mm"]))


def test_marks_are_at_the_features_and_crosses_at_the_refracted_ones(tmp_path: Path) -> None:
    light_field = of_planes(uneven_views(), [(560.0, (0.1, -0.2), None, 1)])[0]
    features = FeatureFinder(light_field, "ORB", two_slope_sigma=1.0).find(light_field)
    plain = ~features.refracted
    assert 0 < plain.sum() < len(features)
    path = tmp_path / "features.png"
    figure = drawn(lambda: draw_features(path, light_field, features), path)
    discs, *crosses = figure.axes[0].collections
    assert np.allclose(discs.get_offsets(), features.pixels[plain])
    assert np.allclose(values_of(discs), 1.0 / features.depth_mm[plain])
    assert all(np.allclose(each.get_offsets(), features.pixels[~plain]) for each in crosses)
    assert f"{(~plain).sum()} with two slopes" in figure.axes[0].get_title()
