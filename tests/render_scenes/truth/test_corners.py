"""Visibility and pixels of a board's corners, without a renderer."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.boards import poses_at
from mirrorcam.render_scenes.truth.corners import VISIBLE_MARGIN_PX, CornerProjector

BOARD = Checkerboard(cols=20, rows=14, square_mm=12.0)


def facing(layout: Layout, board: Checkerboard, depth_mm: float) -> FloatArray:
    turn = layout.view_from_rig.T
    middle = turn @ np.array([0.0, -70.0, depth_mm])
    return rigid(turn, middle - turn @ np.array([*board.size_mm, 0.0]) / 2.0)


def test_pixels_are_those_of_the_layout(distorted_layout: Layout) -> None:
    pose = facing(distorted_layout, BOARD, 400.0)
    px, _ = CornerProjector(distorted_layout, BOARD).via_mirrors(pose)
    points = transform(pose, BOARD.corners_in_board_mm)
    assert px.shape == (9, 19 * 13, 2)
    for index in range(9):
        np.testing.assert_array_equal(px[index], distorted_layout.project(points, index))


def test_seen_is_inside_the_sub_image_and_the_sensor_by_the_margin(distorted_layout: Layout) -> None:
    px, visible = CornerProjector(distorted_layout, BOARD).via_mirrors(facing(distorted_layout, BOARD, 400.0))
    sensor = shapely.box(0.0, 0.0, 1919.0, 1079.0)
    for index in range(9):
        outline = shapely.Polygon(distorted_layout.outline_px(index, 200)).intersection(sensor)
        inside = shapely.contains_xy(outline, *px[index].T)
        edge = shapely.distance(shapely.boundary(outline), shapely.points(px[index]))
        assert not (visible[index] & ~inside).any()
        assert edge[visible[index]].min() > VISIBLE_MARGIN_PX - 0.1
        clearly = inside & (edge > VISIBLE_MARGIN_PX + 0.5)
        assert visible[index][clearly].all()
        assert 20 < visible[index].sum() < len(visible[index])


def test_the_blank_side_of_a_board_shows_nothing(default_layout: Layout) -> None:
    projector = CornerProjector(default_layout, BOARD)
    pose = facing(default_layout, BOARD, 400.0)
    assert projector.via_mirrors(pose)[1].any()
    turned = pose @ np.diag([-1.0, 1.0, -1.0, 1.0])
    turned[:3, 3] = pose[:3, 3] + pose[:3, 0] * BOARD.size_mm[0]
    px, visible = projector.via_mirrors(turned)
    np.testing.assert_allclose(np.sort(px[4], axis=0), np.sort(projector.via_mirrors(pose)[0][4], axis=0), atol=1e-6)
    assert not visible.any()


def test_what_lies_behind_a_mirror_shows_nothing(default_layout: Layout) -> None:
    mirror, board = default_layout.mirrors[4], Checkerboard(cols=4, rows=3, square_mm=1.0)
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    for at, seen in ((4.0, True), (0.6, False)):
        # On the ray to the centre of the mirror; a point behind the mirror has its image in front of it.
        place = mirror.reflect(at * middle)
        away = place - mirror.virtual_centre_in_rig_mm
        x_axis = np.cross(away, [0.0, 0.0, 1.0])
        axes = np.stack([x_axis, np.cross(away, x_axis), away], axis=1)
        axes /= np.linalg.norm(axes, axis=0)
        rig_from_board = rigid(axes, place - axes @ [2.0, 1.5, 0.0])
        px, visible = CornerProjector(default_layout, board).via_mirrors(rig_from_board)
        expected = default_layout.camera.project(middle)
        np.testing.assert_allclose(px[4].mean(axis=0), expected, atol=2.0)
        assert visible[4].all() == seen
        assert visible[4].any() == seen


def folding_mirror() -> Mirror:
    """At 45 degrees, 80 mm up the axis of the camera, seen within 0.1 of its middle in normalized coordinates."""
    window = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    depth = 80.0 / (1.0 - window[:, 1:])  # of the plane z - y = 80
    return Mirror(
        virtual_centre_in_rig_mm=[0.0, -80.0, 80.0],
        outline_in_rig_mm=np.concatenate([window, np.ones((4, 1))], axis=1) * depth,
    )


@pytest.mark.parametrize(("left_mm", "hidden"), [(-50.0, "all"), (0.0, "some"), (60.0, "none")])
def test_a_mirror_in_the_way_hides_the_board(left_mm: float, hidden: str) -> None:
    # The other mirror stands across the beam, 150 mm in front of the first: no pixel shows it, but it blocks the light.
    across = Mirror.from_plane(
        np.array([0.0, 150.0, 0.0]),
        np.array([0.0, -1.0, 0.0]),
        outline_in_rig_mm=[[x, 150.0, z] for x, z in ((left_mm, 40), (110, 40), (110, 140), (left_mm, 140))],
    )
    layout = Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=(folding_mirror(), across))
    board = Checkerboard(cols=6, rows=5, square_mm=8.0)
    pose = facing(layout, board, 300.0)
    pose[2, 3] += 10.0
    alone = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(folding_mirror(),))
    assert CornerProjector(alone, board).via_mirrors(pose)[1].all()
    visible = CornerProjector(layout, board).via_mirrors(pose)[1][0]
    assert {"all": not visible.any(), "some": visible.any() and not visible.all(), "none": visible.all()}[hidden]


def test_corners_without_an_image_are_nan_and_not_seen(default_layout: Layout) -> None:
    behind_camera = rigid(np.eye(3), [-120.0, -84.0, -300.0])
    projector = CornerProjector(default_layout, BOARD)
    px, visible = projector.direct(behind_camera)
    assert np.isnan(px).all()
    assert not visible.any()


def test_the_bare_camera_sees_the_printed_side_only(default_layout: Layout) -> None:
    projector = CornerProjector(default_layout, BOARD)
    pose = rigid(np.eye(3), [-120.0, -84.0, 400.0])
    px, visible = projector.direct(pose)
    np.testing.assert_array_equal(px, default_layout.camera.project(BOARD.corners_in_board_mm + pose[:3, 3]))
    assert visible.all()
    pose[:3, 3] = [-120.0 + 300.0, -84.0, 400.0]
    shifted, seen = projector.direct(pose)
    np.testing.assert_array_equal(seen, shifted[:, 0] <= 1919.0 - VISIBLE_MARGIN_PX)
    assert 0 < seen.sum() < len(seen)
    turned = pose @ np.diag([-1.0, 1.0, -1.0, 1.0])
    turned[:3, 3] = [120.0, -84.0, 400.0]
    assert not projector.direct(turned)[1].any()


def test_stacked_poses_are_the_single_ones(default_layout: Layout) -> None:
    projector = CornerProjector(default_layout, BOARD)
    poses = [facing(default_layout, BOARD, depth) for depth in (320.0, 500.0)]
    px, visible = projector.all_via_mirrors([pose[None] for pose in poses])
    for frame, pose in enumerate(poses):
        np.testing.assert_array_equal(px[frame], projector.via_mirrors(pose)[0])
        np.testing.assert_array_equal(visible[frame], projector.via_mirrors(pose)[1])
    assert projector.all_direct([])[0].shape == (0, 19 * 13, 2)


def moving_board(layout: Layout) -> FloatArray:
    """Three poses (3, 4, 4) of a board that moves and turns while a shutter rolls: 20 mm and 3 degrees."""
    poses = np.array([facing(layout, BOARD, 400.0)] * 3)
    poses[:, :3, 3] += np.outer([-1.0, 0.1, 1.0], [6.0, 4.0, -7.0])
    turn = Rotation.from_rotvec([0.01, -0.02, 0.015]).as_matrix()
    poses[0, :3, :3] = poses[0, :3, :3] @ turn.T
    poses[2, :3, :3] = poses[2, :3, :3] @ turn
    return poses


def test_a_corner_is_where_the_board_is_when_its_row_is_read(default_layout: Layout) -> None:
    projector, poses = CornerProjector(default_layout, BOARD), moving_board(default_layout)
    px, visible = projector.during_readout(poses)
    assert visible.sum() > 500
    still = projector.via_mirrors(poses[1])[0]
    assert np.nanmax(np.abs(px - still)) > 3.0
    for mirror, corner in np.argwhere(visible)[::40]:
        at_its_time = poses_at(poses, px[mirror, corner, 1:] / (default_layout.camera.height_px - 1))[0]
        expected, seen = projector.via_mirrors(at_its_time)
        assert seen[mirror, corner]
        np.testing.assert_allclose(px[mirror, corner], expected[mirror, corner], atol=1e-8)


def test_a_board_at_rest_is_seen_the_same_by_a_rolling_shutter(default_layout: Layout) -> None:
    projector, pose = CornerProjector(default_layout, BOARD), facing(default_layout, BOARD, 400.0)
    px, visible = projector.during_readout(np.array([pose] * 3))
    np.testing.assert_allclose(px, projector.via_mirrors(pose)[0], atol=1e-9)
    np.testing.assert_array_equal(visible, projector.via_mirrors(pose)[1])
