"""The planned poses of the board cover the fields of the mirrors and the camera."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard, Charuco, Checkerboard, default_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.fields_of_view import fields
from mirrorcam.render_scenes.sets.dataset import DepthRange
from mirrorcam.render_scenes.sets.poses import (
    CLEARANCE_MM,
    PosePlan,
    depth_ranges,
    plan_base_frames,
    plan_frames,
)
from mirrorcam.render_scenes.truth.corners import CornerProjector


def random() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture(scope="module")
def plan(default_layout: Layout) -> PosePlan:
    return plan_frames(default_layout, default_board(), 20, random())


@pytest.fixture(scope="module")
def poses(plan: PosePlan) -> FloatArray:
    return plan.poses


def test_every_mirror_sees_the_board_over_all_its_sub_image(default_layout: Layout, plan: PosePlan) -> None:
    assert plan.poses.shape == (20, 4, 4)
    assert plan.coverage.shape == (9,)
    assert plan.coverage.min() > 0.95
    _, visible = CornerProjector(default_layout, default_board()).all_via_mirrors(list(plan.poses[:, None]))
    assert visible.sum(axis=2).min() >= 30
    np.testing.assert_array_equal(plan.corners, visible.sum(axis=2))


def test_one_frame_covers_less_than_many(default_layout: Layout) -> None:
    one = plan_frames(default_layout, default_board(), 1, random()).coverage
    three = plan_frames(default_layout, default_board(), 3, random()).coverage
    assert (one <= three).all()
    assert one.mean() < 0.95 < three.mean()


def test_coverage_is_the_part_of_cells_with_a_corner(default_layout: Layout) -> None:
    plan = plan_base_frames(default_layout, default_board(), 2, random())
    px, visible = CornerProjector(default_layout, default_board()).all_direct(list(plan.poses))
    cells = {(int(x // 191.9), int(y // 107.9)) for x, y in px[visible]}
    assert plan.coverage.tolist() == [pytest.approx(len(cells) / 100)]


def test_boards_are_held_at_several_depths_and_tilts(default_layout: Layout, poses: FloatArray) -> None:
    board = default_board()
    middle = np.array([[*board.size_mm, 0.0]]) / 2.0
    depths = np.array([(transform(pose, middle) @ default_layout.view_from_rig[2])[0] for pose in poses])
    assert depths.min() < 310.0
    assert depths.max() > 500.0
    assert np.diff(np.sort(1.0 / depths)).max() < 2.5 * np.ptp(1.0 / depths) / 19
    view_normals = poses[:, :3, 2] @ default_layout.view_from_rig.T
    tilts = np.degrees(np.arctan2(view_normals[:, :2], view_normals[:, 2:]))
    assert (tilts.max(axis=0) > 20.0).all()
    assert (tilts.min(axis=0) < -20.0).all()
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12
    )


def test_no_board_touches_a_mirror_and_all_show_their_print(default_layout: Layout, poses: FloatArray) -> None:
    board = default_board()
    outline = np.array([[x, y, 0.0] for x in (0.0, board.size_mm[0]) for y in (0.0, board.size_mm[1])])
    nearest_mirror = max((m.outline_in_rig_mm @ default_layout.view_from_rig[2]).max() for m in default_layout.mirrors)
    for pose in poses:
        depths = transform(pose, outline) @ default_layout.view_from_rig[2]
        assert depths.min() > nearest_mirror + CLEARANCE_MM
        for centre in default_layout.virtual_centres_in_rig_mm:
            assert (centre - pose[:3, 3]) @ pose[:3, 2] < 0


def test_the_base_frames_cover_the_sensor(default_layout: Layout) -> None:
    plan = plan_base_frames(default_layout, default_board(), 12, random())
    assert plan.coverage.shape == (1,)
    assert plan.coverage[0] > 0.9
    px, visible = CornerProjector(default_layout, default_board()).all_direct(list(plan.poses))
    assert visible.sum(axis=1).min() > 60
    corners = px[visible]
    assert (corners.min(axis=0) < [60, 60]).all()
    assert (corners.max(axis=0) > [1860, 1020]).all()


def test_the_same_stream_gives_the_same_plan(default_layout: Layout) -> None:
    first, second = (plan_frames(default_layout, default_board(), 2, random()).poses for _ in range(2))
    np.testing.assert_array_equal(first, second)
    other = plan_frames(default_layout, default_board(), 2, np.random.default_rng(6)).poses
    assert (first != other).any()


def test_no_frames_are_an_empty_plan(default_layout: Layout) -> None:
    assert plan_base_frames(default_layout, default_board(), 0, random()).poses.shape == (0, 4, 4)


def test_a_layout_without_a_spec_is_planned_for_too(default_layout: Layout) -> None:
    plan = plan_frames(default_layout.replaced(spec=None), default_board(), 4, random())
    assert plan.coverage.min() > 0.7


@pytest.mark.parametrize(
    ("board", "reason"),
    [
        (Checkerboard(cols=20, rows=14, square_mm=1.0), "too small to be resolved, a square spans"),
        (Checkerboard(cols=4, rows=3, square_mm=90.0), "too large to be seen, mirror"),
        (Charuco(cols=5, rows=4, square_mm=90.0, marker_mm=60.0), "too large"),
        (Checkerboard(cols=6, rows=5, square_mm=400.0), "too large to fit"),
    ],
)
def test_a_board_that_cannot_be_seen_is_refused_in_one_line(
    default_layout: Layout, board: CalibrationBoard, reason: str
) -> None:
    with pytest.raises(InputError, match=reason) as error:
        plan_frames(default_layout, board, 4, random())
    assert "\n" not in str(error.value)


def parting_mirrors(outward: float) -> Layout:
    """Two mirrors side by side, each turned outward."""
    mirrors = []
    for side in (-1.0, 1.0):
        normal = np.array([outward * side, 1.0, -1.0])
        window = np.array([[0.05, -0.1], [0.3, -0.1], [0.3, 0.1], [0.05, 0.1]]) * [side, 1.0]
        rays = np.concatenate([window, np.ones((4, 1))], axis=1)
        outline = rays * (-80.0 / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(outline[0], normal, outline_in_rig_mm=outline))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=tuple(mirrors))


def test_mirrors_without_a_common_field_see_parts_of_a_board() -> None:
    apart = parting_mirrors(0.05)
    first, second = fields(apart, 400.0)
    assert not first.intersects(second)
    plan = plan_frames(apart, default_board(), 6, random())
    assert (plan.coverage > 0.3).all()


def test_mirrors_too_far_apart_for_the_board_are_refused() -> None:
    with pytest.raises(InputError, match="too small to be seen, mirror"):
        plan_frames(parting_mirrors(0.5), default_board(), 6, random())


def test_every_mirror_sees_boards_near_and_far_and_tilted(plan: PosePlan, default_layout: Layout) -> None:
    found = depth_ranges(plan, default_board(), default_layout.view_from_rig[2])
    assert len(found) == 9
    for reach in found:
        # The default layout is for 300 to 500 mm.
        assert reach.nearest_mm < 300.0
        assert reach.farthest_mm > 500.0
        assert 35.0 < reach.tilt_deg < 60.0


def test_reaches_are_those_of_the_poses_that_show_enough(default_layout: Layout) -> None:
    board, forward = default_board(), default_layout.view_from_rig[2]
    tilts = Rotation.from_rotvec(np.outer([10.0, 30.0, 50.0], [1.0, 0.0, 0.0]), degrees=True).as_matrix()
    turns, depths_mm = default_layout.view_from_rig.T @ tilts, np.array([300.0, 400.0, 600.0])
    poses = rigid(turns, np.outer(depths_mm, forward) - turns @ np.array([*board.size_mm, 0.0]) / 2.0)
    shown = np.array([[6, 99, 0], [5, 99, 0], [7, 99, 5]])
    first, second, third = depth_ranges(PosePlan(poses, np.ones(3), shown), board, forward)
    assert first == DepthRange(nearest_mm=300, farthest_mm=600, tilt_deg=50)
    assert second == first
    assert third == DepthRange(nearest_mm=0, farthest_mm=0, tilt_deg=0)
    assert depth_ranges(PosePlan(poses[:2], np.ones(3), shown[:2]), board, forward)[0].farthest_mm == 300
