"""The linear model of the picture around a corner, on pictures rendered from the print."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from scipy.special import ndtr

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE
from mirrorcam.optics.calibration.detection.board_warp import corner_print_xy
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
from mirrorcam.optics.geometry.boards import Charuco

BOARD = Charuco(cols=8, rows=6, square_mm=20.0, marker_mm=14.0)
PLACES = corner_print_xy(BOARD)
CELL_PX = 24.0
LOOK = Appearance(BOARD, blur_px=0.0625 * CELL_PX)


def corners(places: FloatArray = PLACES, cell_px: float = CELL_PX) -> ExpectedCorners:
    """Corners of a board seen upright, with square cells."""
    count = len(places)
    cells = np.tile(cell_px * np.eye(2), (count, 1, 1))
    return ExpectedCorners(places, places * cell_px, cells, np.zeros((count, 2, 3)))


def columns(expected: ExpectedCorners, look: Appearance = LOOK, seen: FloatArray | None = None) -> FloatArray:
    """Terms of the model, unscaled, as columns (n, m, c), for grey values (n, m)."""
    patches = Patches.around(expected)
    grey = np.zeros(patches.print_offsets.shape[:2]) if seen is None else seen
    model = LinearModel.of(expected, patches, look, grey.astype(np.float32))
    return (model.terms * model.scale[..., None]).transpose(0, 2, 1).astype(np.float64)


def test_a_mask_selects_corners() -> None:
    mask = np.arange(len(PLACES)) % 3 == 0
    selected = corners().where(mask)
    for field in fields(ExpectedCorners):
        np.testing.assert_array_equal(getattr(selected, field.name), getattr(corners(), field.name)[mask])


@pytest.mark.parametrize(("cell_px", "half_px"), [(24.0, 12.0), (200.0, MAX_HALF_PX)])
def test_a_patch_covers_half_a_cell_in_each_direction_up_to_its_limit(cell_px: float, half_px: float) -> None:
    patches = Patches.around(corners(cell_px=cell_px))
    np.testing.assert_allclose(patches.side_px, cell_px)
    np.testing.assert_allclose(np.abs(patches.offsets_px).max(axis=1), half_px)
    np.testing.assert_allclose(patches.offsets_px, cell_px * patches.print_offsets)


def test_a_bend_adds_its_second_order() -> None:
    straight, bends = corners(), np.zeros((len(PLACES), 2, 3))
    bends[:, 0, 2] = 3.0  # x by y squared
    bent = Patches.around(ExpectedCorners(straight.print_xy, straight.pixels, straight.cells, bends))
    added = bent.offsets_px - Patches.around(straight).offsets_px
    np.testing.assert_allclose(added[..., 0], 3.0 * bent.print_offsets[..., 1] ** 2)
    np.testing.assert_array_equal(added[..., 1], 0.0)


def test_columns_of_the_shift_are_the_derivatives_of_the_print() -> None:
    """Against central differences over one sample of the print."""
    step = 1.0 / PX_PER_SQUARE
    at = columns(corners())
    for axis in range(2):
        move = np.eye(2)[axis] * step
        ahead, behind = (columns(corners(PLACES + sign * move))[..., CONTRAST] for sign in (1.0, -1.0))
        error = at[..., SHIFT][..., axis] - (ahead - behind) / (2.0 * step * CELL_PX)
        assert np.sqrt(np.mean(error**2)) < 0.02 * np.sqrt(np.mean(at[..., SHIFT] ** 2))


@pytest.mark.parametrize("modulation", [0.4, 0.9])
def test_a_brightness_gradient_scales_with_the_prints_modulation(modulation: float) -> None:
    """Light that fades by s to the right adds s u (1 + m value) to a picture of modulation m."""
    u = Patches.around(corners()).u
    value = columns(corners())[..., CONTRAST]
    at = columns(corners(), seen=130.0 * (1.0 + modulation * value))
    np.testing.assert_allclose(at[..., 1], u * (1.0 + modulation * value), atol=1e-6)


def test_a_straight_map_skews_no_edge() -> None:
    np.testing.assert_array_equal(corners().skew_px(np.ones(len(PLACES))), 0.0)


def test_the_skew_of_edges_is_the_best_fitting_shift() -> None:
    """Against a least-squares fit of shift, contrast and blur to the profile of an edge on a bent axis.

    Level and gradient do not contribute: along the edge of a corner, black and white change sides.
    """
    cell_px, bend, sigma = 30.0, 0.6, 1.3
    s = np.linspace(-8.0, 8.0, 4001)
    # x px = cell t + bend t^2: places t of the edge's profile erf(t) on the print, seen at s px.
    t = (np.sqrt(cell_px**2 + 4.0 * bend * s) - cell_px) / (2.0 * bend)
    model, true = (ndtr(at / sigma) - 0.5 for at in (cell_px * t, s))
    slope = np.gradient(model, s)
    shift = -np.linalg.lstsq(np.stack([model, s * slope, slope], axis=1), true, rcond=None)[0][2]
    bends = np.zeros((1, 2, 3))
    bends[0, 0, 0] = bend
    upright = ExpectedCorners(np.ones((1, 2)), np.zeros((1, 2)), cell_px * np.eye(2)[None], bends)
    np.testing.assert_allclose(upright.skew_px(np.array([sigma**2])), [[shift, 0.0]], rtol=0.1)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    turned = ExpectedCorners(upright.print_xy, upright.pixels, turn @ upright.cells, turn @ bends)
    np.testing.assert_allclose(turned.skew_px(np.array([sigma**2])), [shift * turn[:, 0]], rtol=0.1, atol=1e-9)


def test_ghost_images_of_known_strength_join_the_print_and_others_get_a_column_each() -> None:
    ghosts = GhostImages(np.tile([[3.0, -2.0]], (len(PLACES), 1, 1)), np.full((len(PLACES), 1), 0.1), (0,))
    plain, known = columns(corners()), columns(corners(), Appearance(BOARD, LOOK.blur_px, ghosts))
    free = columns(corners(), Appearance(BOARD, LOOK.blur_px, ghosts, fit_strengths=True))
    assert plain[..., GHOSTS].shape[2] == known[..., GHOSTS].shape[2] == 0
    assert free[..., GHOSTS].shape[2] == 1
    np.testing.assert_allclose(known[..., CONTRAST], plain[..., CONTRAST] + free[..., GHOSTS][..., 0], atol=1e-6)
    shifted = columns(corners(PLACES - np.array([3.0, -2.0]) / CELL_PX))[..., CONTRAST]
    np.testing.assert_allclose(free[..., GHOSTS][..., 0], 0.1 * shifted, atol=1e-5)
