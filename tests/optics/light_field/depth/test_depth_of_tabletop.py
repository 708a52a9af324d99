"""Depth of a tabletop scene photographed through mirrors as built, against its truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest, read_map, render_tabletop


@pytest.mark.slow
def test_depth_is_within_a_percent_of_range_at_working_depths(default_layout: Layout, tmp_path: Path) -> None:
    manifest = render_tabletop(TabletopRequest(layout=default_layout, seed=3, spp=16), tmp_path)
    layout = Layout.load(tmp_path / "truth/layout.json")
    light_field = Decoder(layout).decode(read_image(tmp_path / manifest.frame_name))
    found = DepthEstimator(light_field).estimate(light_field)
    t, s = manifest.central_view
    truth = read_map(tmp_path / f"truth/depth/{t}_{s}.exr", "depth")
    part = np.abs(found.depth_mm - truth) / truth
    working = found.valid & (truth >= 300.0) & (truth <= 500.0)
    # The required figure is 1 %, including glossy and glass objects.
    assert np.median(part[working]) < 0.002
    assert np.quantile(part[working], 0.8) < 0.01
    sure = found.valid & (found.confidence > 0.5)
    assert sure.mean() > 0.6
    assert np.mean(part[sure] > 0.02) < 0.05
