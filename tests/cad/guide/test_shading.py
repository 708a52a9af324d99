"""The z-buffer against closed forms: areas, occlusion, shading, lines; and labels that do not cross.

Line drawings of meshes: visible edges, no hidden ones, curves without their facets.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely import LineString

from mirrorcam.cad.guide import shading
from mirrorcam.cad.guide.labels import Label, annotate, innermost_body_pixel, uncrossed_order
from mirrorcam.cad.guide.shading import Rendering, Screen, ShadedBody, edges_of, merged_lines, render, visible_lines
from mirrorcam.core.values import FloatArray

FROM_ABOVE = np.eye(3)
RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)


def box(
    low: tuple[float, float, float], high: tuple[float, float, float], rgb: tuple[float, float, float]
) -> ShadedBody:
    return ShadedBody(np.asarray(trimesh.creation.box(bounds=[low, high]).triangles), rgb)


def screen(size_px: tuple[int, int] = (200, 160)) -> Screen:
    return Screen(FROM_ABOVE, np.zeros(2), 4.0, size_px)


def test_a_box_covers_its_pixels_at_its_height() -> None:
    rendering = render([box((-10, -5, 0), (10, 5, 7), RED)], screen())
    assert (rendering.bodies == 0).sum() == 20 * 4 * 10 * 4
    np.testing.assert_allclose(rendering.z_mm[rendering.bodies == 0], 7.0)
    assert rendering.image[80, 100].argmax() == 0
    assert (rendering.image[:10] == 255).all()


def test_a_sphere_is_round_and_as_near_as_its_equation() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=15.0)
    rendering = render([ShadedBody(np.asarray(ball.triangles), RED)], screen())
    seen = rendering.bodies == 0
    assert seen.sum() == pytest.approx(np.pi * (15.0 * 4.0) ** 2, rel=0.01)
    rows, columns = np.nonzero(seen)
    # Every second fine pixel, with its middle a quarter of a pixel above and left of the coarse pixel's.
    x, y = (columns + 0.25 - 100.0) / 4.0, (80.0 - rows - 0.25) / 4.0
    inner = np.hypot(x, y) < 12.0
    expected = np.sqrt(15.0**2 - x[inner] ** 2 - y[inner] ** 2)
    np.testing.assert_allclose(rendering.z_mm[rows[inner], columns[inner]], expected, atol=0.1)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_nearer_bodies_hide_farther_ones_in_any_order(order: tuple[int, int]) -> None:
    bodies = [box((-10, -10, 0), (10, 10, 5), RED), box((-3, -3, 6), (3, 3, 8), BLUE)]
    rendering = render([bodies[i] for i in order], screen())
    assert (rendering.bodies == order.index(1)).sum() == (6 * 4) ** 2
    assert rendering.image[80, 100].argmax() == 2


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_random_triangles_agree_with_a_ray_by_ray_answer(seed: int) -> None:
    generator = np.random.default_rng(seed)
    triangles = generator.uniform((-9, -9, -5), (9, 9, 5), (6, 3, 3))
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    triangles[normals[:, 2] < 0.0] = triangles[normals[:, 2] < 0.0][:, ::-1]
    rendering = render([ShadedBody(triangle[None], RED) for triangle in triangles], screen((80, 80)))
    rows, columns = np.mgrid[0:80, 0:80]
    points = np.stack([(columns + 0.25 - 40.0) / 4.0, (40.0 - rows - 0.25) / 4.0], axis=-1)
    heights = np.full((6, 80, 80), -np.inf)
    rim = np.zeros((80, 80), dtype=bool)
    for index, triangle in enumerate(triangles):
        shares = barycentric(triangle, points)
        inside = (shares >= 0.0).all(axis=-1)
        heights[index][inside] = (shares @ triangle[:, 2])[inside]
        rim |= np.abs(shares).min(axis=-1) < 1e-3
    expected = np.where(np.isfinite(heights).any(axis=0), heights.argmax(axis=0), -1)
    ordered = np.sort(heights, axis=0)
    with np.errstate(invalid="ignore"):
        tie = ordered[-1] - ordered[-2] < 1e-3
    clear = ~rim & ~tie
    np.testing.assert_array_equal(rendering.bodies[clear], expected[clear])


def barycentric(triangle: FloatArray, points: FloatArray) -> FloatArray:
    """Barycentric coordinates (..., 3) in a triangle of points (..., 2) in plan."""
    matrix = np.vstack([triangle[:, :2].T, np.ones(3)])
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ np.linalg.inv(matrix).T


def test_lines_hide_behind_bodies_and_show_before_them() -> None:
    block = box((-10, -10, 0), (10, 10, 5), RED)
    green = (0.0, 1.0, 0.0)
    behind = render([block], screen(), [(np.array([[-9.0, 0, 2], [9, 0, 2]]), green, 2.0)])
    before = render([block], screen(), [(np.array([[-9.0, 0, 6], [9, 0, 6]]), green, 2.0)])
    assert np.array_equal(behind.image, render([block], screen()).image)
    assert (before.image[80, 70:130, 1] > 200).all()


def test_a_screen_shows_all_points_inside_its_margins() -> None:
    points = np.random.default_rng(3).normal(size=(50, 3)) * (40.0, 10.0, 3.0)
    axes = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    fitted = Screen.around(points, axes, (300, 200), (40, 20)).pixels(points)
    assert (fitted[:, 0] >= 40 - 1e-6).all()
    assert (fitted[:, 0] <= 260 + 1e-6).all()
    assert (fitted[:, 1] >= 20 - 1e-6).all()
    assert (fitted[:, 1] <= 180 + 1e-6).all()
    touching = np.isclose(fitted[:, :2].min(axis=0), (40, 20)) | np.isclose(fitted[:, :2].max(axis=0), (260, 180))
    assert touching.any()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 12))
def test_no_line_to_a_label_crosses_another(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    starts = [np.array([20.0, 40.0 * row]) for row in range(count)]
    ends = list(generator.uniform((100, 0), (400, 480), (count, 2)))
    order = uncrossed_order(starts, ends)
    assert sorted(order) == list(range(count))
    lines = [LineString([start, ends[index]]) for start, index in zip(starts, order, strict=True)]
    assert not any(a.crosses(b) for a, b in combinations(lines, 2))


def test_a_label_points_inside_the_visible_part_of_its_body() -> None:
    bodies = [
        box((-15, -10, 0), (15, 10, 5), RED),
        box((-15, -10, 6), (5, 10, 8), BLUE),
        box((0, 0, 1), (1, 1, 2), RED),
    ]
    rendering = render(bodies, screen((800, 400)))
    point = innermost_body_pixel(rendering, 0)
    assert point is not None
    assert rendering.bodies[int(point[1]), int(point[0])] == 0
    # Half hidden: the middle of the visible part, not of the complete body.
    assert point[0] > 400 + 5 * 4
    assert innermost_body_pixel(rendering, 2) is None
    named = annotate(rendering, [Label(0, "red"), Label(1, "blue"), Label(2, "hidden")])
    changed = (named != rendering.image).any(axis=-1)
    assert changed[:, :100].any()
    assert changed[:, -100:].any()


TOWARDS = np.array([0.0, 0.0, 1.0])


def rendering_of(*meshes: trimesh.Trimesh) -> Rendering:
    triangles = [np.asarray(mesh.triangles) for mesh in meshes]
    points = np.concatenate([each.reshape(-1, 3) for each in triangles])
    screen = Screen.around(points, np.eye(3), (200, 200), (4, 4))
    return render([ShadedBody(each, (1.0, 1.0, 1.0)) for each in triangles], screen)


def length_mm(mesh: trimesh.Trimesh, rendering: Rendering) -> float:
    lines = visible_lines(edges_of(mesh, TOWARDS), rendering)
    return sum(float(np.linalg.norm(line[1] - line[0])) for line in lines) / rendering.screen.px_per_mm


def test_of_a_box_seen_squarely_its_upper_face_is_drawn() -> None:
    box = trimesh.creation.box((20.0, 10.0, 5.0))
    assert length_mm(box, rendering_of(box)) == pytest.approx(60.0, rel=0.03)


def test_a_cylinder_on_its_side_is_its_outline_and_its_ends() -> None:
    cylinder = trimesh.creation.cylinder(5.0, 20.0, sections=64)
    cylinder.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, (0.0, 1.0, 0.0)))
    assert length_mm(cylinder, rendering_of(cylinder)) == pytest.approx(60.0, rel=0.05)


def test_hidden_edges_are_not_drawn() -> None:
    below = trimesh.creation.box((20.0, 10.0, 5.0))
    cover = trimesh.creation.box((10.0, 20.0, 5.0))
    cover.apply_translation((6.0, 0.0, 20.0))
    rendering = rendering_of(below, cover)
    assert length_mm(below, rendering) == pytest.approx(10.0 + 2 * 11.0, rel=0.05)
    assert length_mm(cover, rendering) == pytest.approx(60.0, rel=0.03)


def test_lines_that_meet_are_one() -> None:
    lines = [np.array([(0.0, 0.0), (1.0, 0.0)]), np.array([(1.0, 0.0), (1.0, 1.0)]), np.array([(3.0, 3.0), (4.0, 3.0)])]
    assert sorted(len(line) for line in merged_lines(lines)) == [2, 3]
    assert merged_lines([np.array([(2.0, 2.0), (2.001, 2.0)])]) == []


def test_only_the_part_of_a_picture_with_bodies_is_shaded_and_nothing_else_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    boxes = [trimesh.creation.box((20.0, 14.0, 8.0)), trimesh.creation.box((6.0, 6.0, 20.0))]
    bodies = [ShadedBody(np.asarray(box.triangles), (0.4, 0.5, 0.6)) for box in boxes]
    turned = Rotation.from_euler("xyz", (30.0, 40.0, 10.0), degrees=True).as_matrix()
    screen = Screen(turned, np.array([-30.0, 12.0]), 4.0, (400, 300))
    line = (np.array([[-20.0, 0.0, 0.0], [40.0, 10.0, 30.0]]), (1.0, 0.0, 0.0), 2.0)
    part = render(bodies, screen, [line])
    monkeypatch.setattr(shading, "_window", lambda corners, fine: (0, 0, *fine.size_px))
    full = render(bodies, screen, [line])
    assert (part.bodies >= 0).any()
    np.testing.assert_array_equal(part.image, full.image)
    np.testing.assert_array_equal(part.bodies, full.bodies)
    np.testing.assert_array_equal(part.z_mm, full.z_mm)
