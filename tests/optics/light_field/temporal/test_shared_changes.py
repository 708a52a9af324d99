"""What views share of a change: motion at any disparity, and no noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.temporal.shared_changes import neighbours, own_share
from tests.optics.light_field.depth.surfaces import grid_views
from tests.optics.light_field.temporal.videos import HEIGHT_PX, WIDTH_PX, picture, shot

GAINS = np.ones((9, HEIGHT_PX, 3), np.float32)


def at_disparity(scene: Any, disparity_px: int) -> Any:
    """The views (t, s, v, u, c) of a picture at a disparity, which goes on at the other side."""
    return np.stack(
        [
            np.stack([np.roll(scene, (-disparity_px * t, -disparity_px * s), (0, 1)) for s in (-1, 0, 1)])
            for t in (-1, 0, 1)
        ]
    )


def test_shifts_follow_the_views() -> None:
    views = grid_views(uneven=False)
    reference, near, shifts = neighbours(views)
    assert (reference, sorted(near)) == (4, [1, 3, 5, 7])
    one = shifts[len(shifts) // 2 + 1]
    assert {(int(view), *map(int, shift)) for view, shift in zip(near, one, strict=True)} == {
        (1, 0, -1),
        (3, -1, 0),
        (5, 1, 0),
        (7, 0, 1),
    }


@pytest.mark.parametrize("disparity_px", [-6, 0, 5])
def test_motion_is_shared_at_any_disparity_and_noise_is_not(disparity_px: int) -> None:
    random = np.random.default_rng(7)
    scene = picture(grain_px=1.0)
    still = [shot(at_disparity(scene, disparity_px), random) for _ in range(2)]
    assert own_share(still[1], still[0], GAINS) > 0.9
    moved = shot(at_disparity(np.roll(scene, 3, axis=1), disparity_px), random)
    assert own_share(moved, still[0], GAINS) < 0.3


def test_without_neighbours_or_in_small_views_nothing_is_said() -> None:
    random = np.random.default_rng(8)
    frames = [shot(picture(seed), random) for seed in (0, 1)]
    small = []
    for frame in frames:
        given = {"width_px": 16, "height_px": 16}
        views = grid_views(uneven=False, **given)
        small.append(type(frame).of(views, frame.samples[:, :, :16, :16], frame.weights[:, :, :16, :16]))
    assert own_share(small[1], small[0], GAINS[:, :16]) == 1.0
    assert own_share(frames[0], frames[0], GAINS) == 1.0
    assert WIDTH_PX > 16
