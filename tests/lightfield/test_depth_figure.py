"""The picture of a depth map shows nearness where depth is known, with a scale in mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.lightfield.depth_figure import draw_depth
from mirrorcam.optics.light_field.depth import DepthMap
from tests.drawn import drawn, values_of
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


def test_view_nearness_and_confidence_stand_beside_each_other(tmp_path: Path) -> None:
    light_field, true_mm, _ = photograph(grid_views(), [Surface(500.0)])
    depth_mm = true_mm.astype(np.float32)
    depth_mm[:, : depth_mm.shape[1] // 2] *= 0.8
    depth_mm[:4] = np.nan
    confidence = np.where(np.isfinite(depth_mm), np.float32(0.9), np.float32(0.0))
    depth = DepthMap(
        views=light_field, view=(1, 1), depth_mm=depth_mm, sigma_mm=np.ones_like(depth_mm), confidence=confidence
    )
    figure = drawn(lambda: draw_depth(tmp_path / "depth.png", light_field, depth), tmp_path / "depth.png")
    view, nearness, sure = (values_of(axes.images[0]) for axes in figure.axes[:3])
    assert np.array_equal(view[..., 0], light_field.samples[1, 1, ..., 0])
    known = np.isfinite(depth_mm)
    assert np.array_equal(~np.ma.getmaskarray(np.ma.masked_invalid(nearness)), known)
    assert np.allclose(np.asarray(nearness)[known], 1.0 / depth_mm[known])
    assert np.allclose(np.asarray(sure)[known], 0.9)
    labels = [label.get_text() for label in figure.axes[3].get_yticklabels()]
    assert float(labels[0]) == pytest.approx(np.nanmax(depth_mm), rel=0.02)
    assert float(labels[-1]) == pytest.approx(np.nanmin(depth_mm), rel=0.02)
