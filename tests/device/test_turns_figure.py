"""The picture of turns: every screw with its number, of the same bytes each time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.images.pictures import read_image
from mirrorcam.device.turns_figure import turns_figure


def test_the_picture_is_drawn_alike_each_time_and_shows_the_turns(tmp_path: Path) -> None:
    square = np.array([(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)])
    screws = np.array([[(5.0, 5.0), (25.0, 5.0), (15.0, 15.0)]] * 2) + np.array([[[0.0, 0.0]], [[40.0, 0.0]]])
    turns = [np.array([0.1, -0.2, 0.0]), np.array([0.3, 0.0, -0.1])]
    outlines = [square, square + np.array([40.0, 0.0])]
    for name in ("a", "b"):
        turns_figure(["0-0", "0-1"], turns, outlines, screws, tmp_path / f"{name}.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    turns_figure(["0-0", "0-1"], [-turn for turn in turns], outlines, screws, tmp_path / "c.png")
    assert (read_image(tmp_path / "a.png") != read_image(tmp_path / "c.png")).any()
