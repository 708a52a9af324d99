"""Arithmetic of tuples, against NumPy."""

from __future__ import annotations

import numpy as np

from mirrorcam.render_scenes.preview.vectors import (
    along,
    at,
    cross,
    dot,
    mapped,
    minus,
    times,
    turned,
    turned_back,
    unit,
)

RANDOM = np.random.default_rng(0)
TABLE = RANDOM.standard_normal((3, 17))
A, B = RANDOM.standard_normal((2, 3))
a, b = tuple(A.tolist()), tuple(B.tolist())


def test_sums_and_products_are_those_of_numpy() -> None:
    np.testing.assert_allclose(dot(a, b), A @ B)
    np.testing.assert_allclose(along(a, 0.3, b), A + 0.3 * B)
    np.testing.assert_allclose(minus(a, b), A - B)
    np.testing.assert_allclose(times(a, 0.3), 0.3 * A)
    np.testing.assert_allclose(cross(a, b), np.cross(A, B))
    np.testing.assert_allclose(unit(a), A / np.linalg.norm(A))


def test_maps_are_read_from_a_row_of_a_table() -> None:
    matrix = TABLE[1, 4:16].reshape(3, 4)
    np.testing.assert_allclose(at(TABLE, 1, 5), TABLE[1, 5:8])
    np.testing.assert_allclose(mapped(TABLE, 1, 4, a), matrix @ [*A, 1.0])
    np.testing.assert_allclose(turned(TABLE, 1, 4, a), matrix[:, :3] @ A)
    np.testing.assert_allclose(turned_back(TABLE, 1, 4, a), matrix[:, :3].T @ A)
