"""Arithmetic of tuples, against NumPy.

Rays and triangles, with the tree and without.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.mesh_shapes import leaves
from mirrorcam.render_scenes.preview.triangle_tree import (
    COUNT,
    MAX_LEAF_TRIANGLES,
    NEXT,
    NOTHING,
    add_scaled,
    cross,
    dot,
    load3,
    map_normal,
    map_point,
    map_vector,
    nearest_triangle,
    scale,
    subtract,
    triangle_tree,
    unit,
)

RANDOM = np.random.default_rng(0)
TABLE = RANDOM.standard_normal((3, 17))
A, B = RANDOM.standard_normal((2, 3))
a, b = tuple(A.tolist()), tuple(B.tolist())


def test_sums_and_products_are_those_of_numpy() -> None:
    np.testing.assert_allclose(dot(a, b), A @ B)
    np.testing.assert_allclose(add_scaled(a, 0.3, b), A + 0.3 * B)
    np.testing.assert_allclose(subtract(a, b), A - B)
    np.testing.assert_allclose(scale(a, 0.3), 0.3 * A)
    np.testing.assert_allclose(cross(a, b), np.cross(A, B))
    np.testing.assert_allclose(unit(a), A / np.linalg.norm(A))


def test_maps_are_read_from_a_row_of_a_table() -> None:
    matrix = TABLE[1, 4:16].reshape(3, 4)
    np.testing.assert_allclose(load3(TABLE, 1, 5), TABLE[1, 5:8])
    np.testing.assert_allclose(map_point(TABLE, 1, 4, a), matrix @ [*A, 1.0])
    np.testing.assert_allclose(map_vector(TABLE, 1, 4, a), matrix[:, :3] @ A)
    np.testing.assert_allclose(map_normal(TABLE, 1, 4, a), matrix[:, :3].T @ A)


SURFACE = leaves(1.0, 3)
TREE = triangle_tree(SURFACE)


def test_every_triangle_is_in_one_small_box() -> None:
    counts = TREE.boxes[:, COUNT]
    assert counts.sum() == len(SURFACE.faces) == len(TREE.triangles)
    assert counts.max() <= MAX_LEAF_TRIANGLES
    assert TREE.boxes[0, NEXT] == len(TREE.boxes)
    made = np.sort(TREE.triangles[:, :3].sum(axis=1))
    np.testing.assert_allclose(made, np.sort(SURFACE.points[SURFACE.faces[:, 0]].sum(axis=1)), atol=1e-12)


def test_the_tree_finds_what_a_search_of_all_triangles_finds() -> None:
    random = np.random.default_rng(1)
    everything = TREE.boxes[:1].copy()
    everything[0, [NEXT, COUNT]] = 1, len(TREE.triangles)
    met = 0
    for _ in range(300):
        start, end = random.uniform(-1.0, 1.0, (2, 3))
        ray = tuple(start.tolist()), tuple((end - start).tolist())
        number, length = nearest_triangle(TREE.boxes, TREE.triangles, *ray, 0.0, np.inf, True)
        assert (number, length) == nearest_triangle(everything, TREE.triangles, *ray, 0.0, np.inf, True)
        any_one, _ = nearest_triangle(TREE.boxes, TREE.triangles, *ray, 0.0, np.inf, False)
        assert (any_one == NOTHING) == (number == NOTHING)
        met += number != NOTHING
    assert 30 < met < 270


def test_a_triangle_is_hit_within_its_sides_and_between_the_limits() -> None:
    corner, first, second = np.split(TREE.triangles[0, :9], 3)
    normal = np.cross(first, second)
    for u, v, least, hit in (
        (0.3, 0.3, 0.0, True),
        (0.6, 0.6, 0.0, False),
        (-0.1, 0.5, 0.0, False),
        (0.3, 0.3, 1.1, False),
    ):
        start = corner + u * first + v * second - normal
        alone = np.array([[-9.0] * 3 + [9.0] * 3 + [1.0, 0.0, 1.0]])
        number, length = nearest_triangle(alone, TREE.triangles, tuple(start), tuple(normal), least, np.inf, True)
        assert (number == 0) == hit
        if hit:
            assert length == pytest.approx(1.0)
