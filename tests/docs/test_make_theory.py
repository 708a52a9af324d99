"""The page on the theory: its formulas are those of the code, and its figures are drawn alike every time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from docs.make_theory import DOCS, draw, tilt_error_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import reflect

PAGE = (DOCS / "theory.md").read_text(encoding="utf-8")


def reflection(centre: FloatArray) -> FloatArray:
    """S = I - 2 n n^T of the mirror with a virtual centre."""
    normal = -centre / np.linalg.norm(centre)
    return np.asarray(np.eye(3) - 2.0 * np.outer(normal, normal))


def test_a_point_is_seen_where_the_virtual_camera_has_it(default_layout: Layout) -> None:
    points = np.array([[10.0, 300.0, 90.0], [-40.0, 500.0, 20.0]])
    for mirror in default_layout.mirrors:
        centre = mirror.virtual_centre_in_rig_mm
        matrix = reflection(centre)
        np.testing.assert_allclose((points - centre) @ matrix.T, reflect(points, centre), atol=1e-9)
        np.testing.assert_allclose(points @ matrix.T + centre, reflect(points, centre), atol=1e-9)
        assert np.linalg.det(matrix) == pytest.approx(-1.0)


def test_another_mirror_and_moved_boards_give_the_pictures_of_one_mirror(default_layout: Layout) -> None:
    one, other = (mirror.virtual_centre_in_rig_mm for mirror in default_layout.mirrors[:2])
    motion = reflection(other) @ reflection(one)
    shift = reflection(other) @ (one - other)
    points = np.array([[10.0, 300.0, 90.0], [-40.0, 500.0, 20.0]])
    assert np.linalg.det(motion) == pytest.approx(1.0)
    np.testing.assert_allclose(reflect(points @ motion.T + shift, other), reflect(points, one), atol=1e-9)


def test_tilts_make_the_error_of_depth_that_the_page_states(default_layout: Layout) -> None:
    # Views of cameras that turn by twice the tilts of their mirrors, and the depth of least squares in all of them.
    turn, distance = 1e-4, 500.0
    baselines = default_layout.virtual_centres_in_view_mm.reshape(-1, 3) * (1.0, 1.0, 0.0)
    baselines -= baselines.mean(axis=0)
    generator = np.random.default_rng(1)
    point = np.array([0.0, 0.0, distance])
    depths = []
    for _ in range(4000):
        turns = np.zeros_like(baselines)
        turns[:, :2] = generator.normal(0.0, 2.0 * turn, (len(baselines), 2))
        rays = Rotation.from_rotvec(turns).apply(point - baselines)
        slopes = rays[:, :2] / rays[:, 2:]
        nearness = -(baselines[:, :2] * (slopes - slopes.mean(axis=0))).sum() / (baselines**2).sum()
        depths.append(1.0 / nearness)
    stated = float(tilt_error_mm(default_layout, turn, np.array([distance]))[0])
    assert np.std(depths) == pytest.approx(stated, rel=0.05)


def test_figures_are_drawn_alike_and_are_those_of_the_page(default_layout: Layout, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        draw(default_layout, tmp_path / folder)
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert [name for name in names if f"images/{name}" not in PAGE] == []
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
        assert (DOCS / "images" / name).is_file()
