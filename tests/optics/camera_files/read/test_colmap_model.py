"""Damaged models are refused in one line, wherever they end."""

from __future__ import annotations

import shutil
import struct
import time
from contextlib import suppress
from pathlib import Path

import pycolmap
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.camera_files.read.colmap_model import MODELS, read_model


@pytest.fixture(scope="module")
def binary(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model")
    pycolmap.Reconstruction(exported / "colmap" / "sparse").write_binary(folder)
    return folder


def test_numbers_of_models_are_colmaps() -> None:
    for number, (name, count) in MODELS.items():
        assert int(getattr(pycolmap.CameraModelId, name)) == number
        size = pycolmap.Camera.create_from_model_name(1, name, 500.0, 640, 480).params_info.count(",") + 1
        assert size == count


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "rigs.bin"])
def test_a_file_that_ends_early_is_refused(name: str, binary: Path, tmp_path: Path) -> None:
    shutil.copytree(binary, tmp_path / "cut")
    raw = (binary / name).read_bytes()
    for length in range(0, len(raw), 7):
        (tmp_path / "cut" / name).write_bytes(raw[:length])
        with pytest.raises(InputError) as caught:
            read_model(tmp_path / "cut")
        assert "\n" not in str(caught.value)
        assert "not what COLMAP writes" in str(caught.value)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "rigs.bin"])
def test_a_count_beyond_the_file_is_refused_before_anything_is_read(name: str, binary: Path, tmp_path: Path) -> None:
    shutil.copytree(binary, tmp_path / "many")
    raw = (binary / name).read_bytes()
    (tmp_path / "many" / name).write_bytes(struct.pack("<Q", 2**60) + raw[8:])
    with pytest.raises(InputError, match="items in"):
        read_model(tmp_path / "many")


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("cameras.txt", "1 PINHOLE 640 480 1 2 3\n", "camera 1: 3 parameters, expected 4"),
        ("cameras.txt", "1 PINHOLE 640 480 1 2 3 inf\n", "not finite"),
        ("cameras.txt", "1 PINHOLE 0 480 1 2 3 4\n", "camera 1 is 0 x 480 px"),
        ("cameras.txt", "one PINHOLE 640 480 1 2 3 4\n", "not what COLMAP writes"),
        ("images.txt", "1 1 1 0 0 0 0 0 1 a/b.png\n\n", "quaternion not of length 1"),
        ("images.txt", "1 1 0 0\n\n", "not what COLMAP writes"),
        ("images.txt", "1 nan 0 0 0 0 0 0 1 a/b.png\n\n", "not finite"),
        ("rigs.txt", "1 2 CAMERA\n", "not what COLMAP writes"),
    ],
)
def test_text_that_is_no_model_is_refused(name: str, text: str, complaint: str, exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "colmap" / "sparse", tmp_path / "model")
    (tmp_path / "model" / name).write_text(text)
    with pytest.raises(InputError) as caught:
        read_model(tmp_path / "model")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_of_pictures_may_hold_blanks(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "colmap" / "sparse", tmp_path / "model")
    path = tmp_path / "model" / "images.txt"
    path.write_text(path.read_text().replace("0000.png", "my picture.png"))
    assert read_model(tmp_path / "model").images[0].name == "view_0_0/my picture.png"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("rigs.txt", b"1 2 CAMERA 1 " + b"CAMERA 1 0 " * 200_000),
        ("images.txt", b"\n" * 400_000),
        ("images.txt", b"1 1 0 0 0 0 0 0 1 a/b.png\n\n" * 200_000),
        ("images.bin", struct.pack("<Q", 200_000) + (struct.pack("<I7dI", 1, 1, *[0] * 6, 1) + bytes(9)) * 200_000),
    ],
)
def test_a_model_takes_no_more_time_than_a_large_one(
    name: str, content: bytes, exported: Path, binary: Path, tmp_path: Path
) -> None:
    shutil.copytree(exported / "colmap" / "sparse" if name.endswith(".txt") else binary, tmp_path / "model")
    (tmp_path / "model" / name).write_bytes(content)
    begun = time.process_time()
    with suppress(InputError):
        read_model(tmp_path / "model")
    assert time.process_time() - begun < 1.0
