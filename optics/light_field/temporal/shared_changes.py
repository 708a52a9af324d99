"""How much of the change from frame to frame is each view's own: noise is, and motion is not.

Where something moves, all views show the same change, at one disparity; noise of one view has nothing in common with
that of another. So a scene that moves all over, with a texture as fine as noise, is not taken for noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.light_field import LightField, Views

Float32 = NDArray[np.float32]

SIDE_PX = 10
BLOCKS = 64
"""Number of blocks of the reference view that are compared, about."""
NEIGHBOURS = 4
MOST_DISPARITY_PX = 24
"""Largest disparity that is tried, of the nearest neighbour."""
LOW_QUANTILE = 0.25


def neighbours(views: Views) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """The reference view, its nearest neighbours (n,) and the shifts (d, n, 2) of disparities in them, right and down.

    Views are numbered row by row; a disparity moves the nearest neighbour by as many pixels.
    """
    places = views.positions_mm.reshape(-1, 3)[:, :2]
    distance = np.linalg.norm(places, axis=1)
    order = np.argsort(distance, kind="stable")
    near = order[1 : NEIGHBOURS + 1]
    near = near[distance[near] > 0]
    if not len(near):
        return int(order[0]), near, np.zeros((0, 0, 2), np.int64)
    steps = places[near] / distance[near].min()
    most = min(MOST_DISPARITY_PX, min(views.width_px, views.height_px) // 4)
    disparities = np.arange(-most, most + 1)
    return int(order[0]), near, np.rint(disparities[:, None, None] * steps).astype(np.int64)


@compiled
def _changes(now: Any, before: Any, gain: Any, channel: int, out: Any) -> None:
    """Change (v, u) of one channel of a view (v, u, c), with what was before in the light of now by gains (v, c)."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            out[y, x] = np.float32(now[y, x, channel]) - gain[y, channel] * np.float32(before[y, x, channel])


@compiled
def _compare(own: Any, others: Any, shifts: Any, stride: int, out: Any) -> int:
    """Fill energies (2, b) of blocks' changes, all and each view's own, and return their number."""
    height, width = own.shape
    found = 0
    for top in range((stride - SIDE_PX) // 2, height - SIDE_PX + 1, stride):
        for left in range((stride - SIDE_PX) // 2, width - SIDE_PX + 1, stride):
            energy = np.float32(0.0)
            for y in range(top, top + SIDE_PX):
                for x in range(left, left + SIDE_PX):
                    energy += own[y, x] * own[y, x]
            most, least, tried = np.float32(-1.0), np.float32(1.0), 0
            for number in range(len(shifts)):
                product, scale = np.float32(0.0), np.float32(0.0)
                for k in range(len(others)):
                    across, down = shifts[number, k, 0], shifts[number, k, 1]
                    inside = left + across >= 0 and left + across + SIDE_PX <= width
                    if not inside or top + down < 0 or top + down + SIDE_PX > height:
                        continue
                    part, other = np.float32(0.0), np.float32(0.0)
                    for y in range(top, top + SIDE_PX):
                        ours = own[y, left : left + SIDE_PX]
                        theirs = others[k, y + down, left + across : left + across + SIDE_PX]
                        for x in range(SIDE_PX):
                            part += ours[x] * theirs[x]
                            other += theirs[x] * theirs[x]
                    product += part
                    scale += np.sqrt(energy * other)
                if scale > 0:
                    most, least = max(most, product / scale), min(least, product / scale)
                    tried += 1
            # By chance, the most and the least are as far from zero.
            shared = max(most + min(least, np.float32(0.0)), np.float32(0.0)) if tried > 0 else np.float32(0.0)
            out[0, found], out[1, found] = energy, energy * (np.float32(1.0) - min(shared, np.float32(1.0)))
            found += 1
    return found


def own_share(now: LightField, before: LightField, gains: Float32) -> float:
    """Share, 0 to 1, of the change between two frames that neighbouring views do not share, where little changes.

    Parameters
    ----------
    now, before
        Consecutive frames of the same views.
    gains
        Gains (k, v, c) of rows that bring what was before to the brightness of now.
    """
    reference, near, shifts = neighbours(now)
    height, width = now.height_px, now.width_px
    if not len(near) or min(height, width) < 2 * SIDE_PX:
        return 1.0
    new, old = (each.samples.reshape(-1, *each.samples.shape[2:]) for each in (now, before))
    channel = new.shape[-1] // 2
    changes = np.empty((1 + len(near), height, width), np.float32)
    for number, view in enumerate([reference, *near]):
        _changes(new[view], old[view], gains[view], channel, changes[number])
    stride = max(SIDE_PX, int(np.sqrt(height * width / BLOCKS)))
    energies: Any = np.empty((2, (height // SIDE_PX + 1) * (width // SIDE_PX + 1)), np.float32)
    count = _compare(changes[0], changes[1:], shifts, stride, energies)
    everything, own = np.quantile(energies[:, :count], LOW_QUANTILE, axis=1)
    return float(own / everything) if everything > 0 else 1.0
