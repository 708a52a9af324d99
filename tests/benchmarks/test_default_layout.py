"""Figures of the default design, against those by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import default_layout as benchmark
from mirrorcam.optics.geometry.layout import Layout


def test_widths_are_those_of_the_edges_nearest_and_farthest(default_layout: Layout) -> None:
    camera = default_layout.camera.replaced(aperture_mm=2.0, focus_mm=1000.0)
    depths = np.concatenate([mirror.outline_in_rig_mm[:, 2] for mirror in default_layout.mirrors])
    widths = (camera.fx_px / depths.max() - camera.fx_px / 1000.0, camera.fx_px / depths.min() - camera.fx_px / 1000.0)
    assert benchmark.faded_px(default_layout.replaced(camera=camera)) == pytest.approx(widths)
