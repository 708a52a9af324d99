"""The motion of the picture between views: that of pinholes, and none if pictures do not determine it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.io.view_motion import measure_motion
from tests.optics.light_field.io.formats.planes import plane
from tests.optics.light_field.io.orders import scene, with_samples


@pytest.mark.parametrize("disparity_px", [-3.0, -0.4, 0.4, 3.0])
def test_a_plane_moves_by_its_disparity_along_x_in_rows_and_along_y_in_columns(disparity_px: float) -> None:
    motion = measure_motion(plane(2, 3, disparity_px))
    assert motion is not None
    rows = motion.pairs[:, 1] - motion.pairs[:, 0] == 1
    assert rows.sum() == 4
    assert np.abs(motion.displacement_px[rows] - [-disparity_px, 0.0]).max() < 0.1
    assert np.abs(motion.displacement_px[~rows] - [0.0, -disparity_px]).max() < 0.1


def test_planes_before_and_behind_zero_disparity_do_not_cancel() -> None:
    motion = measure_motion(scene(3, 3))
    assert motion is not None
    along = motion.displacement_px[:6]
    assert np.abs(along[:, 0]).min() > 0.5
    assert np.ptp(along[:, 0]) < 0.1
    assert np.abs(along[:, 1]).max() < 0.1


def noise(spread: float) -> Any:
    return np.random.default_rng(3).normal(0.0, spread, (3, 3, 90, 120, 3))


@pytest.mark.parametrize(
    "samples",
    [
        np.full((3, 3, 90, 120, 3), 100, np.uint8),
        (120 + noise(4.0)).astype(np.uint8),
        np.clip(128 + noise(80.0), 0, 255).astype(np.uint8),
        np.clip(plane(1, 1, 0.0).samples + noise(6.0), 0, 255).astype(np.uint8),
        plane(1, 1, 0.0).samples,
        np.random.default_rng(2).integers(0, 255, (3, 3, 5, 7, 3)).astype(np.uint8),
    ],
    ids=["flat", "flat with noise", "noise", "one view with noise", "single", "tiny"],
)
def test_pictures_without_motion_are_ambiguous(samples: Any) -> None:
    assert measure_motion(with_samples(samples)) is None
