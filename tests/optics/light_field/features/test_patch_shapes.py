"""Shapes of surfaces under patches, against planes of known slants."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.light_field.features.align import align
from mirrorcam.optics.light_field.features.image_pyramid import ImagePyramid
from mirrorcam.optics.light_field.features.keypoints import grey_views
from mirrorcam.optics.light_field.features.patches import templates
from mirrorcam.optics.light_field.features.slope import Geometry
from tests.optics.light_field.features.scenes import of_planes, uneven_views


@pytest.mark.parametrize("slants", [(0.0, 0.0), (1.0, -0.6)])
def test_slants_are_those_of_the_plane(slants: tuple[float, float]) -> None:
    """w = (1 - slants.a) / d of a plane Z = d + slants.(X, Y)."""
    views, distance = uneven_views(), 450.0
    light_field, _ = of_planes(views, [(distance, slants, None, 1)])
    images = grey_views(light_field)
    geometry, pyramid = Geometry.of(views), ImagePyramid(images.reshape(3, 3, *images.shape[1:]))
    pixels = np.stack(np.meshgrid(np.arange(90.0, 171.0, 8.0), np.arange(60.0, 121.0, 8.0)), axis=-1).reshape(-1, 2)
    directions = geometry.directions(pixels)
    inverse_mm = (1.0 - directions @ np.array(slants)) / distance
    start = np.stack([geometry.predict(view, directions, inverse_mm) for view in range(9)])
    given = templates(pyramid, 4, pixels, np.full(len(pixels), 2.0))
    found = align(pyramid, given, np.arange(9), start, geometry.across_mm, 1.0 / inverse_mm)
    chosen = given[0].index
    error = found.shapes[chosen, :2] * distance + slants
    assert np.median(np.abs(error)) < 0.12
    # Nothing is curved; and moves across epipolar lines, of which there are none, tell small residuals.
    assert np.median(np.abs(found.shapes[chosen, 2:])) * distance < 0.12
    assert np.median(found.variance[chosen]) < 1e-3
    assert (np.linalg.eigvalsh(found.shape_covariance[chosen]) > -1e-12).all()
