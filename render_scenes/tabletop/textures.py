"""Procedural textures of the objects: linear RGB, 0 to 1, from seeded random numbers.

Every texture has detail at all scales down to its texels, so that views can be matched everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray

TextureName = Literal["wood", "poster", "page", "label", "cover", "globe"]
Texture = NDArray[np.float32]
_TEXT = """
light field view mirror camera pupil ray depth plane focus disparity parallax aperture sharp far near image of the a
with by from seen through nine flat angle fold lens pixel scene point line and to in is are moves turns behind
"""
_WORDS = _TEXT.split()


def texture(name: TextureName, size_px: tuple[int, int], seed: int) -> Texture:
    """Make a texture (height, width, 3) of `size_px` = width, height; the same for the same seed."""
    width, height = size_px
    picture = _MAKERS[name](height, width, np.random.default_rng(seed))
    return np.clip(picture, 0.02, 0.9).astype(np.float32)


def grain(
    height: int, width: int, random: np.random.Generator, *, cell: tuple[float, float], fall: float
) -> FloatArray:
    """Make fractal noise (height, width), mean 0, deviation near 1: octaves of cells `cell` = high, wide and finer.

    Each octave has cells half as large, and is `fall` times as strong as the one before.
    """
    total, strength, power = np.zeros((height, width)), 1.0, 0.0
    tall, wide = cell
    while max(tall, wide) >= 1.0:
        rows, columns = (max(int(np.ceil(n / max(c, 1.0))), 2) for n, c in ((height, tall), (width, wide)))
        coarse = random.standard_normal((rows, columns)).astype(np.float32)
        total += strength * np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC))
        power += strength**2
        strength, tall, wide = strength * fall, tall / 2.0, wide / 2.0
    return np.asarray(total / np.sqrt(power))


def _mixed(part: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Interpolate between two colours (3,) by a fraction (h, w)."""
    return np.asarray(low + np.clip(part, 0.0, 1.0)[..., None] * (high - low))


def _colour(random: np.random.Generator) -> FloatArray:
    """Draw a colour (3,) that is neither black nor white."""
    colour = random.uniform(0.05, 0.8, 3)
    return np.asarray(0.25 * colour.mean() + 0.75 * colour + 0.05)


def _wood(height: int, width: int, random: np.random.Generator) -> FloatArray:
    rings = grain(height, width, random, cell=(height / 6.0, width * 2.0), fall=0.8)
    lines = grain(height, width, random, cell=(6.0, 160.0), fall=0.7)
    specks = grain(height, width, random, cell=(4.0, 4.0), fall=1.0)
    part = 0.5 + 0.22 * np.sin(4.0 * rings) + 0.14 * lines + 0.1 * specks
    return _mixed(part, np.array([0.16, 0.075, 0.03]), np.array([0.62, 0.40, 0.22]))


def _poster(height: int, width: int, random: np.random.Generator) -> FloatArray:
    light, *hills = (grain(height, width, random, cell=(height / 4.0, width / 6.0), fall=0.75) for _ in range(4))
    picture = np.stack([0.40 + 0.12 * light + 0.06 * hill for hill in hills], axis=-1)
    canvas = np.ascontiguousarray(picture, dtype=np.float32)
    for _ in range(220):
        at = (int(random.integers(width)), int(random.integers(height)))
        reach = int(random.uniform(0.004, 0.03) * width)
        colour = tuple(_colour(random).tolist())
        if random.random() < 0.5:
            cv2.circle(canvas, at, reach, colour, -1, cv2.LINE_AA)
        else:
            turned = cv2.boxPoints((at, (reach, 2.0 * reach), float(random.uniform(0.0, 180.0))))
            cv2.fillPoly(canvas, [turned.astype(np.int32)], colour, cv2.LINE_AA)
    weave = grain(height, width, random, cell=(6.0, 6.0), fall=0.9)
    return np.asarray(canvas * (1.0 + 0.16 * weave[..., None]))


