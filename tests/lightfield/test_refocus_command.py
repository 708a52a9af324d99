"""`mirrorcam refocus`, from files to files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.core.disk.output_folder import HIDDEN
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.io.formats.hci import write_hci
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.recording import Recording, about
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import assert_refused_here
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

SCENE = [Surface(560.0, slope=(0.2, -0.3), seed=1), Surface(400.0, bounds=(-16.0, -22.0, 8.0, 14.0), seed=2)]
BEHIND_MM = -80.0


@pytest.fixture(scope="module")
def light_field() -> LightField:
    return photograph(grid_views(), SCENE)[0]


@pytest.fixture(scope="module")
def inputs(light_field: LightField, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("refocus")
    save_npz(folder / "card.npz", light_field)
    write_hci(folder / "scene", light_field)
    return folder


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != HIDDEN)


def sharpness(image: np.ndarray, where: tuple[slice, slice]) -> float:
    """Variance of the Laplacian in a part of a picture."""
    return float(cv2.Laplacian(image.astype(np.float32).mean(axis=2), cv2.CV_32F)[where].var())


def test_pictures_are_focused_where_asked(inputs: Path, tmp_path: Path) -> None:
    near, far = 400.0 + BEHIND_MM, 560.0 + BEHIND_MM
    asked = ["--depth-mm", str(near), str(far), "--out", str(tmp_path)]
    assert main(["refocus", str(inputs / "card.npz"), str(inputs / "scene"), *asked]) == 0
    expected = [
        f"{name}_focus_{at}mm.{kind}" for name in ("card", "scene") for at in (320, 480) for kind in ("npz", "png")
    ]
    assert names(tmp_path) == expected
    on_card = slice(28, 56), slice(46, 62)
    shown = [read_image(tmp_path / f"card_focus_{at}mm.png") for at in (320, 480)]
    assert sharpness(shown[0], on_card) > 4.0 * sharpness(shown[1], on_card)
    with np.load(tmp_path / "card_focus_320mm.npz") as arrays:
        assert arrays["image"].dtype == np.float32
        np.testing.assert_allclose(arrays["image"][30, 50] * 255.0, shown[0][30, 50], atol=0.51)
        assert arrays["weights"].max() == pytest.approx(9.0)
        assert arrays["layout_identity"] == "0123456789abcdef"


@pytest.mark.parametrize("combine", ["median", "weighted"])
def test_views_are_combined_as_asked(inputs: Path, tmp_path: Path, combine: str) -> None:
    path = str(inputs / "card.npz")
    assert main(["refocus", path, "--out", str(tmp_path / "mean")]) == 0
    assert main(["refocus", path, "--combine", combine, "--out", str(tmp_path / combine)]) == 0
    mean, other = (read_image(tmp_path / each / "card_focus_375mm.png") for each in ("mean", combine))
    assert np.abs(mean.astype(int) - other).mean() > 1.0


@pytest.mark.slow
def test_planes_are_tilted_and_super_sampled(inputs: Path, tmp_path: Path) -> None:
    asked = ["--depth-mm", "480", "--tilt-deg", "11.3", "-16.7", "--scale", "2", "--out", str(tmp_path)]
    assert main(["refocus", str(inputs / "card.npz"), *asked]) == 0
    astray = ["--depth-mm", "480", "--tilt-deg", "-11.3", "16.7", "--scale", "2", "--out", str(tmp_path / "astray")]
    assert main(["refocus", str(inputs / "card.npz"), *astray]) == 0
    tilted, turned = (read_image(folder / "card_focus_480mm.png") for folder in (tmp_path, tmp_path / "astray"))
    assert tilted.shape == (180, 240, 3)
    edge = slice(10, 170), slice(190, 230)
    assert sharpness(tilted, edge) > 1.5 * sharpness(turned, edge)


def test_a_scale_may_lie_between_whole_numbers(inputs: Path, tmp_path: Path) -> None:
    path = str(inputs / "card.npz")
    assert main(["refocus", path, "--depth-mm", "480", "--scale", "1.5", "--out", str(tmp_path)]) == 0
    assert read_image(tmp_path / "card_focus_480mm.png").shape == (135, 180, 3)


def test_everything_is_sharp_seen_from_elsewhere_and_past_the_card(
    inputs: Path, tmp_path: Path, light_field: LightField, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(inputs / "card.npz")
    assert main(["refocus", path, "--all-in-focus", "--from-mm", "19", "0", "--out", str(tmp_path)]) == 0
    pictures = [f"card_{what}.{kind}" for what in ("all_in_focus", "from") for kind in ("npz", "png")]
    assert names(tmp_path) == sorted([*pictures, "card_depth.npz"])
    central, right = (light_field.samples[1, s].astype(int) for s in (1, 2))
    inner = slice(10, -10), slice(20, -20)
    sharp, moved = (read_image(tmp_path / f"card_{what}.png").astype(int) for what in ("all_in_focus", "from"))
    assert np.abs(sharp - central)[inner].mean() < 4.0
    assert np.abs(moved - right)[inner].mean() < 0.5 * np.abs(moved - central)[inner].mean()
    past = ["--behind-mm", "400", "--depth-mm", "480", "--out", str(tmp_path / "past")]
    assert main(["refocus", path, *past]) == 0
    assert "card_focus_480mm: no view shows " in capsys.readouterr().out
    with np.load(tmp_path / "past/card_focus_480mm.npz") as arrays:
        assert arrays["weights"][40, 54] < 6.0
        assert arrays["weights"][80, 110] > 6.0


def test_infinity_is_a_depth(inputs: Path, tmp_path: Path) -> None:
    assert main(["refocus", str(inputs / "card.npz"), "--depth-mm", "inf", "--out", str(tmp_path)]) == 0
    assert names(tmp_path) == ["card_focus_infmm.npz", "card_focus_infmm.png"]


def test_loops_are_written(inputs: Path, tmp_path: Path) -> None:
    asked = ["--orbit", "gif", "--sweep", "mp4", "--near-mm", "300", "--far-mm", "600", "--out", str(tmp_path)]
    assert main(["refocus", str(inputs / "card.npz"), *asked]) == 0
    assert names(tmp_path) == ["card_depth.npz", "card_orbit.gif", "card_sweep.mp4"]
    read, animation = cv2.imreadanimation(str(tmp_path / "card_orbit.gif"))
    assert read
    assert len(animation.frames) == 36
    assert np.abs(animation.frames[0].astype(int) - animation.frames[18]).mean() > 8.0
    frames = [item.pixels for item in Video(tmp_path / "card_sweep.mp4").frames() if isinstance(item, Frame)]
    assert len(frames) == 46
    on_card = slice(28, 56), slice(46, 62)
    sharp = [sharpness(frame, on_card) for frame in frames[:24]]
    assert sharp[3] > 2.0 * sharp[-1]


def test_every_frame_of_a_recording_gets_its_pictures(light_field: LightField, tmp_path: Path) -> None:
    recording = Recording(tmp_path / "film.zarr", about(light_field, {"sha256": "feed"}), ZarrSink())
    for number in (0, 1):
        recording.add(Frame(number, number / 30.0, np.zeros((2, 2, 3), np.uint8)), light_field)
    recording.finish()
    recording.close()
    assert main(["refocus", str(tmp_path / "film.zarr"), "--out", str(tmp_path / "out")]) == 0
    kinds = ("npz", "png")
    assert names(tmp_path / "out") == [f"film_{number:06d}_focus_375mm.{kind}" for number in (0, 1) for kind in kinds]


def test_frames_are_decoded_with_their_layout(default_layout: Layout, tmp_path: Path) -> None:
    default_layout.save(tmp_path / "layout.json")
    size = default_layout.camera.height_px, default_layout.camera.width_px, 3
    write_image(tmp_path / "frame.png", np.full(size, 90, np.uint8))
    decoded = [str(tmp_path / "frame.png"), "--layout", str(tmp_path / "layout.json"), "--out", str(tmp_path / "out")]
    assert main(["refocus", *decoded]) == 0
    (picture,) = (tmp_path / "out").glob("frame_focus_*.png")
    shown = read_image(picture)
    assert (shown[shown.shape[0] // 2, shown.shape[1] // 2] == 90).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["refocus", "missing.npz"], "missing.npz: no such file"),
        (["refocus", "card.npz", "elsewhere/card.npz"], "two light fields are called 'card'"),
        (
            ["refocus", "card.npz", "--depth-mm", "-90"],
            "--depth-mm '-90': Input should be greater than",
        ),
        (["refocus", "card.npz", "--depth-mm", "400", "400"], "focus at 400 mm is requested twice"),
        (["refocus", "card.npz", "--tilt-deg", "88", "0"], "--tilt-deg '88': Input should be less than or equal to 85"),
        (["refocus", "card.npz", "--from-mm", "80", "0"], "position (80, 0) mm lies outside the views"),
        (["refocus", "card.npz", "--from-mm", "nan", "0"], "--from-mm 'nan': Input should be a finite number"),
        (["refocus", "card.npz", "--depth-mm", "nan"], "--depth-mm 'nan': "),
        (["refocus", "card.npz", "--scale", "9"], "--scale '9': Input should be less than or equal to 8"),
        (["refocus", "card.npz", "--orbit", "avi"], "--orbit 'avi': Input should be 'gif' or 'mp4'"),
        (
            ["refocus", "card.npz", "--all-in-focus", "--near-mm", "600", "--far-mm", "400"],
            "the nearest depth must be less than the farthest",
        ),
        (
            ["refocus", "frame.png"],
            "frame.png: no frame.json next to the picture: give --layout of the camera",
        ),
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
    assert_refused_here([*arguments, "--out", str(tmp_path / "out")], capsys, message)
    assert not (tmp_path / "out").exists()
