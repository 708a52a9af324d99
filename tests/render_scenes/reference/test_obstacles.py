"""What stops light around the mirrors: against closed forms, and against pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco
from mirrorcam.render_scenes.reference.obstacles import BodyObstacles
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.truth.corners import Oracle
from mirrorcam.render_scenes.truth.pixel_maps import NO_MIRROR, board_maps, pixel_rays
from mirrorcam.render_scenes.variant import SCALAR, use_variant
from tests.render_scenes.devices import SETTINGS, box, scene_of


@pytest.fixture(scope="module")
def pose(small_layout: Layout, small_board: Charuco) -> FloatArray:
    return plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]


@pytest.mark.parametrize("variant", [None, SCALAR])
def test_rays_go_as_far_as_the_faces_of_a_box(variant: str | None) -> None:
    use_variant(variant)
    obstacles = BodyObstacles([box((-10.0, -20.0, 100.0), (10.0, 20.0, 130.0))])
    sideways = np.array([0.6, 0.0, 0.8])
    starts = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 200.0], [30.0, 0.0, 0.0], [-69.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    ways = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0], sideways, [0.0, 0.0, 1.0]])
    # The fourth passes z = 100 at x = 6, the others run along z.
    expected = [100.0, 70.0, np.inf, 125.0, np.nan]
    np.testing.assert_allclose(obstacles.free_mm(starts, ways), expected, rtol=1e-6)
    assert obstacles.free_mm(starts[:4].reshape(2, 2, 3), ways[:4].reshape(2, 2, 3)).shape == (2, 2)


def test_light_to_the_pupil_is_not_stopped_by_the_body_of_the_camera() -> None:
    use_variant()
    camera, wall = (
        box((-40.0, -12.0, -30.0), (40.0, 12.0, 5.0), kind="camera"),
        box((-9.0, -9.0, 80.0), (9.0, 9.0, 81.0)),
    )
    obstacles = BodyObstacles([camera, wall])
    rays = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]])
    np.testing.assert_allclose(obstacles.free_from_pupil_mm(rays), [80.0, np.inf], rtol=1e-6)


def test_the_truth_knows_what_parts_hide(small_layout: Layout, small_board: Charuco, pose: FloatArray) -> None:
    """A wall between camera and mirror, then one between mirror and board: maps and corners, against the picture."""
    middle = small_layout.mirrors[4].outline_in_rig_mm.mean(axis=0)
    seen = board_maps(pixel_rays(small_layout, mirrors=True), small_board, pose)
    px, before = Oracle(small_layout, small_board).by_mirrors(pose)
    free = scene_of(small_layout, small_board, pose).render(spp=16, seed=1)
    walls = (0.6 * middle, [3.0, 3.0, 0.1]), (middle + 120.0 * small_layout.view_from_rig[2], [4.0, 0.1, 4.0])
    for kept, (at, half) in enumerate(walls):
        wall = box(at - half, at + half)
        obstacles = BodyObstacles([wall])
        maps = board_maps(pixel_rays(small_layout, mirrors=True, obstacles=obstacles), small_board, pose)
        hidden = np.isfinite(seen["board.x"]) & ~np.isfinite(maps["board.x"])
        assert 20 < hidden.sum() < 3000
        lost_mirrors = (maps["mirror"][hidden] == NO_MIRROR).mean()
        assert lost_mirrors == (0.0 if kept else 1.0)
        picture = scene_of(small_layout, small_board, pose, wall).render(spp=16, seed=1)
        shown = np.isfinite(maps["board.x"])
        inside, outside = (cv2.erode(part.astype(np.uint8), np.ones((3, 3))) > 0 for part in (hidden, shown))
        assert inside.sum() > 10
        plastic = 0.2 * SETTINGS.surroundings * (SETTINGS.mirror_reflectance if kept else 1.0)
        assert (np.abs(picture[inside] - plastic) < 0.3 * plastic).mean() > 0.95
        assert (np.abs(picture - free)[outside] < 1e-5).mean() > 0.999
        after = Oracle(small_layout, small_board, (), obstacles).by_mirrors(pose)[1]
        assert not (after & ~before).any()
        near = cv2.dilate(hidden.astype(np.uint8), np.ones((7, 7))) > 0
        lost = px[before & ~after].round().astype(int)
        assert len(lost) > 0
        assert near[lost[:, 1], lost[:, 0]].all()
        still = px[after].round().astype(int)
        assert not hidden[still[:, 1], still[:, 0]].any()
