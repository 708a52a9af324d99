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
"""RMS residual over 3x3 pixels, in standard deviations, above which a view probably shows another surface."""
OCCLUSION_PX = 1.0
"""Minimum difference in disparity at the longest baseline by which a nearer surface hides another."""


class SweepPinhole(NamedTuple):
    """A `Parallax` as a function of the planes of a sweep, for a grid of points `spacing` pixels apart.

    Point (i, j) of the grid is at pixel (spacing i + offset, spacing j + offset) of the reference view.
    """

    focal: np.float32
    cx: np.float32
    cy: np.float32
    x: np.float32
    y: np.float32
    z: np.float32
    front: np.float32
    inverse_reference: np.float32
    first: np.float32
    step: np.float32
    spacing: np.float32
    offset: np.float32

    @classmethod
    def of(cls, view: Parallax, sweep: Sweep, spacing: int = 1) -> SweepPinhole:
        x, y, z = view.position_mm
        numbers = (view.focal_px, *view.centre_px, x, y, z, 1.0 - z / view.reference_distance_mm)
        depth_numbers = (1.0 / view.reference_distance_mm, float(sweep.inverse_distances[0]), sweep.step)
        return cls(*(np.float32(number) for number in (*numbers, *depth_numbers, spacing, (spacing - 1) / 2)))


class View(NamedTuple):
    """A view's brightness gradients (v, u, 2), mask (v, u) of samples, and nearest plane (j, i) at points of the grid.

    The gradients and the mask are those at pixels (u + offset, v + offset), as of a `SweepPinhole`.
    """

    gradients: Any
    valid: Any
    nearest: Any


class Terms(NamedTuple):
    """Sums (v, u) over the views.

    Attributes
    ----------
    information, gradient
        Gauss-Newton Hessian and gradient of half the sum of squared residuals, with respect to the plane.
    weight_sum, view_count
        Sum of weights, and number of views that see the pixel.
    squares
        Weighted squared residuals, over their variances.
    products, energies
        Dot products of a view's gradient and the reference view's, and half the sum of their squares, where the view
        is not occluded.
    """

    information: Any
    gradient: Any
    weight_sum: Any
    view_count: Any
    squares: Any
    products: Any
    energies: Any


@compiled
def _cubic(t: float, out: Float32) -> None:
    """Weights (4,) of Catmull-Rom interpolation at fraction `t` between the two inner samples."""
    half, one = np.float32(0.5), np.float32(1.0)
    out[0] = ((-half * t + one) * t - half) * t
    out[1] = (np.float32(1.5) * t - np.float32(2.5)) * t * t + one
    out[2] = ((np.float32(-1.5) * t + np.float32(2.0)) * t + half) * t
    out[3] = (half * t - half) * t * t


@compiled
def _compare_row(
    y: int,
    planes: Float32,
    reference: Float32,
    derivatives: Float32,
    pinhole: SweepPinhole,
    view: View,
    occlusion_gap: float,
    out: Float32,
) -> None:
    """Fill `out` (6, u) for row `y`: two gradient residuals, their derivatives with respect to the plane, two masks."""
    grid_height, grid_width = planes.shape
    height, width = view.valid.shape
    half, one = np.float32(0.5), np.float32(1.0)
    grid_per_px = one / pinhole.spacing
    own_v = pinhole.spacing * np.float32(y) + pinhole.offset
    cubic_u, cubic_v = np.empty(4, np.float32), np.empty(4, np.float32)
    value = np.empty(2, np.float32)
    for x in range(grid_width):
        plane, own_u = planes[y, x], pinhole.spacing * np.float32(x) + pinhole.offset
        inverse = plane * pinhole.step + pinhole.first
        magnification = one / (one - pinhole.z * inverse)
        scale = pinhole.front * magnification
        shift = pinhole.focal * (pinhole.inverse_reference - scale * inverse)
        column = scale * (own_u - pinhole.cx) + (shift * pinhole.x + pinhole.cx) - pinhole.offset
        row = scale * (own_v - pinhole.cy) + (shift * pinhole.y + pinhole.cy) - pinhole.offset
        for part in range(6):
            out[part, x] = 0.0
        if not (column >= 0 and row >= 0 and column <= width - 1 and row <= height - 1):
            continue
        x0, y0 = int(column), int(row)
        if view.valid[y0, x0] == 0:
            continue
        _cubic(column - np.float32(x0), cubic_u)
        _cubic(row - np.float32(y0), cubic_v)
        value[:] = 0.0
        if x0 >= 1 and y0 >= 1 and x0 + 2 < width and y0 + 2 < height:
            for j in range(4):
                line = view.gradients[np.uint32(y0 - 1 + j)]
                for c in range(2):
                    row_value = np.float32(0.0)
                    for i in range(4):
                        row_value += cubic_u[i] * line[np.uint32(x0 - 1 + i), c]
                    value[c] += cubic_v[j] * row_value
        else:
            for j in range(4):
                line = view.gradients[min(max(y0 - 1 + j, 0), height - 1)]
                for c in range(2):
                    row_value = np.float32(0.0)
                    for i in range(4):
                        row_value += cubic_u[i] * line[min(max(x0 - 1 + i, 0), width - 1), c]
                    value[c] += cubic_v[j] * row_value
        scale_step = scale * magnification * pinhole.step
        step_u = scale_step * (pinhole.z * (own_u - pinhole.cx) - pinhole.focal * pinhole.x)
        step_v = scale_step * (pinhole.z * (own_v - pinhole.cy) - pinhole.focal * pinhole.y)
        for c in range(2):
            out[c, x] = value[c] - reference[y, x, c]
            out[2 + c, x] = derivatives[c, 0, y, x] * step_u + derivatives[c, 1, y, x] * step_v
        out[4, x] = one
        j, i = (
            min(int(row * grid_per_px + half), grid_height - 1),
            min(int(column * grid_per_px + half), grid_width - 1),
        )
        out[5, x] = np.float32(0.0) if view.nearest[j, i] > plane + occlusion_gap else one


