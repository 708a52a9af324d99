"""What counts as resolved on the chart."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.light_field_super import (
    FREQUENCIES,
    contrasts,
    ideal_views,
    psnr,
    resolved,
    shift_and_add,
    true_chart,
)
from mirrorcam.optics.light_field.render.refocusing import FocalPlane


def test_the_chart_itself_is_resolved_as_far_as_a_picture_holds() -> None:
    for scale, least in ((1.5, 0.72), (2.0, 0.96)):
        true = true_chart(scale).astype(np.float32)
        for found in contrasts(true, scale).values():
            assert least <= resolved(found, scale) <= 0.5 * scale
            np.testing.assert_allclose(found[0][0], np.sinc(FREQUENCIES[0] / scale), atol=0.04)
        assert psnr(true, true_chart(scale)) > 100.0


def test_aliasing_is_not_taken_for_resolution() -> None:
    # Pixels of a view, repeated: contrast stays beyond .5, of the wrong waves.
    repeated = cv2.resize(true_chart(1.0), None, fx=2.0, fy=2.0, interpolation=cv2.INTER_NEAREST).astype(np.float32)
    for found in contrasts(repeated, 2.0).values():
        assert resolved(found, 2.0) <= 0.54


def test_views_apart_by_parts_of_a_pixel_show_more_than_one() -> None:
    depth_mm = 415.0  # 2.56 px from view to view
    light_field = ideal_views(depth_mm, 1.0)
    picture = shift_and_add(light_field, FocalPlane.at_depth(light_field, depth_mm), 2.0)
    assert resolved(contrasts(picture, 2.0)["star"], 2.0) > 0.6
