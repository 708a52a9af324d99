"""The linear model of the picture around a corner, on pictures that are themselves made of the print."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE
from mirrorcam.optics.calibration.detection.board_warp import corner_places
from mirrorcam.optics.calibration.detection.corner_patches import (
    CONTRAST,
    GHOSTS,
    MAX_HALF_PX,
    SHIFT,
    Appearance,
    ExpectedCorners,
    GhostImages,
    LinearModel,
    Patches,
)
from mirrorcam.optics.geometry.targets import Charuco

BOARD = Charuco(cols=8, rows=6, square_mm=20.0, marker_mm=14.0)
PLACES = corner_places(BOARD)
LOOK = Appearance(BOARD, blur_cells=0.0625)
CELL_PX = 24.0


def corners(places: FloatArray = PLACES, cell_px: float = CELL_PX) -> ExpectedCorners:
    """Corners of a board seen upright, with square cells."""
    count = len(places)
    cells = np.tile(cell_px * np.eye(2), (count, 1, 1))
    return ExpectedCorners(places, places * cell_px, cells, np.zeros((count, 2, 3)))


def columns(expected: ExpectedCorners, look: Appearance = LOOK) -> FloatArray:
    """Columns (n, m, c) of the model, unscaled."""
    model = LinearModel.of(expected, Patches.around(expected), look)
    return model.columns * model.scale[:, None]


def test_a_mask_selects_corners() -> None:
    mask = np.arange(len(PLACES)) % 3 == 0
    selected = corners().where(mask)
    for field in fields(ExpectedCorners):
        np.testing.assert_array_equal(getattr(selected, field.name), getattr(corners(), field.name)[mask])


@pytest.mark.parametrize(("cell_px", "half_px"), [(24.0, 12.0), (200.0, MAX_HALF_PX)])
def test_a_patch_covers_half_a_cell_each_way_but_not_more_than_its_limit(cell_px: float, half_px: float) -> None:
    patches = Patches.around(corners(cell_px=cell_px))
    np.testing.assert_allclose(patches.side_px, cell_px)
    np.testing.assert_allclose(np.abs(patches.offsets_px).max(axis=1), half_px)
    np.testing.assert_allclose(patches.offsets_px, cell_px * patches.on_print)


def test_a_bend_adds_its_second_order() -> None:
    straight, bends = corners(), np.zeros((len(PLACES), 2, 3))
    bends[:, 0, 2] = 3.0  # x by y squared
    bent = Patches.around(ExpectedCorners(straight.places, straight.pixels, straight.cells, bends))
    added = bent.offsets_px - Patches.around(straight).offsets_px
    np.testing.assert_allclose(added[..., 0], 3.0 * bent.on_print[..., 1] ** 2)
    np.testing.assert_array_equal(added[..., 1], 0.0)


def test_columns_of_the_shift_are_the_derivatives_of_the_print() -> None:
    """By central differences over one sample of the print each way."""
    step = 1.0 / PX_PER_SQUARE
    at = columns(corners())
    for axis in range(2):
        move = np.eye(2)[axis] * step
        ahead, behind = (columns(corners(PLACES + sign * move))[..., CONTRAST] for sign in (1.0, -1.0))
        error = at[..., SHIFT][..., axis] - (ahead - behind) / (2.0 * step * CELL_PX)
        assert np.sqrt(np.mean(error**2)) < 0.02 * np.sqrt(np.mean(at[..., SHIFT] ** 2))


def test_ghost_images_of_known_strength_belong_to_the_print_and_others_have_a_column_each() -> None:
    ghosts = GhostImages(np.tile([[3.0, -2.0]], (len(PLACES), 1, 1)), np.full((len(PLACES), 1), 0.1))
    plain, known = columns(corners()), columns(corners(), Appearance(BOARD, 0.0625, ghosts))
    free = columns(corners(), Appearance(BOARD, 0.0625, ghosts, fit_strengths=True))
    assert plain[..., GHOSTS].shape[2] == known[..., GHOSTS].shape[2] == 0
    assert free[..., GHOSTS].shape[2] == 1
    np.testing.assert_allclose(known[..., CONTRAST], plain[..., CONTRAST] + free[..., GHOSTS][..., 0])
    shifted = columns(corners(PLACES - np.array([3.0, -2.0]) / CELL_PX))[..., CONTRAST]
    np.testing.assert_allclose(free[..., GHOSTS][..., 0], 0.1 * shifted, atol=1e-5)
