"""Line drawings of meshes: edges that are seen, none that lies behind, curves without their facets."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mirrorcam.cad.guide.line_art import edges_of, joined, visible_lines
from mirrorcam.cad.guide.shading import Screen, ShadedBody, Shot, render

TOWARDS = np.array([0.0, 0.0, 1.0])


def shot_of(*meshes: trimesh.Trimesh) -> Shot:
    triangles = [np.asarray(mesh.triangles) for mesh in meshes]
    points = np.concatenate([each.reshape(-1, 3) for each in triangles])
    screen = Screen.around(points, np.eye(3), (200, 200), (4, 4))
    return render([ShadedBody(each, (1.0, 1.0, 1.0)) for each in triangles], screen)


def length_mm(mesh: trimesh.Trimesh, shot: Shot) -> float:
    lines = visible_lines(edges_of(mesh, TOWARDS), shot)
    return sum(float(np.linalg.norm(line[1] - line[0])) for line in lines) / shot.screen.px_per_mm


def test_of_a_box_seen_squarely_its_upper_face_is_drawn() -> None:
    box = trimesh.creation.box((20.0, 10.0, 5.0))
    assert length_mm(box, shot_of(box)) == pytest.approx(60.0, rel=0.03)


def test_a_cylinder_on_its_side_is_its_outline_and_its_ends() -> None:
    cylinder = trimesh.creation.cylinder(5.0, 20.0, sections=64)
    cylinder.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, (0.0, 1.0, 0.0)))
    assert length_mm(cylinder, shot_of(cylinder)) == pytest.approx(60.0, rel=0.05)


def test_what_lies_behind_is_not_drawn() -> None:
    below = trimesh.creation.box((20.0, 10.0, 5.0))
    cover = trimesh.creation.box((10.0, 20.0, 5.0))
    cover.apply_translation((6.0, 0.0, 20.0))
    shot = shot_of(below, cover)
    assert length_mm(below, shot) == pytest.approx(10.0 + 2 * 11.0, rel=0.05)
    assert length_mm(cover, shot) == pytest.approx(60.0, rel=0.03)


def test_lines_that_meet_are_one() -> None:
    lines = [np.array([(0.0, 0.0), (1.0, 0.0)]), np.array([(1.0, 0.0), (1.0, 1.0)]), np.array([(3.0, 3.0), (4.0, 3.0)])]
    assert sorted(len(line) for line in joined(lines)) == [2, 3]
    assert joined([np.array([(2.0, 2.0), (2.001, 2.0)])]) == []
