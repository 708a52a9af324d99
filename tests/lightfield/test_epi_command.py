"""`mirrorcam epi`, from light fields, recordings and frames to pictures and arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.recording import Recording, about
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import assert_refused_here, results
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.fixture(scope="module")
def light_field() -> LightField:
    return photograph(grid_views(), [Surface(480.0, slope=(0.2, -0.3), seed=1)])[0]


@pytest.fixture(scope="module")
def inputs(light_field: LightField, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("epi")
    save_npz(folder / "card.npz", light_field)
    write_image(folder / "frame.png", np.zeros((4, 6, 3), np.uint8))
    return folder


@pytest.mark.parametrize(("axis", "length"), [("s", 120), ("t", 90)])
def test_epipolar_plane_images_are_drawn_and_written(inputs: Path, tmp_path: Path, axis: str, length: int) -> None:
    asked = ["--axis", axis, "--line", "40", "--depth-mm", "320", "--out", str(tmp_path)]
    assert main(["epi", str(inputs / "card.npz"), *asked]) == 0
    with np.load(tmp_path / "card_epi.npz") as arrays:
        assert arrays["samples"].shape == (3, length, 3)
        assert arrays["positions_mm"][1] == 0.0
        assert (arrays["axis"], arrays["line"], arrays["plane_depth_mm"]) == (axis, 40, 320.0)
    picture = read_image(tmp_path / "card_epi.png")
    assert picture.shape[1] == 1000
    assert picture.std() > 20


def test_every_frame_of_a_recording_gets_its_image(light_field: LightField, tmp_path: Path) -> None:
    recording = Recording(tmp_path / "film.zarr", about(light_field, {"sha256": "feed"}), ZarrSink())
    for number in (0, 1):
        recording.add(Frame(number, number / 30.0, np.zeros((2, 2, 3), np.uint8)), light_field)
    recording.finish()
    recording.close()
    assert main(["epi", str(tmp_path / "film.zarr"), "--out", str(tmp_path / "epi")]) == 0
    written = results(tmp_path / "epi")
    assert written == [f"film_{number:06d}_epi.{kind}" for number in (0, 1) for kind in ("npz", "png")]


def test_frames_are_decoded_with_their_layout(default_layout: Layout, tmp_path: Path) -> None:
    # An even frame is that of a pinhole: a lens lets the borders of views fade.
    pinhole = default_layout.camera.replaced(aperture_mm=0.0)
    default_layout.replaced(camera=pinhole).save(tmp_path / "layout.json")
    size = default_layout.camera.height_px, default_layout.camera.width_px, 3
    write_image(tmp_path / "frame.png", np.full(size, 90, np.uint8))
    decoded = [str(tmp_path / "frame.png"), "--layout", str(tmp_path / "layout.json"), "--out", str(tmp_path / "out")]
    assert main(["epi", *decoded]) == 0
    with np.load(tmp_path / "out" / "frame_epi.npz") as arrays:
        np.testing.assert_allclose(arrays["samples"][arrays["weights"] > 0.5], 90 / 255, atol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("card.npz --line 90", "line 90 along s, expected 0 to 89"),
        ("card.npz --axis u", "invalid choice 'u' for argument '--axis'"),
        ("card.npz --line -1", "--line -1: Input should be greater than or equal to 0"),
        ("card.npz --depth-mm 0", "--depth-mm 0.0: Input should be greater than or equal to 0.001"),
        ("card.npz card.npz", "two light fields are called 'card'"),
        ("frame.png", "frame.png: a picture without frame.json beside it, expected --layout of the camera"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    inputs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: str,
    message: str,
) -> None:
    monkeypatch.chdir(inputs)
    assert_refused_here(["epi", *arguments.split(), "--out", str(tmp_path / "out")], capfd, message)
    assert not (tmp_path / "out").exists()