def _page(height: int, width: int, random: np.random.Generator) -> FloatArray:
    paper, ink = np.full((height, width, 3), 0.85), np.zeros((height, width), dtype=np.uint8)
    margin, line = width // 12, max(height // 20, 9)
    row = margin + line
    _write(ink, " ".join(random.choice(_WORDS, 3)), (margin, row), 1.3 * line)
    row += 2 * line
    while row < height - margin:
        if 0.5 * height < row < 0.5 * height + line:
            tall = min(5 * line, height - margin - row)
            paper[row : row + tall, margin : width - margin] = _poster(tall, width - 2 * margin, random)
            row += tall + line
        _write(ink, " ".join(random.choice(_WORDS, 10)), (margin, row), 0.62 * line)
        row += line
    ink[:, width - margin :] = 0
    fibres = 0.02 * grain(height, width, random, cell=(8.0, 8.0), fall=1.0)[..., None]
    return np.asarray((paper + fibres) * (1.0 - 0.94 * (ink / 255.0)[..., None]))


def _write(ink: NDArray[np.uint8], text: str, at: tuple[int, int], high: float) -> None:
    """Write a line, its capitals `high` texels tall, from the bottom left corner `at` on."""
    scale = high / 30.0
    cv2.putText(ink, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, max(round(2 * scale), 1), cv2.LINE_AA)


def _label(height: int, width: int, random: np.random.Generator) -> FloatArray:
    ground, band = _colour(random), _colour(random)
    picture = np.broadcast_to(ground, (height, width, 3)).copy()
    for top, bottom in ((0.06, 0.12), (0.36, 0.64), (0.88, 0.94)):
        picture[int(top * height) : int(bottom * height)] = band
    ink, step = np.zeros((height, width), dtype=np.uint8), width // 6
    for column in range(6):
        _write(ink, str(random.choice(_WORDS[:17])), (int((column + 0.1) * step), int(0.56 * height)), step / 6.0)
        for row in (0.24, 0.76):
            disc = np.zeros((height, width), dtype=np.uint8)
            centre = (int((column + 0.5) * step), int(row * height))
            cv2.circle(disc, centre, min(step // 3, height // 10), 255, -1, cv2.LINE_AA)
            picture += (disc / 255.0)[..., None] * (_colour(random) - picture)
    picture += (ink / 255.0)[..., None] * (0.85 - picture)
    return np.asarray(picture * (1.0 + 0.10 * grain(height, width, random, cell=(10.0, 10.0), fall=0.9)[..., None]))


def _cover(height: int, width: int, random: np.random.Generator) -> FloatArray:
    cells = 6
    colours = np.stack([_colour(random) for _ in range(cells * cells)]).reshape(cells, cells, 3).astype(np.float32)
    patches = np.asarray(cv2.resize(colours, (width, height), interpolation=cv2.INTER_NEAREST))
    threads = grain(height, width, random, cell=(12.0, 12.0), fall=0.85)
    return np.asarray(patches * (1.0 + 0.18 * threads[..., None]))


def _globe(height: int, width: int, random: np.random.Generator) -> FloatArray:
    land = grain(height, width, random, cell=(height / 4.0, width / 6.0), fall=0.65)
    detail = grain(height, width, random, cell=(8.0, 16.0), fall=0.9)
    sea = _mixed(0.5 + 0.3 * detail, np.array([0.04, 0.12, 0.30]), np.array([0.12, 0.30, 0.55]))
    shore = _mixed(0.5 + 0.4 * detail, np.array([0.14, 0.28, 0.08]), np.array([0.60, 0.52, 0.28]))
    picture = np.where((land > 0.1)[..., None], shore, sea)
    for part in np.arange(1, 12) / 12.0:
        picture[:, int(part * width)] = 0.75
        picture[int(part * height)] = 0.75
    return np.asarray(picture)


_MAKERS: dict[TextureName, Callable[[int, int, np.random.Generator], FloatArray]] = {
    "wood": _wood,
    "poster": _poster,
    "page": _page,
    "label": _label,
    "cover": _cover,
    "globe": _globe,
}
