"""Depth edges moved to the edges of the picture: weighted medians where depths jump."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.cost import bands

Float32 = NDArray[np.float32]
Map = Callable[..., Any]

RADIUS_PX = 3
JUMP_RADIUS_PX = 2
COLOUR_GREY = 20.0
"""Sum of the differences of three colours, of 255 each, at which a neighbour's say falls by a factor of e."""


@compiled
def _medians(first: Any, last: Any, planes: Any, picture: Any, jump: Any, out: Any) -> None:
    height, width = planes.shape
    most = (2 * RADIUS_PX + 1) ** 2
    values, weights = np.empty(most, np.float32), np.empty(most, np.float32)
    for y in range(first, last):
        for x in range(width):
            low = high = out[y, x] = planes[y, x]
            for j in range(max(y - JUMP_RADIUS_PX, 0), min(y + JUMP_RADIUS_PX + 1, height)):
                for i in range(max(x - JUMP_RADIUS_PX, 0), min(x + JUMP_RADIUS_PX + 1, width)):
                    low, high = min(low, planes[j, i]), max(high, planes[j, i])
            if high - low < jump:
                continue
            count, total = 0, np.float32(0.0)
            for j in range(max(y - RADIUS_PX, 0), min(y + RADIUS_PX + 1, height)):
                for i in range(max(x - RADIUS_PX, 0), min(x + RADIUS_PX + 1, width)):
                    apart = np.float32(0.0)
                    for colour in range(3):
                        apart += abs(picture[j, i, colour] - picture[y, x, colour])
                    away = np.float32((j - y) * (j - y) + (i - x) * (i - x)) / np.float32(RADIUS_PX * RADIUS_PX)
                    weight = np.exp(-apart / np.float32(COLOUR_GREY) - away)
                    place = count - 1
                    while place >= 0 and values[place] > planes[j, i]:
                        values[place + 1], weights[place + 1] = values[place], weights[place]
                        place -= 1
                    values[place + 1], weights[place + 1] = planes[j, i], weight
                    total += weight
                    count += 1
            passed = np.float32(0.0)
            for number in range(count):
                passed += weights[number]
                if passed >= np.float32(0.5) * total:
                    out[y, x] = values[number]
                    break


def follow_edges(planes: Float32, picture: Float32, jump: float, run: Map = map) -> Float32:
    """A map (v, u) whose values beside jumps are those of neighbours of like colour (Ma et al., ICCV 2013).

    `picture` has colours (v, u, 3), 0 to 255; a jump is a difference of more than `jump` nearby.
    """
    out = np.empty_like(planes)
    list(run(lambda band: _medians(*band, planes, picture, np.float32(jump), out), bands(planes.shape[0])))
    return out
