"""Repeatability of a camera in its nest: against a body moved in the model, and many random clampings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.cad.parts.camera_box import error_jacobian
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.reclamping import (
    CONTACT_MM,
    _image_jacobian,
    _motion_in_play,
    _post_error_jacobian,
    repeatability,
)
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout

DISTANCE_MM = 500.0


def test_the_image_jacobian_matches_projected_points(default_layout: Layout) -> None:
    camera = default_layout.camera
    shift, turn = np.array([2.0, -1.0, 3.0]) * 1e-4, np.array([1.0, 2.0, -1.5]) * 1e-5
    moved = _image_jacobian(default_layout, DISTANCE_MM) @ np.concatenate([shift, turn])
    for mirror, expected in zip(default_layout.mirrors, moved, strict=True):
        middle = mirror.outline_in_rig_mm.mean(axis=0)
        point = middle * (1.0 + DISTANCE_MM / np.linalg.norm(middle))
        in_camera = Rotation.from_rotvec(turn).inv().apply(point - shift)
        focal = np.array([camera.fx_px, camera.fy_px])
        gone = focal * (in_camera[:2] / in_camera[2] - point[:2] / point[2])
        np.testing.assert_allclose(gone, expected, atol=1e-6)


def test_the_figures_are_the_spread_of_many_clampings(default_layout: Layout) -> None:
    clip = plan_clip(HARDWARE)
    found = repeatability(clip, default_layout, HARDWARE)
    assert clip.nest is not None
    errors = np.random.default_rng(5).normal(scale=CONTACT_MM, size=(40_000, 6))
    motions = errors @ error_jacobian(clip.nest).T
    assert found.shift_mm == pytest.approx(np.sqrt((motions[:, :3] ** 2).sum(axis=1).mean()), rel=0.02)
    assert found.rotation_deg == pytest.approx(np.degrees(np.sqrt((motions[:, 3:] ** 2).sum(axis=1).mean())), rel=0.02)
    assert found.between_views_px < found.image_px


POSTS = np.array([(-15.0, -12.0, -34.0), (15.0, -12.0, -34.0), (15.0, 18.0, -34.0), (-15.0, 18.0, -34.0)])


def moved(points: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Displacements of points (n, 3) by a shift and a rotation (6,)."""
    return np.asarray(motion[:3] + np.cross(motion[3:], points))


def test_a_board_lies_on_the_plane_nearest_to_its_posts_and_stays_in_place_along_it() -> None:
    heights = np.array([0.02, -0.01, 0.03, 0.01])
    gone = moved(POSTS, _post_error_jacobian(POSTS) @ heights)
    np.testing.assert_allclose(gone[:, :2], 0.0, atol=1e-12)
    # The residual fits no plane: for a rectangle, alternately up and down.
    np.testing.assert_allclose(heights - gone[:, 2], np.mean(heights * [1, -1, 1, -1]) * np.array([1, -1, 1, -1]))


def test_a_board_is_uniformly_distributed_within_the_play_of_its_holes() -> None:
    play, holes = 0.25, POSTS[:, :2] + [4.0, 0.0]  # their centroid is off both axes
    drawn = np.random.default_rng(7).uniform(-1.0, 1.0, size=(400_000, 3)) * [1.3 * play, 1.3 * play, 0.0125]
    motions = np.zeros((len(drawn), 6))
    motions[:, [0, 1, 5]] = drawn
    along = [drawn[:, :2] + drawn[:, 2:] * np.array([-y, x]) for x, y in holes]
    free = motions[np.all([np.hypot(*each.T) <= play for each in along], axis=0)]
    assert len(free) > 20_000
    root = _motion_in_play(holes, play)
    np.testing.assert_allclose(root @ root.T, free.T @ free / len(free), rtol=0.03, atol=1e-4)
    assert not _motion_in_play(holes, 0.0).any()
    doubled = _motion_in_play(holes, 2.0 * play)
    np.testing.assert_allclose(doubled @ doubled.T, 4.0 * root @ root.T)


def test_a_board_with_wider_holes_is_less_repeatable(default_layout: Layout) -> None:
    found = []
    for hole_mm in (2.0, 2.2, 2.5):
        body = read_body("pi_hq_cs")
        assert isinstance(body.held_by, BoardHoles)
        held_by = body.held_by.replaced(hole_mm=hole_mm)
        hardware = HARDWARE.replaced(camera=body.replaced(held_by=held_by))
        found.append(repeatability(plan_clip(hardware), default_layout, hardware))
    assert held_by.play_mm == pytest.approx(0.25)
    assert found[0].shift_mm < found[1].shift_mm < found[2].shift_mm < 0.25
    assert found[0].image_px < found[1].image_px < found[2].image_px
