"""Periodic textures of natural spectra for surfaces of scenes: linear RGB, 0 to 1, from seeded random numbers."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirrorcam.core.values import FloatArray

Pattern = NDArray[np.float32]
SIDE_PX = 1024


def noise(
    random: np.random.Generator, *, fall: float = 1.2, stretch: float = 1.0, coarsest: float = 0.25
) -> FloatArray:
    """Return periodic noise (SIDE_PX, SIDE_PX) of mean 0 and standard deviation 1 whose amplitude falls with frequency.

    Parameters
    ----------
    random
        Source of the phases.
    fall
        Exponent: amplitude is frequency to the power of -fall; 1 to 1.5 for most natural surfaces.
    stretch
        Elongation along rows.
    coarsest
        Wavelength, as a fraction of the texture's side, beyond which the amplitude does not grow.
    """
    row_frequency, column_frequency = np.fft.rfftfreq(SIDE_PX) * stretch, np.fft.fftfreq(SIDE_PX)[:, None]
    frequency = np.hypot(row_frequency, column_frequency)
    amplitude = np.maximum(frequency, 1.0 / (coarsest * SIDE_PX)) ** -fall
    amplitude[0, 0] = 0.0
    values = np.fft.irfft2(amplitude * np.fft.rfft2(random.standard_normal((SIDE_PX, SIDE_PX))))
    return np.asarray(values / values.std())


def tinted(brightness: FloatArray, colour: ArrayLike) -> Pattern:
    """Return a reflectance: a colour (3,) times a brightness (h, w)."""
    return np.clip(brightness[..., None] * np.asarray(colour), 0.01, 0.9).astype(np.float32)


def plaster(seed: int, colour: ArrayLike, contrast: float) -> Pattern:
    """Return a plain surface: weak noise at all scales, partly in hue, and a few spots."""
    random = np.random.default_rng(seed)
    light, hue, spots = noise(random, fall=1.0), noise(random, fall=1.4), noise(random, fall=0.6)
    brightness = 1.0 + contrast * (light - 1.5 * np.clip(spots - 2.2, 0.0, 1.5))
    picture = tinted(brightness, colour)
    return picture * (1.0 + 0.4 * contrast * hue[..., None] * np.array([1.0, 0.0, -1.0])).astype(np.float32)


def planks(seed: int, colour: ArrayLike, *, boards: int, contrast: float = 0.12) -> Pattern:
    """Return wooden boards along the rows, with grain, individual tones and dark gaps."""
    random = np.random.default_rng(seed)
    rings, fibres = noise(random, fall=1.3, stretch=10.0), noise(random, fall=0.7, stretch=30.0)
    row = np.arange(SIDE_PX) * boards // SIDE_PX
    shifted = np.stack([np.roll(line, 377 * number) for line, number in zip(rings, row, strict=True)])
    bands = np.sin(3.0 * shifted + 2.0 * np.pi * row[:, None] / boards)
    tone = random.uniform(-1.0, 1.0, boards)[row][:, None]
    brightness = 1.0 + contrast * (0.7 * bands + 0.6 * fibres + 0.8 * tone)
    gap = np.minimum(np.arange(SIDE_PX) % (SIDE_PX / boards), 6.0) < 3.0
    brightness[gap] *= 0.45
    return tinted(brightness, colour)


def bricks(seed: int, colour: ArrayLike, *, courses: int = 10, contrast: float = 0.18) -> Pattern:
    """Return bricks twice as long as high, with joints and individual tones."""
    random = np.random.default_rng(seed)
    height, width = SIDE_PX / courses, 2.0 * SIDE_PX / courses
    rows, columns = np.mgrid[0:SIDE_PX, 0:SIDE_PX].astype(np.float64)
    wobble = 1.5 * noise(random, fall=1.5, coarsest=0.05)
    course = np.floor((rows + wobble) / height).astype(int) % courses
    x = (columns + wobble + 0.5 * width * (course % 2)) % SIDE_PX
    number = np.floor(x / width).astype(int)
    joint = np.minimum(((rows + wobble) % height) / 6.0, (x % width) / 6.0) < 1.0
    tones = random.uniform(-1.0, 1.0, (courses, courses // 2 + 1))
    brightness = 1.0 + contrast * (tones[course, number] + 0.7 * noise(random, fall=0.9))
    picture = tinted(brightness, colour)
    mortar = tinted(1.0 + 0.08 * noise(random, fall=0.8), [0.42, 0.40, 0.37])
    return np.where(joint[..., None], mortar, picture)


def weave(seed: int, colour: ArrayLike, *, threads: int = 64, contrast: float = 0.15) -> Pattern:
    """Return cloth: threads over and under each other, uneven in thickness and tone."""
    random = np.random.default_rng(seed)
    rows, columns = 2.0 * np.pi * np.mgrid[0:SIDE_PX, 0:SIDE_PX] * threads / SIDE_PX
    uneven = noise(random, fall=0.9, stretch=6.0) + noise(random, fall=0.9, stretch=6.0).T
    brightness = 1.0 + contrast * (np.sin(rows) * np.sin(columns) + 0.6 * uneven)
    return tinted(brightness, colour)


def stone(seed: int, colour: ArrayLike, *, contrast: float = 0.2) -> Pattern:
    """Return stone: blotches of two tones, veins and grains."""
    random = np.random.default_rng(seed)
    blotch, grain, fold = noise(random, fall=1.5), noise(random, fall=0.4), noise(random, fall=1.6)
    veins = np.exp(-np.square(fold / 0.06))
    brightness = 1.0 + contrast * (0.8 * np.tanh(2.0 * blotch) + 0.4 * grain - 1.2 * veins)
    return tinted(brightness, colour)


def foliage(seed: int, colour: ArrayLike) -> Pattern:
    """Return the surface of leaves: light and dark patches, side ribs and brown spots."""
    random = np.random.default_rng(seed)
    patch, rib, brown = noise(random, fall=1.1), noise(random, fall=0.8, stretch=0.15), noise(random, fall=1.3)
    picture = tinted(1.0 + 0.28 * patch + 0.14 * rib, colour)
    fraction = np.clip(brown - 1.6, 0.0, 1.0)[..., None]
    mixed: FloatArray = picture * (1.0 - fraction) + fraction * np.array([0.20, 0.11, 0.04])
    return mixed.astype(np.float32)


def resized(picture: Pattern, side_px: int = SIDE_PX) -> Pattern:
    """Return a picture (h, w, 3) resized to the size of the textures."""
    return np.asarray(cv2.resize(picture, (side_px, side_px), interpolation=cv2.INTER_AREA))
