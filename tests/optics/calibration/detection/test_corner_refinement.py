"""Refinement against the print: corners of a picture that is itself made of the print."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, Image, blurred_print, sample
from mirrorcam.optics.calibration.detection.board_warp import Warp, corner_places
from mirrorcam.optics.calibration.detection.corner_patches import Appearance, ExpectedCorners, GhostImages
from mirrorcam.optics.calibration.detection.corner_refinement import RefinedCorners, refine
from mirrorcam.optics.geometry.targets import Charuco

BOARD = Charuco(cols=8, rows=6, square_mm=20.0, marker_mm=14.0)
PLACES = corner_places(BOARD)
SIZE = (300, 360)
BLUR = 0.0625  # an exact step of the blurs
SQUARES_FROM_PX = np.array([[0.028, 0.002, -0.9], [-0.0015, 0.027, -0.8]])
PIXELS = (PLACES - SQUARES_FROM_PX[:, 2]) @ np.linalg.inv(SQUARES_FROM_PX[:, :2]).T


def picture(contrast: float = 80.0, offset_px: FloatArray | None = None) -> Image:
    """An affine picture of the print, white less black of `contrast`, shifted by some pixels."""
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
    pixels = np.stack([u, v], axis=-1) - (np.zeros(2) if offset_px is None else offset_px)
    places = pixels @ SQUARES_FROM_PX[:, :2].T + SQUARES_FROM_PX[:, 2]
    value = sample(blurred_print(BOARD, BLUR).value, (places + 1.0) * PX_PER_SQUARE - 0.5)
    return np.asarray(120.0 + contrast / 2.0 * value, dtype=np.float32)


def expected(off_px: FloatArray) -> ExpectedCorners:
    warp = Warp.through(PLACES, PIXELS)
    assert warp is not None
    return warp.expected(PLACES, PIXELS + off_px)


def found(grey: Image, off_px: FloatArray, look: Appearance | None = None) -> RefinedCorners:
    return refine(grey, expected(off_px), Appearance(BOARD, BLUR) if look is None else look)


def test_corners_are_found_from_a_pixel_away_to_a_hundredth() -> None:
    off = np.random.default_rng(0).uniform(-1.0, 1.0, PIXELS.shape)
    seen = found(picture(), off)
    assert np.abs(seen.pixels - PIXELS).max() < 0.01
    np.testing.assert_allclose(seen.contrast, 80.0, rtol=0.03)
    assert (seen.explained > 0.99).all()
    np.testing.assert_allclose(seen.blur_cells, BLUR, rtol=0.2)
    assert seen.ghost_strengths.shape == (len(PLACES), 0)


def test_brightness_slope_and_contrast_do_not_move_corners() -> None:
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    sloped = np.asarray(0.4 * picture() + 0.1 * u - 0.05 * v, dtype=np.float32)
    seen = found(sloped, np.zeros(2))
    assert np.abs(seen.pixels - PIXELS).max() < 0.02
    np.testing.assert_allclose(seen.contrast, 32.0, rtol=0.1)


def test_claimed_sigmas_cover_the_errors_of_noise() -> None:
    random = np.random.default_rng(1)
    errors, claims = [], []
    for _ in range(10):
        noisy = np.asarray(picture() + random.normal(0.0, 4.0, SIZE), dtype=np.float32)
        seen = found(noisy, np.zeros(2))
        errors.append(seen.pixels - PIXELS)
        claims.append(seen.sigma_px)
    rms, claimed = np.sqrt(np.mean(np.square(errors))), np.sqrt(np.mean(np.square(claims)))
    assert 0.5 * claimed < rms < 1.2 * claimed
    assert rms < 0.1


def test_where_there_is_no_print_there_is_no_corner() -> None:
    inverted = np.asarray(240.0 - picture(), dtype=np.float32)
    assert np.isnan(found(inverted, np.zeros(2)).pixels).all()
    noise = np.random.default_rng(2).normal(100.0, 5.0, SIZE).astype(np.float32)
    assert not (found(noise, np.zeros(2)).explained > 0.8).any()


@pytest.mark.parametrize("strength", [0.05, 0.1])
def test_a_ghost_image_is_modelled_and_measured(strength: float) -> None:
    """It pulls corners by hundredths of a pixel unless it is part of what is compared, and its strength is found."""
    offset = np.array([3.0, -1.5])
    ghost = picture(contrast=80.0 * strength, offset_px=offset) - 120.0
    together = np.asarray(picture() + ghost, dtype=np.float32)
    ghosts = GhostImages(np.tile(offset, (len(PLACES), 1, 1)), np.full((len(PLACES), 1), strength))
    pulled = np.abs(found(together, np.zeros(2)).pixels - PIXELS).max()
    known = found(together, np.zeros(2), Appearance(BOARD, BLUR, ghosts))
    assert np.abs(known.pixels - PIXELS).max() < 0.5 * pulled
    half = GhostImages(ghosts.offsets_px, ghosts.strengths / 2.0)
    free = found(together, np.zeros(2), Appearance(BOARD, BLUR, half, fit_strengths=True))
    assert np.median(free.ghost_strengths * half.strengths) == pytest.approx(strength, rel=0.15)


def test_a_mask_selects_corners() -> None:
    seen = found(picture(), np.zeros(2))
    mask = np.arange(len(PLACES)) % 3 == 0
    np.testing.assert_array_equal(seen.where(mask).pixels, seen.pixels[mask])
