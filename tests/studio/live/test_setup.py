"""Alignment and hints of a live session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.alignment.alignment import Alignment
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.live.setup import LiveSetup, camera_words
from tests.small_set import BOARD
from tests.studio.live.live_sets import frame, small

BOARD_TOML = 'kind = "charuco"\ncols = 8\nrows = 6\nsquare_mm = 30.0\nmarker_mm = 22.5\n'


@pytest.fixture
def layout(tmp_path: Path, default_layout: Layout) -> Path:
    small(default_layout).save(tmp_path / "layout.json")
    return tmp_path / "layout.json"


@pytest.mark.slow
def test_a_device_as_designed_is_reported_as_straight(layout: Path) -> None:
    setup = LiveSetup(layout, None)
    frames = tuple(frame(setup.layout, 400.0, shift)[..., 0] for shift in (0.0, 5.0, 11.0))
    report = setup.align(frames, restart=True)
    assert report.names == setup.layout.mirror_names and len(report.edges) == len(report.scene) == 9
    assert all(0.0 < sigma < 1.0 for tilt in report.scene for sigma in tilt.sigma_deg)
    assert report.camera.startswith("camera turned ")
    assert len(report.designed_px) == len(report.seen_px)
    again = setup.align(frames, restart=False)
    assert again.edges[4].sigma_deg == pytest.approx(report.edges[4].sigma_deg, rel=0.1)


def test_how_the_camera_sits_in_words() -> None:
    turn, sigma = np.array([0.41, -0.22, 1.0]), np.array([0.1, 0.2, 0.3])
    told = Alignment("edges", (), np.zeros(3), np.zeros(3), turn, sigma)
    assert camera_words(told) == "camera turned 0.2° left (±0.2°), 0.4° up (±0.1°), rolled 1.0° clockwise (±0.3°)"
    untold = Alignment("scene", (), np.zeros(3), np.zeros(3), np.full(3, np.nan), sigma)
    assert camera_words(untold) == "camera orientation not determined"


def test_a_picture_without_the_board_gives_the_first_hint(tmp_path: Path, layout: Path) -> None:
    (tmp_path / "board.toml").write_text(BOARD_TOML, encoding="utf-8")
    setup = LiveSetup(layout, tmp_path / "board.toml")
    write_image(tmp_path / "a.png", frame(setup.layout))
    hint = setup.add_picture(tmp_path / "a.png")
    assert (hint.picture, hint.views, hint.corners) == ("a.png", 0, 0)
    assert hint.sentence.startswith("next: the board at about")
    assert BOARD.cols == 8
