"""The solid of a mirror: on which side of the reflecting surface it lies, and its half-spaces against its corners."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

CORNERS = np.array([[-9.0, -7.0, 73.0], [9.0, -7.0, 73.0], [8.0, 6.0, 86.0], [0.0, 9.0, 89.0], [-8.0, 6.0, 86.0]])


def mirror(surface: Literal["first", "second"]) -> Mirror:
    """A pentagon 80 mm before the camera that folds its view upwards, 2 mm thick."""
    return Mirror.from_plane(
        np.array([0.0, 0.0, 80.0]),
        np.array([0.0, 1.0, -1.0]),
        outline_in_rig_mm=CORNERS,
        surface=surface,
        thickness_mm=2.0,
    )


@pytest.mark.parametrize(("surface", "front_mm", "back_mm"), [("first", 0.0, -2.0), ("second", 2.0, 0.0)])
def test_the_solid_reaches_from_the_back_to_the_front(
    surface: Literal["first", "second"], front_mm: float, back_mm: float
) -> None:
    of = mirror(surface)
    assert (of.front_mm, of.back_mm) == (front_mm, back_mm)
    face, opposite = np.split(of.solid.corners_in_rig_mm, 2)
    np.testing.assert_array_equal(face, CORNERS)
    heights_mm = opposite @ of.normal_in_rig + of.distance_mm
    np.testing.assert_allclose(heights_mm, front_mm + back_mm, atol=1e-9)


@pytest.mark.parametrize("surface", ["first", "second"])
def test_half_spaces_touch_every_corner_and_hold_all_of_them(surface: Literal["first", "second"]) -> None:
    solid = mirror(surface).solid
    normals, offsets = solid.half_spaces
    heights_mm = solid.corners_in_rig_mm @ normals.T - offsets
    assert heights_mm.max() < 1e-9
    # Three faces of a prism meet in each corner.
    np.testing.assert_array_equal((np.abs(heights_mm) < 1e-9).sum(axis=1), 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (solid.corners_in_rig_mm.mean(axis=0) @ normals.T < offsets).all()


def test_a_point_is_inside_where_it_is_between_the_faces_and_within_the_outline() -> None:
    of = mirror("first")
    middle = CORNERS.mean(axis=0)
    normals, offsets = of.solid.half_spaces
    for height_mm, inside in ((0.1, False), (-0.1, True), (-1.9, True), (-2.1, False)):
        assert (normals @ (middle + height_mm * of.normal_in_rig) <= offsets).all() == inside
    assert not (normals @ (CORNERS[0] - [1.0, 0.0, 0.0] - of.normal_in_rig) <= offsets).all()


def test_half_spaces_of_a_designed_mirror_hold_its_corners(default_layout: Layout) -> None:
    for surface in ("first", "second"):
        mirror = default_layout.mirrors[2].replaced(surface=surface, thickness_mm=3.0)
        normals, offsets = mirror.solid.half_spaces
        heights = mirror.solid.corners_in_rig_mm @ normals.T - offsets
        assert heights.max() < 1e-6
        # Each corner of a prism lies on three faces.
        np.testing.assert_array_equal(np.sum(np.abs(heights) < 1e-6, axis=1), 3)
