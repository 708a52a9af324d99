"""A calibration becomes five files, and corners in files calibrate."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from scipy.ndimage import gaussian_filter

from mirrorcam.calibration.calibration_files import (
    SEARCHED_FRAMES,
    calibrate_files,
    calibration_pictures,
    residual_figure,
    write_calibration,
)
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.diagnostics.view_statistics import cell_means
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.video import write_mjpeg
from mirrorcam.run.run_page import read_metrics
from tests.core.video.camera_bags import compressed, write_bag
from tests.core.video.videos import pictures, write_h264
from tests.drawn import drawn
from tests.optics.calibration.sound_calibration import BOARD, nominal_layout, sound_calibration


def test_files_hold_the_calibration(tmp_path: Path) -> None:
    calibration = sound_calibration()
    write_calibration(calibration, tmp_path, command="mirrorcam test")
    names = ["corners.csv", "layout.json", "metrics.json", "report.html", "residuals.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert Layout.load(tmp_path / "layout.json") == calibration.layout
    assert read_metrics(tmp_path / "metrics.json") == calibration.metrics
    assert "mirrorcam test" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.fixture
def corner_request(tmp_path: Path) -> CalibrationRequest:
    """A request with the corners of the sound calibration as two tables, of frames with and without mirrors."""
    write_calibration(sound_calibration(), tmp_path, command="mirrorcam test")
    nominal_layout().save(tmp_path / "nominal.json")
    save_board(tmp_path / "board.toml", BOARD)
    heads, *lines = [line for line in (tmp_path / "corners.csv").read_text().splitlines() if line[0] != "#"]
    for name, wanted in (("mirrors.csv", False), ("bare.csv", True)):
        kept = [heads, *(line for line in lines if (",direct," in line) == wanted)]
        (tmp_path / name).write_text("\n".join(kept) + "\n")
    tables = (tmp_path / "mirrors.csv", tmp_path / "bare.csv")
    return CalibrationRequest(board=tmp_path / "board.toml", layout=tmp_path / "nominal.json", corners=tables)


def test_tables_of_corners_calibrate_as_their_pictures_did(corner_request: CalibrationRequest) -> None:
    found, first = calibrate_files((), corner_request), sound_calibration()
    assert found.pictures == first.pictures
    assert found.metrics["corners"] == first.metrics["corners"]
    for mirror, same in zip(found.layout.mirrors, first.layout.mirrors, strict=True):
        assert mirror.virtual_centre_in_rig_mm == pytest.approx(same.virtual_centre_in_rig_mm, abs=0.01)


def test_pictures_are_left_out_by_name(corner_request: CalibrationRequest) -> None:
    first = sound_calibration()
    found = calibrate_files((), corner_request.replaced(leave_out=("frame 2", "base frame 1")))
    assert found.pictures == tuple(name for name in first.pictures if name not in {"frame 2", "base frame 1"})
    with pytest.raises(InputError, match=r"--leave-out frame 99: no such picture, expected one of frame 0, frame 1, "):
        calibrate_files((), corner_request.replaced(leave_out=("frame 99",)))


def test_corners_without_mirrors_are_refused(corner_request: CalibrationRequest) -> None:
    with pytest.raises(InputError, match=r"bare\.csv: all corners are in direct views, expected pictures via"):
        calibrate_files((), corner_request.replaced(corners=corner_request.corners[1:]))


def test_mirrors_of_another_surface_are_fitted_from_the_thickness_found_first(
    corner_request: CalibrationRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first fit is of the layout as it is, the second of plates whose thickness is free."""
    fits: list[tuple[Layout, RequestedModel]] = []

    def fit(
        seen: object, base: object, layout: Layout, corners: object, *, model: RequestedModel, **others: object
    ) -> Any:
        fits.append((layout, model))
        return sound_calibration()

    monkeypatch.setattr("mirrorcam.calibration.calibration_files.calibrate_corners", fit)
    calibrate_files((), corner_request.replaced(model=RequestedModel.parse("fisheye+bend+auto+second_surface")))
    (plain, first), (plates, second) = fits
    assert first == RequestedModel(lens="fisheye")
    assert second == RequestedModel(lens="fisheye", additions=("sheet", "bend"), auto=True)
    assert [layout.mirrors[0].is_second_surface for layout in (plain, plates)] == [False, True]
    calibrate_files((), corner_request.replaced(model=RequestedModel.parse("joint+first_surface")))
    assert fits[2:] == [(plain, RequestedModel())]


