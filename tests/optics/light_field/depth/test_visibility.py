"""What views see first, against surfaces in closed form."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.depth.sweep import sweep
from mirrorcam.optics.light_field.depth.visibility import NOTHING, nearest_planes
from tests.optics.light_field.depth.surfaces import Surface, grid_views, met

INVERSE_DISTANCES = np.linspace(1 / 700.0, 1 / 300.0, 21)


def test_the_nearest_surface_is_the_one_that_rays_meet_first() -> None:
    views = grid_views()
    planes = sweep(views, INVERSE_DISTANCES)
    surfaces = [Surface(600.0), Surface(400.0, bounds=(-20.0, -20.0, 20.0, 20.0))]
    distance = met(views, (1, 1), views.pixel_grid(), surfaces)[1]
    own = ((1.0 / distance - INVERSE_DISTANCES[0]) / planes.step).astype(np.float32)
    found = nearest_planes(own, planes)
    others = [index for index in np.ndindex(3, 3) if index != (1, 1)]
    for view, index in enumerate(others):
        seen = met(views, index, views.pixel_grid(), surfaces)[1] + 0.0
        # Distances from the view's own plane to those from the reference view's: met() gives the latter.
        truth = (1.0 / seen - INVERSE_DISTANCES[0]) / planes.step
        known = found[view] > NOTHING
        assert known.mean() > 0.6
        near = truth > 10
        agree = np.abs(found[view] - truth) < 0.5
        # To a pixel at the card's edges.
        assert agree[known].mean() > 0.95
        assert agree[near].mean() > 0.9


def test_what_nothing_lands_on_hides_nothing() -> None:
    views = grid_views(1, 2, uneven=False)
    planes = sweep(views, INVERSE_DISTANCES)
    found = nearest_planes(np.full((90, 120), 20.0, np.float32), planes)
    assert (found[0] == NOTHING).any()
    assert (found[0][found[0] > NOTHING] == 20.0).all()
