"""Views between the views, against the light field that has them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.between_views import with_views_between
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus
from tests.optics.light_field.depth.surfaces import grid_views, photograph
from tests.optics.light_field.render.scenes import SCENE, inside, true_depths
from tests.optics.light_field.render.test_refocusing import psnr

COUNT = 3


def test_blur_is_that_of_as_many_real_views() -> None:
    few = grid_views(uneven=False)
    light_field = photograph(few, SCENE)[0]
    many = grid_views(2 * (COUNT + 1) + 1, 2 * (COUNT + 1) + 1, step_mm=20.0 / (COUNT + 1), uneven=False)
    dense = with_views_between(light_field, true_depths(few, SCENE), COUNT)
    np.testing.assert_allclose(dense.positions_mm, many.positions_mm, atol=1e-9)
    np.testing.assert_array_equal(dense.samples[:: COUNT + 1, :: COUNT + 1], light_field.samples)
    plane = FocalPlane.at_depth(few, 560.0 + few.reference_view_depth_mm)
    true = refocus(photograph(many, SCENE)[0], plane).image
    where = inside(true.shape[:2], 16)
    reached, sparse = (psnr(refocus(each, plane).image, true, where) for each in (dense, light_field))
    assert reached > 38.0
    assert reached > sparse + 8.0


def test_what_has_no_sample_stays_without() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    weights, samples = light_field.weights.copy(), light_field.samples.copy()
    weights[..., :50], samples[..., :50, :] = 0.0, 0
    part = LightField.of(views, samples, weights)
    dense = with_views_between(part, true_depths(views, SCENE), 1)
    assert (dense.weights[1, 1, :, :25] == 0).all()
    assert (dense.samples[1, 1, :, :25] == 0).all()
    assert (dense.weights[1, 1, :, -25:] == 1).all()


def test_too_many_views_are_refused() -> None:
    views = grid_views()
    light_field = photograph(views, SCENE)[0]
    with pytest.raises(InputError, match="401x401 views of 120x90 px, expected 200 million px at most"):
        with_views_between(light_field, true_depths(views, SCENE), 199)
