"""The image pyramid: levels of scales, and samples of single views."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.features.patches import RADIUS_PX, SAMPLES, WIDE, ImagePyramid, templates


def test_a_scale_is_on_the_nearest_level_of_half_its_size() -> None:
    pyramid = ImagePyramid(np.zeros((3, 3, 180, 260), np.uint8))
    assert pyramid.level_of(np.array([1.0, 2.8, 3.0, 4.0, 8.0, 1000.0])).tolist() == [0, 0, 1, 1, 2, 3]


def test_samples_follow_the_cubic_spline_through_the_pixels() -> None:
    """Against SciPy's, except at the rim, where it uses another spline."""
    random = np.random.default_rng(4)
    image = np.rint(gaussian_filter(random.uniform(0, 1000, (60, 80)), 0.7)).clip(0, 255).astype(np.uint8)
    pyramid = ImagePyramid(image[None, None])
    u, v = (random.uniform(15, size - 15, (50, 7)).astype(np.float32) for size in (80, 60))
    across, down = pyramid.origins[0][0]
    expected = map_coordinates(image.astype(np.float64), [v, u], order=3)
    assert np.abs(pyramid.samples(0, u + across, v + down) - expected).max() < 0.02


@pytest.mark.parametrize("level", [0, 1])
def test_a_ramp_is_sampled_at_its_pixels_on_every_level(level: int) -> None:
    """Pixel x of level l is pixel x * 2**l of the view, and smoothing does not change a ramp."""
    across, down = np.meshgrid(np.arange(60), np.arange(40))
    pyramid = ImagePyramid(np.stack([across + 2 * down, 200 - across]).astype(np.uint8)[None])
    at = np.array([[11.5, 7.0], [12.0, 8.25]], np.float32)
    in_view = at * 2**level
    for view, expected in enumerate((in_view @ [1.0, 2.0], 200.0 - in_view[:, 0])):
        place = at + pyramid.origins[level][view]
        np.testing.assert_allclose(pyramid.samples(level, place[:, :1], place[:, 1:])[:, 0], expected, atol=0.05)


def test_a_patch_at_the_rim_of_a_view_shows_nothing_of_its_neighbour() -> None:
    images = np.zeros((1, 2, 40, 60), np.uint8)
    images[0, 1] = 255
    pyramid = ImagePyramid(images)
    u = pyramid.origins[0][0, 0] + 59 + np.arange(-RADIUS_PX, RADIUS_PX + 1, dtype=np.float32)[None]
    v = np.full_like(u, pyramid.origins[0][0, 1] + 20)
    assert (pyramid.samples(0, u, v) == 0).all()


def test_views_too_large_for_tables_are_refused() -> None:
    with pytest.raises(InputError, match=r"100x1 views of 40x400 px, which must be less than 32767 px side by side"):
        ImagePyramid(np.zeros((100, 1, 400, 40), np.uint8))


def test_patches_without_contrast_or_with_an_edge_alone_are_left_out() -> None:
    picture = np.full((1, 1, 180, 260), 90, np.uint8)
    picture[..., 90:, :] = 160
    picture[..., 30:40, 30:40] = 200
    pixels = np.array([[200.0, 40.0], [150.0, 90.0], [30.0, 30.0]])
    made = templates(ImagePyramid(picture), 0, pixels, np.ones(3), WIDE)
    assert [each.index.tolist() for each in made] == [[2]]


def test_gradients_are_the_changes_by_moves_beyond_light() -> None:
    random = np.random.default_rng(1)
    image = np.rint(128 + 300 * gaussian_filter(random.standard_normal((80, 90)), 2.0)).clip(0, 255).astype(np.uint8)
    pyramid, pixels = ImagePyramid(image[None, None]), random.uniform(25, 55, (20, 2))
    here = templates(pyramid, 0, pixels, np.ones(20), WIDE)[0]
    for axis in (0, 1):
        step = np.eye(2)[axis] * 0.1
        ahead, back = (templates(pyramid, 0, pixels + sign * step, np.ones(20), WIDE)[0].patches for sign in (1, -1))
        change = (ahead - back) / 0.2
        cosine = np.einsum("np,np->n", change, here.gradients[:, axis])
        cosine /= np.linalg.norm(change, axis=1) * np.linalg.norm(here.gradients[:, axis], axis=1)
        assert np.median(cosine) > 0.9
    moves = here.steps @ here.gradients.transpose(0, 2, 1)
    assert np.allclose(moves, np.eye(2), atol=1e-3)
    assert np.abs(here.gradients.sum(axis=2)).max() < 1e-3
    assert np.abs(np.einsum("nkp,np->nk", here.gradients, here.patches)).max() < 1e-3
    flat = here.shapes.reshape(20, -1, SAMPLES)
    assert np.abs(flat @ here.gradients.transpose(0, 2, 1)).max() < 1e-2 * np.abs(flat).max() * SAMPLES
