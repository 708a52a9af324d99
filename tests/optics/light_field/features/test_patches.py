"""Patches of keypoints: which can be localised, and how they change."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from mirrorcam.optics.light_field.features.image_pyramid import ImagePyramid
from mirrorcam.optics.light_field.features.patches import SAMPLES, templates


def test_patches_without_contrast_or_with_an_edge_alone_are_left_out() -> None:
    picture = np.full((1, 1, 180, 260), 90, np.uint8)
    picture[..., 90:, :] = 160
    picture[..., 30:40, 30:40] = 200
    pixels = np.array([[200.0, 40.0], [150.0, 90.0], [30.0, 30.0]])
    made = templates(ImagePyramid(picture), 0, pixels, np.ones(3))
    assert [each.index.tolist() for each in made] == [[2]]


def test_gradients_are_the_changes_by_moves_beyond_light() -> None:
    random = np.random.default_rng(1)
    image = np.rint(128 + 300 * gaussian_filter(random.standard_normal((80, 90)), 2.0)).clip(0, 255).astype(np.uint8)
    pyramid, pixels = ImagePyramid(image[None, None]), random.uniform(25, 55, (20, 2))
    here = templates(pyramid, 0, pixels, np.ones(20))[0]
    for axis in (0, 1):
        step = np.eye(2)[axis] * 0.1
        ahead, back = (templates(pyramid, 0, pixels + sign * step, np.ones(20))[0].patches for sign in (1, -1))
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
