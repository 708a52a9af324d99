"""Depth of a live session, as a picture and as numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import simplejpeg

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.studio.live.depth import LiveDepth
from tests.studio.live.live_sets import frame, small


def test_a_plane_has_its_depth_in_colour_and_in_millimetres(tmp_path: Path, default_layout: Layout) -> None:
    layout = small(default_layout)
    layout.save(tmp_path / "layout.json")
    live_depth = LiveDepth(tmp_path / "layout.json", 120)
    samples = np.asarray(Decoder(layout, width_px=120).decode(frame(layout, 420.0)).samples, np.uint8)
    found = live_depth.measure(samples)
    assert found.median_mm == pytest.approx(420.0, rel=0.02)
    known = found.depth_mm > 0
    assert known.mean() > 0.5 and np.median(found.depth_mm[known]) == pytest.approx(420.0, rel=0.02)
    picture = simplejpeg.decode_jpeg(found.jpeg)
    assert picture.shape[:2] == found.depth_mm.shape
    again = live_depth.measure(samples)
    assert again.median_mm == pytest.approx(found.median_mm, rel=0.01)


def test_what_has_no_texture_has_no_depth(tmp_path: Path, default_layout: Layout) -> None:
    layout = small(default_layout)
    layout.save(tmp_path / "layout.json")
    decoder = Decoder(layout, width_px=120)
    samples = np.full((*decoder.weights.shape, 3), 90, np.uint8)
    found = LiveDepth(tmp_path / "layout.json", 120).measure(samples)
    assert (found.depth_mm > 0).mean() < 0.2
