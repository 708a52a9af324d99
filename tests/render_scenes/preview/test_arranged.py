"""Subjects: the same objects as those of a scene, with textures that stay."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import default_board
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.preview.arranged import TEXTURE_PX, arranged_tabletop, view_from_board
from mirrorcam.render_scenes.tabletop.tabletop import LEAST_ROOM, arrange_tabletop, nearest_mm
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm


def test_objects_are_those_of_the_scene_with_textures_of_one_size(small_layout: Layout) -> None:
    found = arranged_tabletop(small_layout, 3)
    scene = arrange_tabletop(small_layout, default_depths_mm(small_layout), 3)
    assert [item.replaced(texture_px=None) for item in found.objects] == list(scene.objects)
    assert all(item.texture_px == (TEXTURE_PX[item.texture] if item.texture else None) for item in found.objects)


def test_objects_of_another_layout_move_to_the_middle_of_the_field(small_layout: Layout) -> None:
    # The same device, half as large again: its views are higher.
    mirrors = tuple(
        mirror.replaced(
            virtual_centre_in_rig_mm=1.5 * mirror.virtual_centre_in_rig_mm,
            outline_in_rig_mm=1.5 * mirror.outline_in_rig_mm,
        )
        for mirror in small_layout.mirrors
    )
    large = small_layout.replaced(mirrors=mirrors, metrics={}, verdict={})
    own, moved = arranged_tabletop(small_layout, 3), arranged_tabletop(large, 3, small_layout)
    depth = default_depths_mm(small_layout)[1]
    shift = common_bounds(large, depth).mean(axis=0) - common_bounds(small_layout, depth).mean(axis=0)
    assert shift[1] < -20.0
    for before, after in zip(own.objects, moved.objects, strict=True):
        there = before.view_from_object[:3, 3] + np.array([*shift, 0.0])
        np.testing.assert_allclose(after.view_from_object[:3, 3], there)
        np.testing.assert_allclose(after.size_mm, before.size_mm)
    np.testing.assert_allclose(moved.lit_in_view[:2], own.lit_in_view[:2] + shift)


def test_objects_have_room_before_a_layout_that_was_designed_for_less(small_layout: Layout) -> None:
    assert small_layout.spec is not None
    near = 0.6 * nearest_mm(small_layout)
    close = small_layout.replaced(spec=small_layout.spec.replaced(depths_mm=(near, 1.01 * near)))
    pose = view_from_board(close, default_board())
    corners = [pose @ [x, y, 0.0, 1.0] for x in (0.0, 240.0) for y in (0.0, 168.0)]
    assert min(corner[2] for corner in corners) > nearest_mm(close)
    depths = [item.view_from_object[2, 3] for item in arranged_tabletop(close, 0).objects[2:]]
    assert min(depths) == pytest.approx(nearest_mm(close) / (1.0 - LEAST_ROOM) + 1.0)


def test_the_board_is_in_the_middle_of_the_field_and_before_the_mirrors(fold_90_layout: Layout) -> None:
    board = default_board()
    pose = view_from_board(fold_90_layout, board)
    middle = (pose @ [*np.array(board.size_mm) / 2.0, 0.0, 1.0])[:3]
    np.testing.assert_allclose(middle[:2], common_bounds(fold_90_layout, middle[2]).mean(axis=0))
    corners = pose @ np.array([[x, y, 0.0, 1.0] for x in (0.0, board.size_mm[0]) for y in (0.0, board.size_mm[1])]).T
    assert corners[2].min() > nearest_mm(fold_90_layout)
    # It shows its print: z of the board is into the paper.
    assert pose[2, 2] > 0.9
