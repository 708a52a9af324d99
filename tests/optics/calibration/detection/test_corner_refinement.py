"""Refinement against the print: corners of a picture rendered from the print."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import PX_PER_SQUARE, Image, blurred_print, sample
from mirrorcam.optics.calibration.detection.board_warp import SEPTIC, BoardWarp, corner_print_xy
from mirrorcam.optics.calibration.detection.corner_patches import Appearance, ExpectedCorners, GhostImages
from mirrorcam.optics.calibration.detection.corner_refinement import RefinedCorners, refine
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard

BOARD = Charuco(cols=8, rows=6, square_mm=20.0, marker_mm=14.0)
PLACES = corner_print_xy(BOARD)
SIZE = (300, 360)
BLUR = 0.0625  # an exact step of the blurs
SQUARES_FROM_PX = np.array([[0.028, 0.002, -0.9], [-0.0015, 0.027, -0.8]])
BLUR_PX = BLUR / np.sqrt(np.linalg.det(SQUARES_FROM_PX[:, :2]))
PIXELS = (PLACES - SQUARES_FROM_PX[:, 2]) @ np.linalg.inv(SQUARES_FROM_PX[:, :2]).T


def picture(contrast: float = 80.0, offset_px: FloatArray | None = None) -> Image:
    """Return an affine picture of the print with this contrast (white minus black), shifted by some pixels."""
    value = blurred_picture(*(0.0, 0.0) if offset_px is None else offset_px.tolist())
    return np.asarray(120.0 + contrast / 2.0 * value, dtype=np.float32)


@lru_cache
def blurred_picture(x_px: float, y_px: float) -> FloatArray:
    """Return the print from -1 to 1, sampled five times along each pixel, and blurred there as by a lens."""
    cut = 5
    v, u = (np.arange(cut * length) / cut - (cut // 2) / cut for length in SIZE)
    pixels = np.stack(np.meshgrid(u, v), axis=-1) - [x_px, y_px]
    places = pixels @ SQUARES_FROM_PX[:, :2].T + SQUARES_FROM_PX[:, 2]
    sharp = blurred_print(BOARD, 0.0)
    fine = sample(sharp.value, (places + 1.0) * PX_PER_SQUARE - 0.5)
    rest_px = np.sqrt(BLUR_PX**2 - (sharp.sigma * BLUR_PX / BLUR) ** 2)
    return np.asarray(cv2.GaussianBlur(fine, (0, 0), cut * rest_px)[cut // 2 :: cut, cut // 2 :: cut])


def expected(off_px: FloatArray) -> ExpectedCorners:
    warp = BoardWarp.fit(PLACES, PIXELS)
    assert warp is not None
    return warp.expected(PLACES, PIXELS + off_px)


def found(grey: Image, off_px: FloatArray, look: Appearance | None = None) -> RefinedCorners:
    return refine(grey, expected(off_px), Appearance(BOARD, BLUR_PX) if look is None else look)


def test_corners_are_found_from_a_pixel_away_to_a_hundredth() -> None:
    off = np.random.default_rng(0).uniform(-1.0, 1.0, PIXELS.shape)
    seen = found(picture(), off)
    assert np.abs(seen.pixels - PIXELS).max() < 0.01
    np.testing.assert_allclose(seen.contrast, 80.0, rtol=0.03)
    assert (seen.explained_variance > 0.99).all()
    np.testing.assert_allclose(seen.blur_px, BLUR_PX, rtol=0.2)
    assert seen.ghost_strengths.shape == (len(PLACES), 0)


def test_brightness_gradient_and_contrast_do_not_move_corners() -> None:
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    sloped = np.asarray(0.4 * picture() + 0.1 * u - 0.05 * v, dtype=np.float32)
    seen = found(sloped, np.zeros(2))
    assert np.abs(seen.pixels - PIXELS).max() < 0.02
    np.testing.assert_allclose(seen.contrast, 32.0, rtol=0.1)


@pytest.mark.parametrize("black", [20.0, 60.0])
def test_light_that_fades_does_not_move_corners(black: float) -> None:
    """Light that fades by 0.4 % per px, on prints with little and with much stray light."""
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    even = picture(contrast=180.0 - black) - 120.0 + (180.0 + black) / 2.0
    faded = np.asarray(even * np.exp(-0.003 * u - 0.003 * v), dtype=np.float32)
    moved = found(faded, np.zeros(2)).pixels - found(np.asarray(even, dtype=np.float32), np.zeros(2)).pixels
    assert np.abs(moved.mean(axis=0)).max() < 5e-4


def test_a_lens_that_blurs_a_board_seen_at_an_angle_does_not_move_corners() -> None:
    """A picture in perspective, sampled eight times along each pixel, blurred in the picture, not on the print."""
    board, size, cut, blur_px = Checkerboard(cols=12, rows=9, square_mm=12.0), (300, 400), 8, 2.5
    px_from_squares = np.array([[28.0, 3.0, 40.0], [-2.0, 27.0, 30.0], [0.01, -0.006, 1.0]])
    v, u = ((np.arange(length * cut) + 0.5) / cut - 0.5 for length in size)
    rays = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], axis=-1) @ np.linalg.inv(px_from_squares).T
    x, y = np.moveaxis(rays[..., :2] / rays[..., 2:], -1, 0)
    white = (np.floor(x) + np.floor(y)) % 2 == 1
    white |= (x < 0) | (y < 0) | (x > board.cols) | (y > board.rows)
    fine = cv2.GaussianBlur(np.asarray(40.0 + 160.0 * white, dtype=np.float32), (0, 0), blur_px * cut)
    grey = np.asarray(fine.reshape(size[0], cut, size[1], cut).mean(axis=(1, 3)), dtype=np.float32)
    places = corner_print_xy(board)
    lifted = np.column_stack([places, np.ones(len(places))]) @ px_from_squares.T
    pixels = lifted[:, :2] / lifted[:, 2:]
    warp = BoardWarp.fit(places, pixels, degree=SEPTIC)
    assert warp is not None
    shown = ((pixels > 25.0) & (pixels < np.array(size[::-1]) - 26.0)).all(axis=1)
    corners = warp.expected(places, pixels).where(shown)
    off = refine(grey, corners, Appearance(board, blur_px)).pixels - pixels[shown]
    assert np.abs(off.mean(axis=0)).max() < 5e-4
    skew = corners.skew_px(np.full(len(off), blur_px**2)).mean(axis=0)
    assert np.linalg.norm(off.mean(axis=0)) < 0.4 * np.linalg.norm(skew)


@pytest.mark.parametrize(("noise", "contrast"), [(2.0, 80.0), (4.0, 160.0), (8.0, 80.0)])
def test_standard_deviations_match_the_scatter_under_repeated_noise(noise: float, contrast: float) -> None:
    """Even in a picture that fades to a fifth from left to right, with less exact corners on the right."""
    random = np.random.default_rng(1)
    fading = np.exp(np.linspace(0.0, -1.6, SIZE[1]))
    clean = (picture(contrast) - 120.0 + contrast / 2.0 + 10.0) * fading
    at, claims = [], []
    for _ in range(40):
        seen = found(np.asarray(clean + random.normal(0.0, noise, SIZE), dtype=np.float32), np.zeros(2))
        at.append(seen.pixels)
        claims.append(seen.sigma_px)
    scatter = np.sqrt(np.mean(np.var(at, axis=0, ddof=1), axis=1))
    claimed = np.sqrt(np.mean(np.square(claims), axis=0))
    assert claimed.max() > 2.0 * claimed.min()
    assert np.median(scatter / claimed) == pytest.approx(1.0, abs=0.15)
    assert np.abs(np.log(scatter / claimed)).max() < np.log(1.6)


def test_no_corner_is_found_without_a_print() -> None:
    inverted = np.asarray(240.0 - picture(), dtype=np.float32)
    assert np.isnan(found(inverted, np.zeros(2)).pixels).all()
    noise = np.random.default_rng(2).normal(100.0, 5.0, SIZE).astype(np.float32)
    assert not (found(noise, np.zeros(2)).explained_variance > 0.8).any()


@pytest.mark.parametrize("strength", [0.05, 0.1])
def test_a_ghost_image_is_modelled_and_measured(strength: float) -> None:
    """It shifts corners by hundredths of a pixel unless it is modelled; its strength is estimated."""
    offset = np.array([3.0, -1.5])
    ghost = picture(contrast=80.0 * strength, offset_px=offset) - 120.0
    together = np.asarray(picture() + ghost, dtype=np.float32)
    ghosts = GhostImages(np.tile(offset, (len(PLACES), 1, 1)), np.full((len(PLACES), 1), strength), (0,))
    pulled = np.abs(found(together, np.zeros(2)).pixels - PIXELS).max()
    known = found(together, np.zeros(2), Appearance(BOARD, BLUR_PX, ghosts))
    assert np.abs(known.pixels - PIXELS).max() < 0.5 * pulled
    half = ghosts.scaled(np.array([0.5]))
    free = found(together, np.zeros(2), Appearance(BOARD, BLUR_PX, half, fit_strengths=True))
    assert np.median(free.ghost_strengths * half.strengths) == pytest.approx(strength, rel=0.15)


def test_a_mask_selects_corners() -> None:
    seen = found(picture(), np.zeros(2))
    mask = np.arange(len(PLACES)) % 3 == 0
    np.testing.assert_array_equal(seen.where(mask).pixels, seen.pixels[mask])
