"""Pixels well inside sub-images."""

from __future__ import annotations

import numpy as np
import shapely

from mirrorcam.optics.alignment.sub_image_masks import MARGIN_PX, sub_image_masks
from mirrorcam.optics.geometry.layout import Layout


def test_masks_are_inside_their_outlines_and_apart(default_layout: Layout) -> None:
    count = np.zeros((1080, 1920), int)
    for k, each in enumerate(sub_image_masks(default_layout)):
        assert each is not None and each.pixels > 50_000
        count[each.window] += each.mask > 0
        rows, columns = np.nonzero(each.mask)
        inner = shapely.Polygon(default_layout.outline_px(k)).buffer(-MARGIN_PX + 3.0)
        some = np.random.default_rng(k).integers(len(rows), size=200)
        x, y = columns[some] + each.window[1].start, rows[some] + each.window[0].start
        beyond = (x < MARGIN_PX) | (y < MARGIN_PX) | (x > 1919 - MARGIN_PX) | (y > 1079 - MARGIN_PX)
        assert (shapely.contains_xy(inner, x, y) | beyond).all()
    assert count.max() == 1


def test_a_mirror_that_shows_nothing_has_none(default_layout: Layout) -> None:
    assert all(each is None for each in sub_image_masks(default_layout, margin_px=600))
