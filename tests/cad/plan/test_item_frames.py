"""Frames of bought items: right-handed, along their axes; and moves that end outside."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.item_frames import CLEAR_MM, along, beyond


@pytest.mark.parametrize("axis", [(0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.0, 0.6, 0.8)])
def test_a_frame_has_its_z_along_the_axis_and_its_x_across(axis: tuple[float, float, float]) -> None:
    frame = along(np.array([1.0, 2.0, 3.0]), np.array(axis))
    np.testing.assert_allclose(frame[:3, 2], axis)
    np.testing.assert_allclose(frame[:3, 3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert frame[0, 0] == pytest.approx(1.0)


def test_a_place_leaves_the_hull_with_room_to_spare() -> None:
    corners = np.array([(0.0, 0.0, 0.0), (10.0, 5.0, 2.0)])
    move = beyond(corners, np.array([4.0, 1.0, 1.0]), np.array([-1.0, 0.0, 0.0]))
    np.testing.assert_allclose(move, [-(4.0 + CLEAR_MM), 0.0, 0.0])
