"""Pictures become light fields in one call, which prints nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.optics.base.files import write_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.npz import load_npz
from mirrorcam.workflow.decoding import EQUALISATION, DecodeRequest, decode_files
from tests.optics.layouts import faceted_parabola
from tests.optics.light_field.io.videos import pictures


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with layout.json and two frames."""
    camera = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    layout = faceted_parabola(camera, DesignSpec(camera=camera), fill=0.9).replaced(kind="calibrated")
    layout.save(tmp_path / "layout.json")
    for name, picture in zip(("a", "b"), pictures(2, 320, 192), strict=True):
        write_image(tmp_path / f"{name}.png", picture)
    return tmp_path


def test_light_fields_are_those_of_the_decoder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    request = DecodeRequest(folder / "layout.json", frames=(folder / "a.png", folder / "b.png"), width_px=60)
    decode_files(request, folder / "out")
    assert capsys.readouterr().out == ""
    names = sorted(path.name for path in (folder / "out").iterdir())
    assert names == ["a.npz", "a_views.png", "b.npz", "b_views.png"]
    decoder = Decoder(Layout.load(folder / "layout.json"), width_px=60)
    expected = decoder.decode(pictures(2, 320, 192)[1])
    assert np.array_equal(load_npz(folder / "out" / "b.npz").samples, expected.samples)


def test_factors_are_written_where_they_are_measured_and_read_where_they_are_given(folder: Path) -> None:
    write_image(folder / "a.png", np.full((192, 320, 3), 180, np.uint8))
    frames = (folder / "a.png",)
    decode_files(DecodeRequest(folder / "layout.json", frames=frames, equalise=frames), folder / "one")
    assert (folder / "one" / EQUALISATION).exists()
    known = (folder / "one" / EQUALISATION,)
    decode_files(DecodeRequest(folder / "layout.json", frames=frames, equalise=known), folder / "two")
    assert not (folder / "two" / EQUALISATION).exists()
    assert (folder / "one" / "a.npz").read_bytes() == (folder / "two" / "a.npz").read_bytes()


def test_one_bad_frame_stops_all_before_anything_is_written(folder: Path) -> None:
    write_image(folder / "small.png", np.zeros((10, 10, 3), np.uint8))
    request = DecodeRequest(folder / "layout.json", frames=(folder / "a.png", folder / "small.png"))
    with pytest.raises(InputError, match=r"small\.png: 10x10 px, expected 320x192"):
        decode_files(request, folder / "out")
    assert not (folder / "out").exists()
