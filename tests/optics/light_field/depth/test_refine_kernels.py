"""Pinholes in single precision and second differences, against `Parallax` and explicit matrices."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.light_field.depth.parallax import other_views, parallax
from mirrorcam.optics.light_field.depth.refine_kernels import SweepPinhole, Terms, View, add_terms, applied, bends
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
    # Slopes that are linear over the picture: interpolation is exact.
    gradients = np.stack([0.5 * u - 0.2 * v, 0.1 * u + 0.3 * v], axis=-1)
    derivatives = np.empty((2, 2, *SHAPE), np.float32)
    derivatives[:] = np.array([[0.5, -0.2], [0.1, 0.3]], np.float32)[..., None, None]
    where = np.full(SHAPE, 20.0, np.float32) + 0.1 * u
    inverse = planes.inverse_distance(where)
    across, down = view.pixels(u, v, inverse)
    move = np.stack([each * planes.step for each in view.slopes(u, v, inverse)])
    shown = np.stack([0.5 * across - 0.2 * down, 0.1 * across + 0.3 * down])
    residual = shown - np.moveaxis(gradients, -1, 0)
    rise = np.einsum("cavu,avu->cvu", derivatives, move)
    terms = Terms(*(np.zeros(SHAPE, np.float32) for _ in Terms._fields))
    nothing = np.full(SHAPE, -1e9, np.float32)
    # So much noise that there are no outliers.
    variance = np.full(SHAPE, 1e6, np.float32)
    looked = View(gradients, np.ones(SHAPE, np.uint8), nothing)
    for band in ((0, 40), (40, 90)):
        add_terms(
            *band,
            where,
            gradients,
            derivatives,
            variance,
            SweepPinhole.of(view, planes),
            looked,
            np.float32(1.0),
            terms,
        )
    inside = (across > 2) & (across < SHAPE[1] - 4) & (down > 2) & (down < SHAPE[0] - 4)
    assert inside.mean() > 0.5
    np.testing.assert_allclose(terms.seeing[inside], 1.0)
    np.testing.assert_allclose(terms.agreeing[inside], 1.0, atol=1e-3)
    for found, expected in (
        (terms.gradient, (rise * residual).sum(axis=0)),
        (terms.information, np.square(rise).sum(axis=0)),
        (terms.squares, np.square(residual).sum(axis=0)),
    ):
        np.testing.assert_allclose(found[inside] * 1e6, expected[inside], rtol=5e-3, atol=1e-2)
    outside = (across < 0) | (across > SHAPE[1] - 1)
    assert (terms.seeing[outside] == 0.0).all()


def test_the_normal_matrix_equals_that_of_second_differences() -> None:
    random = np.random.default_rng(1)
    rows, columns = 5, 7
    size = rows * columns
    across, down = random.uniform(0.5, 2.0, (2, rows, columns)).astype(np.float32)
    across[:, [0, -1]] = 0.0
    down[[0, -1]] = 0.0
    held = random.uniform(0.1, 1.0, (rows, columns)).astype(np.float32)
    matrix = np.diag(held.ravel().astype(float))
    for weights, step in ((across, 1), (down, columns)):
        for at in range(size):
            if weights.ravel()[at] > 0:
                row = np.zeros(size)
                row[[at - step, at, at + step]] = 1.0, -2.0, 1.0
                matrix += weights.ravel()[at] * np.outer(row, row)
    values = random.normal(size=(rows, columns)).astype(np.float32)
    work = np.empty((2, rows, columns), np.float32)
    found = np.empty_like(values)
    bends(values, across, down, *work)
    applied(held, values, *work, found)
    np.testing.assert_allclose(found.ravel(), matrix @ values.ravel(), rtol=1e-4, atol=1e-4)
