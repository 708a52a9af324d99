"""Pictures become light fields in one call, which prints nothing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirrorcam.calibration.drift_check import DRIFT, drift_check
from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.lightfield.decoding import EQUALISATION, decode_files, evenly_spaced, read_undamaged
from mirrorcam.lightfield.requests import DecodeRequest
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth
from mirrorcam.optics.light_field.io.formats.npz import load_npz
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.robot.rerun_viewer import RerunViewer
from tests.command_line import results
from tests.core.video.videos import RATE, pictures, write_mjpeg
from tests.optics.drift.calibrated_device import device, turned
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene
from tests.optics.layouts import faceted_parabola


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with layout.json and two frames."""
    camera = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    layout = faceted_parabola(camera, DesignSpec(camera=camera), fill=0.9).replaced(kind="calibrated")
    layout.save(tmp_path / "layout.json")
    for name, picture in zip(("a", "b"), pictures(2, 320, 192), strict=True):
        write_image(tmp_path / f"{name}.png", picture)
    return tmp_path


def decoded(frames: Sequence[Path], out: Path, layout: str = "layout.json", **settings: Any) -> int:
    """Decode with a layout in the folder above `out`."""
    request = DecodeRequest(**settings)
    return decode_files(frames, out, request, TERMINAL, layout=out.parent / layout, make_check=drift_check)


def test_light_fields_are_those_of_the_decoder(folder: Path) -> None:
    assert decoded((folder / "a.png", folder / "b.png"), folder / "out", width_px=60) == 0
    names = results(folder / "out")
    assert names == ["a.npz", "a_views.png", "b.npz", "b_views.png", DRIFT]
    decoder = Decoder(Layout.load(folder / "layout.json"), width_px=60)
    expected = decoder.decode(pictures(2, 320, 192)[1])
    assert np.array_equal(load_npz(folder / "out" / "b.npz").samples, expected.samples)


def test_factors_are_written_where_they_are_measured_and_read_where_they_are_given(folder: Path) -> None:
    write_image(folder / "a.png", np.full((192, 320, 3), 180, np.uint8))
    frames = (folder / "a.png",)
    decoded(frames, folder / "one", equalise=frames)
    assert (folder / "one" / EQUALISATION).exists()
    known = (folder / "one" / EQUALISATION,)
    decoded(frames, folder / "two", equalise=known)
    assert not (folder / "two" / EQUALISATION).exists()
    assert (folder / "one" / "a.npz").read_bytes() == (folder / "two" / "a.npz").read_bytes()


