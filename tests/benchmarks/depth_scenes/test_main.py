"""Scenes as folders: whole ones are left alone, interrupted ones go on, and views agree with the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.depth_scenes.__main__ import write_scene
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.formats.hci import read_hci
from mirrorcam.render_scenes.variant import SCALAR, use_variant

SIZE_PX = 64


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")
    place = tmp_path_factory.mktemp("scenes") / "slant"
    write_scene(place, "slant", count=3, size_px=SIZE_PX, spp=16)
    return place


def test_a_scene_is_in_the_benchmarks_format(folder: Path) -> None:
    scene = read_hci(folder)
    assert scene.light_field.samples.shape == (3, 3, SIZE_PX, SIZE_PX, 3)
    assert scene.disparity_px is not None
    # Of 64 px in place of 512, and four steps of the whole grid.
    assert np.abs(scene.disparity_px * (512 / SIZE_PX) / 4.0).max() < 2.1
    assert read_image(folder / "edges.png", grey=True).shape == (SIZE_PX, SIZE_PX)
    assert not folder.with_name("slant.part").exists()


def test_what_is_there_is_left_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    write_scene(folder, "slant", count=3, size_px=SIZE_PX, spp=16)
    assert capsys.readouterr().out == "slant: is there\n"
    assert before == {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    with pytest.raises(InputError, match="3x3 views of 64 px, asked for 5x5 of 64; name another folder"):
        write_scene(folder, "slant", count=5, size_px=SIZE_PX)


def test_an_interrupted_scene_goes_on_to_the_same_bytes(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    marked = np.zeros((SIZE_PX, SIZE_PX, 3), np.uint8)
    write_image(tmp_path / f"slant.part/-4-4_{SIZE_PX}_16.png", marked)
    write_scene(tmp_path / "slant", "slant", count=3, size_px=SIZE_PX, spp=16)
    again = [read_image(tmp_path / f"slant/input_Cam{number:03d}.png") for number in range(9)]
    first = [read_image(folder / f"input_Cam{number:03d}.png") for number in range(9)]
    assert np.array_equal(again[0], marked)
    assert all(np.array_equal(one, two) for one, two in zip(again[1:], first[1:], strict=True))
    assert "warped views differ by" in capsys.readouterr().out


def test_views_agree_with_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")
    write_scene(tmp_path / "slant", "slant", count=3, size_px=96, spp=64)
    said = capsys.readouterr().out
    assert float(said.split("differ by ")[1].split()[0]) < 2.0
