"""How a camera repeats in its nest: against a body moved in the model, and many clampings drawn at random."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.nest import motion_of_errors
from mirrorcam.cad.parts.reclamping import CONTACT_MM, _moved_px, repeatability
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout

DISTANCE_MM = 500.0


def test_pixels_move_as_points_projected_again_do(default_layout: Layout) -> None:
    camera = default_layout.camera
    shift, turn = np.array([2.0, -1.0, 3.0]) * 1e-4, np.array([1.0, 2.0, -1.5]) * 1e-5
    moved = _moved_px(default_layout, DISTANCE_MM) @ np.concatenate([shift, turn])
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
    assert found is not None
    errors = np.random.default_rng(5).normal(scale=CONTACT_MM, size=(40_000, 6))
    motions = errors @ motion_of_errors(clip.nest).T
    assert found.shift_mm == pytest.approx(np.sqrt((motions[:, :3] ** 2).sum(axis=1).mean()), rel=0.02)
    assert found.turn_deg == pytest.approx(np.degrees(np.sqrt((motions[:, 3:] ** 2).sum(axis=1).mean())), rel=0.02)
    assert found.between_views_px < found.image_px
