"""A layout, its decoder, and a video with a damaged frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.recording import Folders, Recording, Sink, about
from tests.core.video.videos import damage, pictures, write_mjpeg
from tests.optics.layouts import faceted_parabola

COUNT = 20


DAMAGED = 7


@pytest.fixture(scope="session")
def layout() -> Layout:
    """3 x 3 views of a small camera."""
    camera = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    return faceted_parabola(camera, DesignSpec(camera=camera), fill=0.9)


@pytest.fixture(scope="session")
def decoder(layout: Layout) -> Decoder:
    return Decoder(layout)


@pytest.fixture(scope="session")
def video(tmp_path_factory: pytest.TempPathFactory) -> Video:
    """A webcam's video with one damaged frame."""
    path = write_mjpeg(tmp_path_factory.mktemp("video") / "a.avi", pictures(COUNT, 320, 192))
    damage(path, DAMAGED)
    return Video(path)


def begin(path: Path, decoder: Decoder, sink: Sink, **changes: Any) -> Recording:
    return Recording(path, about(decoder.views, {"sha256": "feed"}, **changes), sink)


def npz_folders() -> Folders:
    return Folders(lambda folder, light_field: save_npz(folder / "light_field.npz", light_field))
