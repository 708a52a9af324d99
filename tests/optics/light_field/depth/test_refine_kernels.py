"""Pinholes in single precision and conjugate gradients, against `Parallax` and explicit matrices."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.depth.parallax import other_views, parallax
from mirrorcam.optics.light_field.depth.refine_kernels import (
    SweepPinhole,
    Terms,
    View,
    add_terms,
    conjugate_gradients,
)
from mirrorcam.optics.light_field.depth.sweep import sweep
from tests.optics.light_field.depth.surfaces import grid_views

INVERSE_DISTANCES = np.linspace(1 / 700.0, 1 / 350.0, 60)
SHAPE = (90, 120)


def test_residuals_and_derivatives_match_linear_pictures_at_the_parallax() -> None:
    views = grid_views()
    planes = sweep(views, INVERSE_DISTANCES)
    index = other_views(views)[2]
    view = parallax(views, index)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    # Gradients that are linear over the picture: interpolation is exact.
    gradients = np.stack([0.5 * u - 0.2 * v, 0.1 * u + 0.3 * v], axis=-1)
    derivatives = np.empty((2, 2, *SHAPE), np.float32)
    derivatives[:] = np.array([[0.5, -0.2], [0.1, 0.3]], np.float32)[..., None, None]
    plane_map = np.full(SHAPE, 20.0, np.float32) + 0.1 * u
    inverse = planes.inverse_distance(plane_map)
    offset_u, offset_v = view.pixels(u, v, inverse)
    motion = np.stack([each * planes.step for each in view.derivatives(u, v, inverse)])
    sampled = np.stack([0.5 * offset_u - 0.2 * offset_v, 0.1 * offset_u + 0.3 * offset_v])
    residual = sampled - np.moveaxis(gradients, -1, 0)
    plane_derivatives = np.einsum("cavu,avu->cvu", derivatives, motion)
    terms = Terms(*(np.zeros(SHAPE, np.float32) for _ in Terms._fields))
    no_surface = np.full(SHAPE, -1e9, np.float32)
    # So much noise that there are no outliers.
    variance = np.full(SHAPE, 1e6, np.float32)
    compared = View(gradients, np.ones(SHAPE, np.uint8), no_surface)
    for band in ((0, 40), (40, 90)):
        add_terms(
            *band,
            plane_map,
            gradients,
            derivatives,
            variance,
            SweepPinhole.of(view, planes),
            compared,
            np.float32(1.0),
            terms,
        )
    inside = (offset_u > 2) & (offset_u < SHAPE[1] - 4) & (offset_v > 2) & (offset_v < SHAPE[0] - 4)
    assert inside.mean() > 0.5
    np.testing.assert_allclose(terms.view_count[inside], 1.0)
    np.testing.assert_allclose(terms.weight_sum[inside], 1.0, atol=1e-3)
    for found, expected in (
        (terms.gradient, (plane_derivatives * residual).sum(axis=0)),
        (terms.information, np.square(plane_derivatives).sum(axis=0)),
        (terms.squares, np.square(residual).sum(axis=0)),
    ):
        np.testing.assert_allclose(found[inside] * 1e6, expected[inside], rtol=5e-3, atol=1e-2)
    outside = (offset_u < 0) | (offset_u > SHAPE[1] - 1)
    assert (terms.view_count[outside] == 0.0).all()


def test_conjugate_gradients_solve_the_explicit_equations() -> None:
    random = np.random.default_rng(1)
    rows, columns = 5, 7
    size = rows * columns
    offset_u, offset_v = random.uniform(0.5, 2.0, (2, rows, columns)).astype(np.float32)
    offset_u[:, [0, -1]] = 0.0
    offset_v[[0, -1]] = 0.0
    anchors = random.uniform(0.1, 1.0, (rows, columns)).astype(np.float32)
    matrix = np.diag(anchors.ravel().astype(float))
    for weights, step in ((offset_u, 1), (offset_v, columns)):
        for at in range(size):
            if weights.ravel()[at] > 0:
                row = np.zeros(size)
                row[[at - step, at, at + step]] = 1.0, -2.0, 1.0
                matrix += weights.ravel()[at] * np.outer(row, row)
    target = random.normal(size=(rows, columns)).astype(np.float32)
    inverse_diagonal = (1.0 / np.diag(matrix)).reshape(rows, columns).astype(np.float32)
    found = np.zeros_like(target)
    conjugate_gradients(anchors, offset_u, offset_v, inverse_diagonal, target, found, size)
    np.testing.assert_allclose(found.ravel(), np.linalg.solve(matrix, target.ravel()), rtol=1e-3, atol=1e-4)