@pytest.fixture(scope="module")
def figure(tmp_path_factory: pytest.TempPathFactory) -> Figure:
    path = tmp_path_factory.mktemp("figure") / "residuals.png"
    return drawn(lambda: residual_figure(sound_calibration(), path), path)


def test_an_arrow_for_every_cell_of_every_view(figure: Figure) -> None:
    calibration = sound_calibration()
    arrows = [item for item in figure.axes[0].collections if isinstance(item, Quiver)]
    views = np.unique(calibration.observations.view)
    assert len(arrows) == len(views) == 5
    for item, view in zip(arrows, views, strict=True):
        means = cell_means(calibration, int(view))
        assert np.allclose(item.get_offsets(), means.centres_px)
        drawn_px, mean_px = np.hypot(item.U, item.V), np.linalg.norm(means.mean_px, axis=1)
        assert np.allclose(drawn_px / drawn_px.max(), mean_px / mean_px.max())


def test_all_residuals_that_count_are_in_the_distribution(figure: Figure) -> None:
    calibration = sound_calibration()
    used = int(calibration.inliers.sum())
    assert figure.axes[1].get_title().startswith(f"{used} corners")
    assert len(figure.axes[1].patches) == 2


def test_the_same_calibration_gives_the_same_picture(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        residual_figure(sound_calibration(), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


FRAMES = 150


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """150 frames of 64 x 48 px; every second is sharp, and the number of each frame is its brightness."""
    folder = tmp_path_factory.mktemp("clip")
    texture = np.random.default_rng(0).uniform(-40.0, 40.0, (48, 64))
    paths = []
    for number in range(FRAMES):
        grey = 60.0 + number + gaussian_filter(texture, 0.6 if number % 2 == 1 else 2.5)
        paths.append(folder / f"{number:03d}.jpg")
        write_image(paths[-1], np.repeat(np.clip(grey, 0, 255)[:, :, None], 3, axis=2).astype(np.uint8))
    write_mjpeg(folder / "clip.avi", paths, 30.0, lambda done: None)
    return folder / "clip.avi"


def test_sharp_frames_represent_a_video_among_pictures(clip: Path) -> None:
    said: list[str] = []
    picture = clip.with_name("007.jpg")
    taken = calibration_pictures([picture, clip], 30, on_note=said.append)
    assert taken.pictures[0] == picture
    assert taken.names[0] == "007.jpg"
    numbers = [int(name.removeprefix("clip.avi frame ")) for name in taken.names[1:]]
    assert len(numbers) <= SEARCHED_FRAMES
    assert all(number % 2 == 1 for number in numbers)
    assert numbers == sorted(numbers)
    for number, grey in zip(numbers, taken.read()[1:], strict=True):
        assert grey.shape == (48, 64)
        assert abs(grey.mean() - 60.0 - number) < 2.0
    assert taken.max_pictures == 30
    assert said[0].startswith(f"clip.avi: the {len(numbers)} sharpest of 150 frames, from all of the video, read in ")


def test_a_raw_bag_of_the_camera_is_read_like_a_video(clip: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags, of the extra robot")
    said: list[str] = []
    files = sorted(clip.parent.glob("*.jpg"))
    bag = write_bag(tmp_path / "bag", [compressed(file.read_bytes(), "jpeg") for file in files])
    taken = calibration_pictures([bag], 30, on_note=said.append)
    for name, grey in zip(taken.names, taken.read(), strict=True):
        number = int(name.removeprefix("bag frame "))
        assert number % 2 == 1
        assert np.array_equal(grey, read_image(files[number], grey=True))
    assert said[0].startswith(f"bag: the {len(taken.names)} sharpest of 150 frames, from all of the video, read in ")


def test_frames_that_a_variable_rate_leaves_out_are_not_called_damaged(tmp_path: Path) -> None:
    path, said = tmp_path / "slow.mkv", list[str]()
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for moment in (0, 1, 2, 6, 7, 8):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 20 * moment, np.uint8)).reformat(format="yuv420p")
            frame.pts, frame.time_base = moment, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    calibration_pictures([path], 30, on_note=said.append)
    assert said[0].startswith(
        "slow.mkv: the 6 sharpest of 6 frames, from all of the video, 3 more missing according to its time stamps"
    )


def test_pictures_alone_are_all_used(clip: Path) -> None:
    taken = calibration_pictures([clip.with_name("001.jpg")], 30, on_note=lambda sentence: None)
    assert taken.max_pictures is None


def test_a_video_of_another_size_or_none_is_refused(clip: Path, tmp_path: Path) -> None:
    camera = Camera(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0)
    with pytest.raises(InputError, match="64x48 px, expected 640x480 of the layout's camera"):
        calibration_pictures([clip], 30, camera=camera, on_note=lambda sentence: None)
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(InputError, match="not a video that can be opened"):
        calibration_pictures([tmp_path / "text.mp4"], 30, on_note=lambda sentence: None)


@pytest.mark.parametrize("name", ["corners.csv", "corners.vnl"])
def test_a_table_of_corners_among_pictures_is_refused_with_its_option(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("# filename x y level\n")
    with pytest.raises(InputError, match=r"a table of corners, expected pictures: give it with --corners"):
        calibration_pictures([tmp_path / name], 30, on_note=print)


@pytest.mark.parametrize("name", ["a.mp4", "2026-11-26T10:30:05.mkv"])
def test_what_to_know_of_a_video_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    write_h264(tmp_path / name, pictures(3), interlaced=True)
    said: list[str] = []
    taken = calibration_pictures([Path(name)], 30, on_note=said.append)
    assert len(taken.pictures) == 3
    assert [line.startswith(f"{name} is interlaced: ") for line in said] == [True, False]
    assert len(taken.adjacent([1])) == 1


@pytest.mark.slow
def test_a_board_moved_by_hand_before_two_mirrors(two_mirror_video: Path, tmp_path: Path) -> None:
    """A flexing paper with hands over it, cut by the frame: planes, camera and board come out without help."""
    (tmp_path / "board.toml").write_text('kind = "checkerboard"\ncols = 8\nrows = 6\nsquare_mm = 25.0\n')
    request = CalibrationRequest(board=tmp_path / "board.toml", direct_view=2)
    found = calibrate_files([two_mirror_video], request)
    assert found.diagnostics is not None
    assert {"bow", "board"} < set(found.diagnostics.model_name.split("+"))
    for axis in "xy":
        assert found.metrics[f"rms_{axis}_px"].value < 0.25
    assert found.metrics["corners"].value > 2000
    assert found.metrics["outliers"].value < 0.05 * found.metrics["corners"].value
    assert found.metrics["mirrors_0_1_angle_deg"].value == pytest.approx(90.0, abs=0.5)
    assert 0.0 < found.metrics["mirrors_0_1_angle_sigma_deg"].value < 0.1
    assert found.notes[0].startswith("30 of 60 pictures used: first_200_frames.mp4 frames ")


@pytest.mark.slow
def test_a_smaller_board_than_stated_is_refused_by_its_size(two_mirror_video: Path, tmp_path: Path) -> None:
    """Parts of what is seen are taken for the stated board, which leads to mirrors that overlap."""
    (tmp_path / "board.toml").write_text('kind = "checkerboard"\ncols = 8\nrows = 7\nsquare_mm = 25.0\n')
    request = CalibrationRequest(board=tmp_path / "board.toml", direct_view=2)
    with pytest.raises(InputError, match=r"show a checkerboard of 8 x 6 squares, board says 8 x 7"):
        calibrate_files([two_mirror_video], request)
