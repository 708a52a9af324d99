"""`mirrorcam depth`, from files to files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.core.images.pfm import read_pfm
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.io.formats.hci import write_hci
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from mirrorcam.optics.light_field.io.recording import Recording, about
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import assert_refused_here, results
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

SCENE = [Surface(560.0, slope=(0.25, -0.35), seed=1), Surface(420.0, bounds=(-18.0, -30.0, 14.0, 12.0), seed=2)]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("depth")
    light_field, depth, _ = photograph(grid_views(), SCENE)
    save_npz(folder / "card.npz", light_field)
    write_hci(folder / "scene", light_field)
    np.save(folder / "truth.npy", depth)
    return folder


def test_light_fields_and_scenes_get_pictures_and_arrays(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["depth", str(inputs / "card.npz"), str(inputs / "scene"), "--out", str(tmp_path / "out")]) == 0
    truth = np.load(inputs / "truth.npy")
    for name in ("card", "scene"):
        with np.load(tmp_path / f"out/{name}_depth.npz") as arrays:
            depth = arrays["depth_mm"]
            assert np.nanmedian(np.abs(depth - truth) / truth) < 0.003
            assert np.isfinite(depth).mean() > 0.95
            assert arrays["sigma_mm"].shape == arrays["confidence"].shape == depth.shape
            assert arrays["view"].tolist() == [1, 1]
        assert np.array_equal(read_pfm(tmp_path / f"out/{name}_depth.pfm"), depth, equal_nan=True)
        picture = read_image(tmp_path / f"out/{name}_depth.png")
        assert picture.shape[1] > 1000
        assert picture.std() > 20
    said = capsys.readouterr().out
    assert "card: " in said
    assert "confidence above 0.5, median " in said


def test_every_frame_of_a_recording_gets_its_depth(inputs: Path, tmp_path: Path) -> None:
    light_field = load_npz(inputs / "card.npz")
    recording = Recording(tmp_path / "film.zarr", about(light_field, {"sha256": "feed"}), ZarrSink())
    dark = LightField.of(light_field, np.zeros_like(light_field.samples), light_field.weights)
    for number, each in enumerate((light_field, dark)):
        recording.add(Frame(number, number / 30.0, np.zeros((2, 2, 3), np.uint8)), each)
    recording.finish()
    recording.close()
    assert main(["depth", str(tmp_path / "film.zarr"), "--out", str(tmp_path / "out")]) == 0
    names = [f"film_{number:06d}_depth.{kind}" for number in (0, 1) for kind in ("npz", "pfm", "png")]
    assert results(tmp_path / "out") == names
    truth = np.load(inputs / "truth.npy")
    found = read_pfm(tmp_path / "out/film_000000_depth.pfm")
    assert np.nanmedian(np.abs(found - truth) / truth) < 0.003
    with np.load(tmp_path / "out/film_000001_depth.npz") as arrays:
        assert arrays["confidence"].max() < 0.2


@pytest.mark.slow
def test_frames_are_decoded_with_their_layout(default_layout: Layout, tmp_path: Path) -> None:
    default_layout.save(tmp_path / "layout.json")
    size = default_layout.camera.height_px, default_layout.camera.width_px, 3
    write_image(tmp_path / "frame.png", np.random.default_rng(0).integers(0, 255, size, dtype=np.uint8))
    assert (
        main(["depth", str(tmp_path / "frame.png"), "--layout", str(tmp_path / "layout.json"), "--out", str(tmp_path)])
        == 0
    )
    with np.load(tmp_path / "frame_depth.npz") as arrays:
        assert arrays["layout_identity"] == default_layout.identity
        # Of noise nothing is to be learnt.
        assert np.median(arrays["confidence"]) < 0.2


def test_depths_that_are_looked_for_can_be_chosen(inputs: Path, tmp_path: Path) -> None:
    arguments = ["depth", str(inputs / "card.npz"), "--near-mm", "300", "--far-mm", "345", "--out", str(tmp_path)]
    assert main(arguments) == 0
    found = read_pfm(tmp_path / "card_depth.pfm")
    assert np.nanmax(found) < 360.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.npz"], "missing.npz: no such file"),
        (["frame.png"], "frame.png: no frame.json next to the picture: give --layout of the camera"),
        (["card.npz", "elsewhere/card.npz"], "two light fields are called 'card', expected different names"),
        (["card.npz", "--near-mm", "500", "--far-mm", "400"], "the nearest depth must be less than the farthest"),
        (["."], "the folder does not have a known format"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    inputs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(inputs)
    write_image(inputs / "frame.png", np.zeros((4, 6, 3), np.uint8))
    assert_refused_here(["depth", *arguments, "--out", str(tmp_path / "out")], capsys, message)
    assert not (tmp_path / "out").exists()
