"""Compiled loops of the refinement: comparison of views at a depth map, and second differences."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled
from mirrorcam.optics.light_field.depth.parallax import Parallax
from mirrorcam.optics.light_field.depth.sweep import Sweep

Float32 = NDArray[np.float32]

OUTLIER = 3.0
"""Residual over 3x3 pixels, in standard deviations, above which a view probably shows another surface."""
HIDING_PX = 1.0
"""Least difference in motion of the farthest view by which a nearer surface hides another."""


class SweepPinhole(NamedTuple):
    """A `Parallax` as a function of the planes of a sweep."""

    focal: np.float32
    cx: np.float32
    cy: np.float32
    x: np.float32
    y: np.float32
    z: np.float32
    front: np.float32
    reference: np.float32
    first: np.float32
    step: np.float32

    @classmethod
    def of(cls, view: Parallax, sweep: Sweep) -> SweepPinhole:
        x, y, z = view.position_mm
        numbers = (view.focal_px, *view.centre_px, x, y, z, 1.0 - z / view.reference_distance_mm)
        further = (1.0 / view.reference_distance_mm, float(sweep.inverse_distances[0]), sweep.step)
        return cls(*(np.float32(number) for number in (*numbers, *further)))


class View(NamedTuple):
    """Gradients of brightness (v, u, 2) of a view, its mask (v, u) of samples, and its nearest planes (v, u)."""

    gradients: Any
    seen: Any
    nearest: Any


class Terms(NamedTuple):
    """Sums (v, u) over the views.

    Attributes
    ----------
    information, gradient
        Gauss-Newton Hessian and gradient of half the sum of squared residuals, by the plane.
    agreeing, seeing
        Sum of weights, and number of views that see the pixel.
    squares
        Weighted squared residuals, over their variances.
    products, energies
        Products of both views' gradients, and half the sum of their squares, where the view is not hidden.
    """

    information: Any
    gradient: Any
    agreeing: Any
    seeing: Any
    squares: Any
    products: Any
    energies: Any


@compiled
def _cubic(t: float, out: Float32) -> None:
    """Weights (4,) of Catmull-Rom interpolation at fraction `t` between the middle two samples."""
    half, one = np.float32(0.5), np.float32(1.0)
    out[0] = ((-half * t + one) * t - half) * t
    out[1] = (np.float32(1.5) * t - np.float32(2.5)) * t * t + one
    out[2] = ((np.float32(-1.5) * t + np.float32(2.0)) * t + half) * t
    out[3] = (half * t - half) * t * t


@compiled
def _compared(
    y: int,
    planes: Float32,
    own: Float32,
    derivatives: Float32,
    pinhole: SweepPinhole,
    view: View,
    hiding: float,
    out: Float32,
) -> None:
    """Fill rows of `out` (6, u) for row `y`: residuals of two gradients, their derivatives by the plane, two masks."""
    height, width = planes.shape
    half, one = np.float32(0.5), np.float32(1.0)
    across, down = np.empty(4, np.float32), np.empty(4, np.float32)
    value = np.empty(2, np.float32)
    for x in range(width):
        plane = planes[y, x]
        inverse = plane * pinhole.step + pinhole.first
        magnification = one / (one - pinhole.z * inverse)
        scale = pinhole.front * magnification
        shift = pinhole.focal * (pinhole.reference - scale * inverse)
        column = scale * (np.float32(x) - pinhole.cx) + (shift * pinhole.x + pinhole.cx)
        row = scale * (np.float32(y) - pinhole.cy) + (shift * pinhole.y + pinhole.cy)
        for part in range(6):
            out[part, x] = 0.0
        if not (column >= 0 and row >= 0 and column <= width - 1 and row <= height - 1):
            continue
        x0, y0 = int(column), int(row)
        if view.seen[y0, x0] == 0:
            continue
        _cubic(column - np.float32(x0), across)
        _cubic(row - np.float32(y0), down)
        value[:] = 0.0
        if x0 >= 1 and y0 >= 1 and x0 + 2 < width and y0 + 2 < height:
            for j in range(4):
                line = view.gradients[np.uint32(y0 - 1 + j)]
                for c in range(2):
                    row_value = np.float32(0.0)
                    for i in range(4):
                        row_value += across[i] * line[np.uint32(x0 - 1 + i), c]
                    value[c] += down[j] * row_value
        else:
            for j in range(4):
                line = view.gradients[min(max(y0 - 1 + j, 0), height - 1)]
                for c in range(2):
                    row_value = np.float32(0.0)
                    for i in range(4):
                        row_value += across[i] * line[min(max(x0 - 1 + i, 0), width - 1), c]
                    value[c] += down[j] * row_value
        by_plane = scale * magnification * pinhole.step
        move_across = by_plane * (pinhole.z * (np.float32(x) - pinhole.cx) - pinhole.focal * pinhole.x)
        move_down = by_plane * (pinhole.z * (np.float32(y) - pinhole.cy) - pinhole.focal * pinhole.y)
        for c in range(2):
            out[c, x] = value[c] - own[y, x, c]
            out[2 + c, x] = derivatives[c, 0, y, x] * move_across + derivatives[c, 1, y, x] * move_down
        out[4, x] = one
        hidden = view.nearest[min(int(row + half), height - 1), min(int(column + half), width - 1)] > plane + hiding
        out[5, x] = np.float32(0.0) if hidden else one


@compiled
def add_terms(
    first: int,
    last: int,
    planes: Float32,
    own: Float32,
    derivatives: Float32,
    variance: Float32,
    pinhole: SweepPinhole,
    view: View,
    hiding: float,
    terms: Terms,
) -> None:
    """Add the terms of a view in rows `first` to `last` of a map of planes (v, u).

    `own` (v, u, 2), `derivatives` (2, 2, v, u) and `variance` (v, u) describe the reference view's gradients.
    """
    height, width = planes.shape
    top, bottom = max(first - 1, 0), min(last + 1, height)
    rows = np.empty((bottom - top, 6, width), np.float32)
    squares = np.empty((bottom - top, width), np.float32)
    for y in range(top, bottom):
        row = rows[y - top]
        _compared(y, planes, own, derivatives, pinhole, view, hiding, row)
        for x in range(width):
            squares[y - top, x] = (row[0, x] * row[0, x] + row[1, x] * row[1, x]) / variance[y, x]
    mean = np.empty(width, np.float32)
    ninth, limit, one, half = np.float32(1.0 / 9.0), np.float32(1.0 / OUTLIER**2), np.float32(1.0), np.float32(0.5)
    for y in range(first, last):
        # Reflect at the picture border.
        above = y - 1 if y > 0 else 1
        below = y + 1 if y < height - 1 else height - 2
        for x in range(width):
            mean[x] = (
                squares[above - top, x] * rows[above - top, 5, x]
                + squares[y - top, x] * rows[y - top, 5, x]
                + squares[below - top, x] * rows[below - top, 5, x]
            )
        row = rows[y - top]
        for x in range(width):
            left, right = x - 1 if x > 0 else 1, x + 1 if x < width - 1 else width - 2
            unlike = one + (mean[left] + mean[x] + mean[right]) * ninth * limit
            weight = row[5, x] / (unlike * unlike)
            precision = weight / variance[y, x]
            terms.information[y, x] += precision * (row[2, x] * row[2, x] + row[3, x] * row[3, x])
            terms.gradient[y, x] += precision * (row[2, x] * row[0, x] + row[3, x] * row[1, x])
            terms.agreeing[y, x] += weight
            terms.seeing[y, x] += row[4, x]
            terms.squares[y, x] += weight * squares[y - top, x]
            across, down = own[y, x, 0], own[y, x, 1]
            shown_across, shown_down = across + row[0, x], down + row[1, x]
            terms.products[y, x] += row[5, x] * (across * shown_across + down * shown_down)
            energy = across * across + down * down + shown_across * shown_across + shown_down * shown_down
            terms.energies[y, x] += row[5, x] * half * energy


@compiled
def bends(values: Float32, across: Float32, down: Float32, bend_across: Float32, bend_down: Float32) -> None:
    """Fill the weighted second differences of a map (v, u); weights are zero in the outer columns or rows."""
    height, width = values.shape
    for y in range(height):
        for x in range(width):
            value = np.float32(2.0) * values[y, x]
            bend_across[y, x], bend_down[y, x] = 0.0, 0.0
            if 0 < x < width - 1:
                bend_across[y, x] = across[y, x] * (values[y, x - 1] - value + values[y, x + 1])
            if 0 < y < height - 1:
                bend_down[y, x] = down[y, x] * (values[y - 1, x] - value + values[y + 1, x])


@compiled
def applied(anchors: Float32, values: Float32, bend_across: Float32, bend_down: Float32, out: Float32) -> None:
    """Apply the normal matrix of `anchors` (v, u) plus weighted second differences to `values` (v, u)."""
    height, width = values.shape
    two = np.float32(2.0)
    for y in range(height):
        for x in range(width):
            total = -two * (bend_across[y, x] + bend_down[y, x])
            if x > 0:
                total += bend_across[y, x - 1]
            if x < width - 1:
                total += bend_across[y, x + 1]
            if y > 0:
                total += bend_down[y - 1, x]
            if y < height - 1:
                total += bend_down[y + 1, x]
            out[y, x] = anchors[y, x] * values[y, x] + total
