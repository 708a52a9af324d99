"""Textures at several scales in one table, and their means over the footprints of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import inlined

MOST_TAPS = 8
"""Places along the longer axis of a footprint at most; of a longer one, a coarser scale is taken."""

SHARPER = 0.75
"""Texels of the scale that is looked up, in widths of a footprint: between texels it is smoothed, which widens them."""


class TextureAtlas(NamedTuple):
    """Textures at scales of 1, 1/2, 1/4, ...

    Attributes
    ----------
    texels
        (n, 3): of all scales of all textures, row by row.
    scales
        (m, 3): where the texels of a scale begin, its columns and its rows.
    textures
        (k, 2): the first scale of a texture, and the number of its scales.
    """

    texels: NDArray[np.float32]
    scales: NDArray[np.int64]
    textures: NDArray[np.int64]


def texture_atlas(pictures: Sequence[NDArray[np.float32]]) -> TextureAtlas:
    """The atlas of pictures (rows, columns, 3); each scale has the means of the picture over its texels."""
    texels: list[NDArray[np.float32]] = []
    scales: list[tuple[int, int, int]] = []
    textures: list[tuple[int, int]] = []
    begin = 0
    for picture in pictures:
        first = len(scales)
        shown = np.ascontiguousarray(picture, dtype=np.float32)
        while True:
            rows, columns = shown.shape[:2]
            scales.append((begin, columns, rows))
            texels.append(shown.reshape(-1, 3))
            begin += rows * columns
            if max(rows, columns) == 1:
                break
            size = ((columns + 1) // 2, (rows + 1) // 2)
            shown = np.asarray(cv2.resize(shown, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        textures.append((first, len(scales) - first))
    return TextureAtlas(
        np.concatenate([*texels, np.zeros((1, 3), np.float32)]),
        np.array(scales, dtype=np.int64).reshape(-1, 3),
        np.array(textures, dtype=np.int64).reshape(-1, 2),
    )


@inlined
def mean_colour(texels: Any, scales: Any, textures: Any, texture: Any, at: Any, right: Any, down: Any) -> Any:
    """Mean of a texture over the parallelogram with sides `right` and `down`, (2,) each, around `at`.

    All are in widths and heights of the texture, from its top left corner.
    """
    first, count = textures[texture, 0], textures[texture, 1]
    columns, rows = scales[first, 1], scales[first, 2]
    ax, ay, bx, by = right[0] * columns, right[1] * rows, down[0] * columns, down[1] * rows
    if ax * ax + ay * ay < bx * bx + by * by:
        ax, ay, bx, by = bx, by, ax, ay
    longer = max(np.sqrt(ax * ax + ay * ay), 1e-9)
    shorter = abs(ax * by - ay * bx) / longer
    taps = int(min(np.ceil(longer / max(shorter, 1.0)), float(MOST_TAPS)))
    scale = np.log2(max(SHARPER * max(shorter, longer / taps), 1.0))
    if taps > 1:
        # Of several places, each at the nearest scale: what is between them smooths the step to the next.
        scale = np.floor(scale + 0.5)
    fine = min(int(scale), count - 1)
    coarse = min(fine + 1, count - 1)
    part = min(max(scale - fine, 0.0), 1.0)
    red, green, blue = 0.0, 0.0, 0.0
    for tap in range(taps):
        offset = (tap + 0.5) / taps - 0.5
        u, v = at[0] + offset * ax / columns, at[1] + offset * ay / rows
        c = _between(texels, scales, first + fine, u, v)
        red, green, blue = red + (1.0 - part) * c[0], green + (1.0 - part) * c[1], blue + (1.0 - part) * c[2]
        if part > 0.0:
            c = _between(texels, scales, first + coarse, u, v)
            red, green, blue = red + part * c[0], green + part * c[1], blue + part * c[2]
    return (red / taps, green / taps, blue / taps)


@inlined
def _between(texels: Any, scales: Any, scale: Any, u: Any, v: Any) -> Any:
    """Colour of a scale at a place, between its four texels, the outermost of which go on beyond its edges."""
    begin, columns, rows = scales[scale, 0], scales[scale, 1], scales[scale, 2]
    x = min(max(u * columns - 0.5, 0.0), columns - 1.0)
    y = min(max(v * rows - 0.5, 0.0), rows - 1.0)
    column, line = int(x), int(y)
    x, y = x - column, y - line
    upper = begin + line * columns + column
    lower = upper + columns if line + 1 < rows else upper
    step = 1 if column + 1 < columns else 0
    a, b, c, d = (1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y
    return (
        a * texels[upper, 0] + b * texels[upper + step, 0] + c * texels[lower, 0] + d * texels[lower + step, 0],
        a * texels[upper, 1] + b * texels[upper + step, 1] + c * texels[lower, 1] + d * texels[lower + step, 1],
        a * texels[upper, 2] + b * texels[upper + step, 2] + c * texels[lower, 2] + d * texels[lower + step, 2],
    )