@compiled
def add_terms(
    first: int,
    last: int,
    planes: Float32,
    reference: Float32,
    derivatives: Float32,
    variance: Float32,
    pinhole: SweepPinhole,
    view: View,
    occlusion_gap: float,
    terms: Terms,
) -> None:
    """Add the terms of a view in rows `first` to `last` of a map of planes (j, i) on a grid.

    `reference` (j, i, 2) holds the reference view's gradients, with `derivatives` (2, 2, j, i) and `variance` (j, i).
    """
    height, width = planes.shape
    top, bottom = max(first - 1, 0), min(last + 1, height)
    rows = np.empty((bottom - top, 6, width), np.float32)
    squares = np.empty((bottom - top, width), np.float32)
    for y in range(top, bottom):
        row = rows[y - top]
        _compare_row(y, planes, reference, derivatives, pinhole, view, occlusion_gap, row)
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
            misfit = one + (mean[left] + mean[x] + mean[right]) * ninth * limit
            weight = row[5, x] / (misfit * misfit)
            precision = weight / variance[y, x]
            terms.information[y, x] += precision * (row[2, x] * row[2, x] + row[3, x] * row[3, x])
            terms.gradient[y, x] += precision * (row[2, x] * row[0, x] + row[3, x] * row[1, x])
            terms.weight_sum[y, x] += weight
            terms.view_count[y, x] += row[4, x]
            terms.squares[y, x] += weight * squares[y - top, x]
            reference_u, reference_v = reference[y, x, 0], reference[y, x, 1]
            view_u, view_v = reference_u + row[0, x], reference_v + row[1, x]
            terms.products[y, x] += row[5, x] * (reference_u * view_u + reference_v * view_v)
            energy = reference_u * reference_u + reference_v * reference_v + view_u * view_u + view_v * view_v
            terms.energies[y, x] += row[5, x] * half * energy


@compiled
def second_differences(values: Float32, weight_u: Float32, weight_v: Float32, out_u: Float32, out_v: Float32) -> None:
    """Fill the weighted second differences of a map (v, u) along u and v; zero in the outer columns or rows."""
    height, width = values.shape
    two = np.float32(2.0)
    # Each loop runs over slices, which lets the compiler vectorise.
    for y in range(height):
        row, row_u, row_v = values[y], out_u[y], out_v[y]
        row_u[0], row_u[width - 1] = 0.0, 0.0
        left, middle, right = row[: width - 2], row[1 : width - 1], row[2:]
        weights, inner = weight_u[y, 1 : width - 1], row_u[1 : width - 1]
        for x in range(len(inner)):
            inner[x] = weights[x] * (left[x] - two * middle[x] + right[x])
        if y == 0 or y == height - 1:
            row_v[:] = 0.0
            continue
        above, below, weights = values[y - 1], values[y + 1], weight_v[y]
        for x in range(width):
            row_v[x] = weights[x] * (above[x] - two * row[x] + below[x])


@compiled
def apply_normal_matrix(anchors: Float32, values: Float32, second_u: Float32, second_v: Float32, out: Float32) -> None:
    """Apply to `values` the normal matrix of `anchors` (v, u) and second differences `second_u` and `second_v`."""
    height, width = values.shape
    two = np.float32(2.0)
    outside = np.zeros(width, np.float32)
    for y in range(height):
        above = second_v[y - 1] if y > 0 else outside
        below = second_v[y + 1] if y < height - 1 else outside
        row_u, row_v, row_anchors, row, row_out = second_u[y], second_v[y], anchors[y], values[y], out[y]
        for x in range(width):
            row_out[x] = row_anchors[x] * row[x] - two * (row_u[x] + row_v[x]) + above[x] + below[x]
        before, after = row_u[: width - 1], row_u[1:]
        inner = row_out[1:]
        for x in range(width - 1):
            inner[x] += before[x]
        for x in range(width - 1):
            row_out[x] += after[x]