def test_one_bad_frame_stops_all_before_anything_is_written(folder: Path) -> None:
    write_image(folder / "small.png", np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(InputError, match=r"small\.png: 10x10 px, expected 320x192"):
        decoded((folder / "a.png", folder / "small.png"), folder / "out")
    assert not (folder / "out").exists()


def test_a_damaged_picture_is_skipped_named_and_counted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    raw = (folder / "a.png").read_bytes()
    (folder / "a.png").write_bytes(raw[: len(raw) // 2])
    frames = (folder / "a.png", folder / "b.png")
    assert decoded(frames, folder / "out") == 1
    printed = capsys.readouterr().out
    assert f"{folder / 'a.png'}: image is truncated; skipped" in printed
    assert "1 of 2 pictures skipped as damaged" in printed
    assert results(folder / "out") == ["b.npz", "b_views.png", DRIFT]


def test_nothing_but_damaged_pictures_is_refused(folder: Path) -> None:
    for name in ("a", "b"):
        (folder / f"{name}.png").write_bytes(b"")
    frames = (folder / "a.png", folder / "b.png")
    with pytest.raises(InputError, match=r"a\.png: not an image .*; all pictures are damaged"):
        decoded(frames, folder / "out")
    assert not (folder / "out").exists()


def test_a_picture_rotated_by_its_exif_data_is_reported(folder: Path) -> None:
    turned = Image.fromarray(pictures(1, 192, 320)[0])
    exif = Image.Exif()
    exif[0x0112] = 6
    turned.save(folder / "turned.jpg", exif=exif)
    with pytest.raises(InputError, match=r"192x320 px as stored \(its EXIF data rotates it\), expected 320x192 of"):
        decoded((folder / "turned.jpg",), folder / "out")


@pytest.mark.slow
def test_a_moved_mirror_is_reported_with_the_command_that_recalibrates(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    random, truth = np.random.default_rng(1), device().truth
    sheets = scene(random, (250.0, 600.0), [fractal(random, slope=0.8)], truth.camera.fx_px)
    write_image(tmp_path / "frame.png", photograph(truth, sheets, Shot(), random))
    moved = turned(device().calibrated, 4, np.array([0.04, 0.0, 0.03]))
    for name, layout in (("moved", moved), ("still", device().calibrated)):
        layout.save(tmp_path / f"{name}.json")
        assert decoded((tmp_path / "frame.png",), tmp_path / name, f"{name}.json", width_px=60) == 0
        figures = json.loads((tmp_path / name / DRIFT).read_text())
        assert figures["mirrors_moved"]["value"] == (name == "moved")
    said = capfd.readouterr().out
    assert said.count("a mirror has moved since the calibration: 1-1 by 0.0") == 1
    assert f"mirrorcam drift FRAMES --layout {tmp_path / 'moved.json'} re-solves what moved" in " ".join(said.split())


def test_two_mirrors_without_a_test_are_reported(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    layout = Layout.load(folder / "layout.json")
    layout.replaced(rows=1, cols=2, mirrors=layout.mirrors[3:5], spec=None).save(folder / "two.json")
    assert decoded((folder / "a.png",), folder / "out", "two.json") == 0
    assert "not tested whether 2 mirrors moved: the test needs 3 or more" in capsys.readouterr().out
    assert not (folder / "out" / DRIFT).exists()


def test_an_epipolar_image_of_one_column_is_refused_before_anything_is_written(folder: Path) -> None:
    layout = Layout.load(folder / "layout.json")
    column = layout.replaced(rows=3, cols=1, mirrors=layout.mirrors[1::3], spec=None)
    column.save(folder / "column.json")
    with pytest.raises(InputError, match="only one view along s, expected two or more for an epipolar-plane image"):
        decoded((folder / "a.png",), folder / "out", "column.json", epi=True)
    assert not (folder / "out").exists()


def test_decoded_light_fields_are_shown_with_their_depth(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[tuple[float, LightField, DepthMap | None]] = []

    class Viewer:
        def show(self, time_s: float, light_field: LightField, depth: DepthMap | None) -> None:
            shown.append((time_s, light_field, depth))

    monkeypatch.setattr(RerunViewer, "opened", Viewer)
    write_mjpeg(folder / "video.avi", pictures(3, 320, 192))
    frames = tuple(folder / name for name in ("a.png", "b.png", "video.avi"))
    assert decoded(frames, folder / "out", view=True) == 0
    assert [time_s for time_s, _, _ in shown] == pytest.approx([0.0, 1.0, 0.0, 1 / RATE, 2 / RATE])
    assert np.array_equal(shown[1][1].samples, load_npz(folder / "out" / "b.npz").samples)
    assert all(depth is not None and depth.valid.any() for _, _, depth in shown)
    # Pictures are measured on their own, the frames of a video as such.
    estimator = DepthEstimator(shown[0][1], quality="fast")
    video = VideoDepth(estimator)
    expected = [estimator.estimate(each).depth_mm for _, each, _ in shown[:2]]
    expected += [video.estimate(each).depth_mm for _, each, _ in shown[2:]]
    for (_, _, depth), depth_mm in zip(shown, expected, strict=True):
        assert depth is not None
        assert np.array_equal(depth.depth_mm, depth_mm, equal_nan=True)
    shown.clear()
    assert decoded(frames[2:], folder / "plain", view=True, no_depth=True) == 0
    assert [depth for _, _, depth in shown] == [None] * 3


def test_pictures_are_spread_and_damaged_ones_left_out(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.png" for number in range(20)]
    assert evenly_spaced(paths)[0] == paths[0]
    assert evenly_spaced(paths)[-1] == paths[-1]
    assert len(evenly_spaced(paths)) == 8
    write_image(paths[0], np.zeros((4, 4, 3), np.uint8))
    paths[1].write_bytes(paths[0].read_bytes()[:-20])
    assert len(read_undamaged(paths[:2])) == 1
