"""Compiled loops of the refinement: comparison of views at a depth map, and conjugate gradients."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import compiled, inlined
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


@inlined
def _cubic(t: float) -> Any:
    """Weights of Catmull-Rom interpolation at fraction `t` between the two inner samples of four."""
    half, one = np.float32(0.5), np.float32(1.0)
    return (
        ((-half * t + one) * t - half) * t,
        (np.float32(1.5) * t - np.float32(2.5)) * t * t + one,
        ((np.float32(-1.5) * t + np.float32(2.0)) * t + half) * t,
        (half * t - half) * t * t,
    )


@inlined
def _interpolate(gradients: Float32, row: int, columns: Any, component: int, weights: Any) -> Any:
    """Return the weighted sum of a component of gradients (v, u, 2) at four columns of a row."""
    return (
        weights[0] * gradients[row, columns[0], component]
        + weights[1] * gradients[row, columns[1], component]
        + weights[2] * gradients[row, columns[2], component]
        + weights[3] * gradients[row, columns[3], component]
    )


@compiled
def _project_row(y: int, planes: Float32, pinhole: SweepPinhole, out: Float32) -> None:
    """Fill `out` (4, u) for a row (u,) of planes: where the view shows it, and the derivatives of that position."""
    one = np.float32(1.0)
    columns, lines, steps_u, steps_v = out[0], out[1], out[2], out[3]
    own_v = pinhole.spacing * np.float32(y) + pinhole.offset
    for x in range(len(planes)):
        own_u = pinhole.spacing * np.float32(x) + pinhole.offset
        inverse = planes[x] * pinhole.step + pinhole.first
        magnification = one / (one - pinhole.z * inverse)
        scale = pinhole.front * magnification
        shift = pinhole.focal * (pinhole.inverse_reference - scale * inverse)
        columns[x] = scale * (own_u - pinhole.cx) + (shift * pinhole.x + pinhole.cx) - pinhole.offset
        lines[x] = scale * (own_v - pinhole.cy) + (shift * pinhole.y + pinhole.cy) - pinhole.offset
        scale_step = scale * magnification * pinhole.step
        steps_u[x] = scale_step * (pinhole.z * (own_u - pinhole.cx) - pinhole.focal * pinhole.x)
        steps_v[x] = scale_step * (pinhole.z * (own_v - pinhole.cy) - pinhole.focal * pinhole.y)


@compiled
def _compare_row(
    y: int,
    planes: Float32,
    reference: Float32,
    derivatives: Float32,
    pinhole: SweepPinhole,
    view: View,
    occlusion_gap: float,
    work: Float32,
    out: Float32,
) -> None:
    """Fill `out` (6, u) for row `y`: two gradient residuals, their derivatives with respect to the plane, two masks.

    `work` (4, u) is a buffer.
    """
    grid_height, grid_width = planes.shape
    height, width = view.valid.shape
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    grid_per_px = one / pinhole.spacing
    _project_row(y, planes[y], pinhole, work)
    last_column, last_row = np.float32(width - 1), np.float32(height - 1)
    for x in range(grid_width):
        column, row = work[0, x], work[1, x]
        out[0, x], out[1, x], out[4, x], out[5, x] = zero, zero, zero, zero
        if not (column >= zero and row >= zero and column <= last_column and row <= last_row):
            continue
        x0, y0 = int(column), int(row)
        if view.valid[y0, x0] == 0:
            continue
        cubic_u, cubic_v = _cubic(column - np.float32(x0)), _cubic(row - np.float32(y0))
        columns = (
            np.uint32(max(x0 - 1, 0)),
            np.uint32(x0),
            np.uint32(min(x0 + 1, width - 1)),
            np.uint32(min(x0 + 2, width - 1)),
        )
        line_0, line_1 = np.uint32(max(y0 - 1, 0)), np.uint32(y0)
        line_2, line_3 = np.uint32(min(y0 + 1, height - 1)), np.uint32(min(y0 + 2, height - 1))
        for c in range(2):
            value = (
                cubic_v[0] * _interpolate(view.gradients, line_0, columns, c, cubic_u)
                + cubic_v[1] * _interpolate(view.gradients, line_1, columns, c, cubic_u)
                + cubic_v[2] * _interpolate(view.gradients, line_2, columns, c, cubic_u)
                + cubic_v[3] * _interpolate(view.gradients, line_3, columns, c, cubic_u)
            )
            out[c, x] = value - reference[y, x, c]
        out[4, x] = one
        j = min(int(row * grid_per_px + half), grid_height - 1)
        i = min(int(column * grid_per_px + half), grid_width - 1)
        out[5, x] = zero if view.nearest[j, i] > planes[y, x] + occlusion_gap else one
    steps_u, steps_v, seen = work[2], work[3], out[4]
    for c in range(2):
        along_u, along_v, derivative = derivatives[c, 0, y], derivatives[c, 1, y], out[2 + c]
        for x in range(grid_width):
            derivative[x] = seen[x] * (along_u[x] * steps_u[x] + along_v[x] * steps_v[x])


@compiled
def _add_product(a: Float32, b: Float32, c: Float32, d: Float32, factor: Float32, total: Float32) -> None:
    """Add factor (a b + c d) to `total`, all (u,)."""
    for x in range(len(total)):
        total[x] += factor[x] * (a[x] * b[x] + c[x] * d[x])


@compiled
def _add_row(
    y: int,
    row: Float32,
    squares: Float32,
    mean: Float32,
    reference: Float32,
    variance: Float32,
    work: Float32,
    terms: Terms,
) -> None:
    """Add the terms of a view in row `y`, from its comparison `row` (6, u) and its `squares` (u,).

    `mean` (u + 2,) holds the sums of squares over three rows, with a reflected border; `reference` (2, u), gradients.
    `work` (4, u) is a buffer.
    """
    ninth, limit, one, half = np.float32(1.0 / 9.0), np.float32(1.0 / OUTLIER**2), np.float32(1.0), np.float32(0.5)
    # Iteration over an array would lose its layout.
    residual_u, residual_v, derivative_u, derivative_v, seen, visible = row[0], row[1], row[2], row[3], row[4], row[5]
    weight, precision, view_u, view_v = work[0], work[1], work[2], work[3]
    width = len(squares)
    left, middle, right = mean[:width], mean[1 : width + 1], mean[2:]
    for x in range(width):
        misfit = one + (left[x] + middle[x] + right[x]) * ninth * limit
        weight[x] = visible[x] / (misfit * misfit)
    for x in range(width):
        precision[x] = weight[x] / variance[x]
    _add_product(derivative_u, derivative_u, derivative_v, derivative_v, precision, terms.information[y])
    _add_product(derivative_u, residual_u, derivative_v, residual_v, precision, terms.gradient[y])
    weight_sum, view_count, square_sum = terms.weight_sum[y], terms.view_count[y], terms.squares[y]
    for x in range(width):
        weight_sum[x] += weight[x]
    for x in range(width):
        view_count[x] += seen[x]
    for x in range(width):
        square_sum[x] += weight[x] * squares[x]
    reference_u, reference_v, energies = reference[0], reference[1], terms.energies[y]
    for x in range(width):
        view_u[x] = reference_u[x] + residual_u[x]
    for x in range(width):
        view_v[x] = reference_v[x] + residual_v[x]
    _add_product(reference_u, view_u, reference_v, view_v, visible, terms.products[y])
    for x in range(width):
        energy = reference_u[x] * reference_u[x] + reference_v[x] * reference_v[x]
        energies[x] += visible[x] * half * (energy + view_u[x] * view_u[x] + view_v[x] * view_v[x])


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
    # A row of the ring is kept while a row next to it is added: all of it stays in the cache.
    rows, squares = np.empty((3, 6, width), np.float32), np.empty((3, width), np.float32)
    work, reference_row = np.empty((4, width), np.float32), np.empty((2, width), np.float32)
    mean = np.empty(width + 2, np.float32)
    inner = mean[1 : width + 1]
    compared = max(first - 1, 0)
    for y in range(first, last):
        while compared < min(y + 2, height):
            row, row_squares, row_variance = rows[compared % 3], squares[compared % 3], variance[compared]
            _compare_row(compared, planes, reference, derivatives, pinhole, view, occlusion_gap, work, row)
            residual_u, residual_v = row[0], row[1]
            for x in range(width):
                row_squares[x] = (residual_u[x] * residual_u[x] + residual_v[x] * residual_v[x]) / row_variance[x]
            compared += 1
        inner[:] = 0.0
        # Reflect at the picture border.
        for near in (y - 1 if y > 0 else 1, y, y + 1 if y < height - 1 else height - 2):
            near_squares, near_visible = squares[near % 3], rows[near % 3, 5]
            for x in range(width):
                inner[x] += near_squares[x] * near_visible[x]
        mean[0], mean[width + 1] = mean[2], mean[width - 1]
        for c in range(2):
            for x in range(width):
                reference_row[c, x] = reference[y, x, c]
        _add_row(y, rows[y % 3], squares[y % 3], mean, reference_row, variance[y], work, terms)


@inlined
def _second_differences(values: Float32, y: int, weight_v: Float32, weight_u: Float32, v: Float32, u: Float32) -> None:
    """Fill the weighted second differences `v` (u,) and `u` (u + 2,) of row `y` of a map (v, u), the latter padded."""
    height, width = values.shape
    two, row = np.float32(2.0), values[y]
    # Each loop runs over few slices, which lets the compiler vectorise.
    inner = u[2:width]
    left, middle, right, weights = row[: width - 2], row[1 : width - 1], row[2:], weight_u[y, 1 : width - 1]
    for x in range(len(inner)):
        inner[x] = weights[x] * (left[x] - two * middle[x] + right[x])
    if y == 0 or y == height - 1:
        v[:] = 0.0
        return
    above, below, weights = values[y - 1], values[y + 1], weight_v[y]
    for x in range(width):
        v[x] = weights[x] * (above[x] - two * row[x] + below[x])


@compiled
def _multiply_next_row(
    row: int,
    values: Float32,
    anchors: Float32,
    weight_u: Float32,
    weight_v: Float32,
    ring_u: Float32,
    ring_v: Float32,
    product: Float32,
) -> None:
    """Fill row `row` - 2 of the product of the normal matrix and a map, whose rows are known up to `row`.

    `ring_u` (3, u + 2) and `ring_v` (4, u) hold the second differences of previous rows; row 3 of the latter is zero.
    """
    height, width = values.shape
    two = np.float32(2.0)
    if 1 <= row <= height:
        _second_differences(values, row - 1, weight_v, weight_u, ring_v[(row - 1) % 3], ring_u[(row - 1) % 3])
    y = row - 2
    if y < 0:
        return
    u, v, out, row_anchors, row_values = ring_u[y % 3], ring_v[y % 3], product[y], anchors[y], values[y]
    middle = u[1 : width + 1]
    for x in range(width):
        out[x] = row_anchors[x] * row_values[x] - two * (middle[x] + v[x])
    above, below = ring_v[(y - 1) % 3 if y > 0 else 3], ring_v[(y + 1) % 3 if y < height - 1 else 3]
    left, right = u[:width], u[2:]
    for x in range(width):
        out[x] = out[x] + above[x] + below[x] + left[x] + right[x]


@compiled
def conjugate_gradients(
    anchors: Float32,
    weight_u: Float32,
    weight_v: Float32,
    inverse_diagonal: Float32,
    target: Float32,
    solution: Float32,
    iterations: int,
) -> None:
    """Improve the `solution` (v, u) of A x = target by conjugate gradients with a Jacobi preconditioner.

    A is the diagonal `anchors` plus the second differences along u and v, weighted by `weight_u` and `weight_v`, which
    are zero in the outer columns or rows. Each iteration passes over the maps twice.
    """
    height, width = solution.shape
    ring_u, ring_v = np.zeros((3, width + 2), np.float32), np.zeros((4, width), np.float32)
    direction, product, residual = np.zeros_like(solution), np.empty_like(solution), np.empty_like(solution)
    # Sums over columns, then over rows: vectorised, and more exact than one sum.
    sums = np.empty(width, np.float32)
    for row in range(height + 2):
        _multiply_next_row(row, solution, anchors, weight_u, weight_v, ring_u, ring_v, product)
    alpha, beta, rz = np.float32(0.0), np.float32(0.0), 0.0
    for iteration in range(iterations + 1):
        sums[:] = 0.0
        # Upwards, to begin with the rows that are in the cache.
        for y in range(height - 1, -1, -1):
            row_residual, row_product, row_inverse = residual[y], product[y], inverse_diagonal[y]
            if iteration == 0:
                row_target = target[y]
                for x in range(width):
                    row_residual[x] = row_target[x] - row_product[x]
            else:
                for x in range(width):
                    row_residual[x] -= alpha * row_product[x]
            for x in range(width):
                sums[x] += row_residual[x] * (row_inverse[x] * row_residual[x])
        rz_before, rz = rz, 0.0
        for x in range(width):
            rz += sums[x]
        beta = np.float32(rz / max(rz_before, 1e-30)) if iteration > 0 else np.float32(0.0)
        sums[:] = 0.0
        for row in range(height + 2):
            if row < height:
                row_direction, row_solution, row_residual = direction[row], solution[row], residual[row]
                row_inverse = inverse_diagonal[row]
                for x in range(width):
                    row_solution[x] += alpha * row_direction[x]
                for x in range(width):
                    row_direction[x] = row_inverse[x] * row_residual[x] + beta * row_direction[x]
            if iteration == iterations:
                continue
            _multiply_next_row(row, direction, anchors, weight_u, weight_v, ring_u, ring_v, product)
            if row >= 2:
                row_direction, row_product = direction[row - 2], product[row - 2]
                for x in range(width):
                    sums[x] += row_direction[x] * row_product[x]
        curvature = 0.0
        for x in range(width):
            curvature += sums[x]
        alpha = np.float32(rz / max(curvature, 1e-30))
