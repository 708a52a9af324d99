"""`mirrorcam camera export`: the files that other tools read, from a layout and pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.geometry.layout import Layout


@pytest.fixture
def layout_file(tmp_path: Path, small_layout: Layout) -> Path:
    small_layout.save(tmp_path / "layout.json")
    return tmp_path / "layout.json"


def test_a_layout_and_a_folder_of_pictures_are_exported(
    layout_file: Path, small_layout: Layout, tmp_path: Path
) -> None:
    camera = small_layout.camera
    frame = np.random.default_rng(0).integers(0, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    write_image(tmp_path / "frames" / "0007.png", frame)
    out = tmp_path / "cameras"
    assert main(["camera", "export", str(layout_file), "--pictures", str(tmp_path / "frames"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} >= {"opencv.yaml", "ros", "colmap", "nerfstudio", "README.md"}
    views = sorted((out / "colmap" / "images").iterdir())
    assert len(views) == len(small_layout.mirrors)
    assert read_image(views[0] / "0007.png").shape == frame.shape


def test_a_picture_of_another_camera_is_refused(
    layout_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_image(tmp_path / "small.png", np.zeros((48, 64, 3), dtype=np.uint8))
    arguments = ["camera", "export", str(layout_file), "--pictures", str(tmp_path / "small.png")]
    assert main([*arguments, "--out", str(tmp_path / "cameras")]) == 2
    assert "small.png" in capsys.readouterr().err


def test_a_video_is_refused_with_what_is_taken(
    layout_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "clip.mp4").write_bytes(b"")
    arguments = ["camera", "export", str(layout_file), "--pictures", str(tmp_path / "clip.mp4")]
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    assert (
        "clip.mp4: not a picture, expected PNG, JPEG, TIFF or BMP frames or folders of them" in capsys.readouterr().err
    )
