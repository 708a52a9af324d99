"""Initial estimates from single views: exact if the corners are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.initial_estimates import (
    base_camera,
    best_pose,
    first_estimate,
    intrinsics,
    is_behind,
    pose_from_image,
    rig_from_board,
    virtual_centre_between,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.calibration.synthetic_corners import direct_poses, mirrored_poses, views_of

BOARD = Checkerboard(cols=10, rows=8, square_mm=20.0)
CORNERS = BOARD.corners_in_board_mm
CAMERA = Camera.c920()
EVERY = np.arange(len(CORNERS))


def test_the_plane_between_points_and_their_image() -> None:
    random = np.random.default_rng(1)
    centre = np.array([30.0, -50.0, 200.0])
    points = random.normal(0.0, 20.0, (12, 3)) + np.array([10.0, 0.0, 30.0])
    found, misfit = virtual_centre_between(points, reflect(points, centre))
    np.testing.assert_allclose(found, centre, atol=1e-9)
    assert misfit < 1e-9
    assert not is_behind(points, centre)
    assert is_behind(reflect(points, centre), centre)
    _, misfit = virtual_centre_between(points, points + random.normal(0.0, 5.0, points.shape))
    assert misfit > 1.0


def seen(pose: FloatArray, centre: FloatArray | None = None) -> Corners:
    points = transform(pose, CORNERS)
    return Corners(EVERY, CAMERA.project(points if centre is None else reflect(points, centre)))


def test_intrinsics_are_those_that_projected_the_corners() -> None:
    views = [seen(pose) for pose in direct_poses(BOARD, 8, tilt_deg=30.0, seed=0)]
    found = intrinsics(views, CORNERS, width_px=CAMERA.width_px, height_px=CAMERA.height_px, full_distortion=False)
    np.testing.assert_allclose(found.intrinsics[:4], CAMERA.intrinsics[:4], atol=0.05)
    with pytest.raises(InputError, match="seen in 2 different views, expected 3 or more"):
        intrinsics(views[:2], CORNERS, width_px=1920, height_px=1080, full_distortion=False)


def test_a_pose_is_found_directly_and_through_a_mirror() -> None:
    centre = np.array([0.0, -80.0, 75.0])
    (direct,) = direct_poses(BOARD, 1, tilt_deg=25.0, seed=1)
    (mirrored,) = mirrored_poses(BOARD, 1, tilt_deg=25.0, seed=1)
    for pose, virtual_centre in ((direct, None), (mirrored, centre)):
        found = rig_from_board(CAMERA, seen(pose, virtual_centre), CORNERS, virtual_centre)
        assert found is not None
        np.testing.assert_allclose(found, pose, atol=1e-3)
        assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)


def test_the_pose_before_a_mirror_reprojects_the_images_corners() -> None:
    centre = np.array([10.0, -60.0, 90.0])
    image = rigid(Rotation.from_euler("xyz", [0.3, -0.2, 1.0]).as_matrix(), np.array([5.0, 60.0, 400.0]))
    np.testing.assert_allclose(
        transform(pose_from_image(image, centre), CORNERS), reflect(transform(image, CORNERS), centre), atol=1e-9
    )


def test_the_best_pose_comes_from_the_view_that_explains_all(fold_90_layout: Layout) -> None:
    (pose,) = mirrored_poses(BOARD, 1, tilt_deg=20.0, seed=2)
    mirrors = fold_90_layout.mirrors[:3]
    views = [(mirror, seen(pose, mirror.virtual_centre_in_rig_mm)) for mirror in mirrors]
    np.testing.assert_allclose(best_pose(CAMERA, views, CORNERS), pose, atol=0.01)
    scrambled = Corners(EVERY, np.random.default_rng(0).permutation(views[0][1].pixels))
    np.testing.assert_allclose(best_pose(CAMERA, [(mirrors[0], scrambled), *views[1:]], CORNERS), pose, atol=0.01)


def test_a_first_estimate_of_exact_corners_is_exact(fold_90_layout: Layout) -> None:
    poses = mirrored_poses(BOARD, 3, tilt_deg=20.0, seed=3)
    views = views_of(fold_90_layout, BOARD, poses, [], noise_px=0.0)
    rows = Observations.join([o.with_frame_offset(frame) for frame, o in enumerate(views.mirrored)])
    found = first_estimate(rows, fold_90_layout.camera, fold_90_layout, CORNERS)
    np.testing.assert_allclose(found.rig_from_board, poses, atol=0.02)


def test_the_nominal_camera_is_used_if_frames_do_not_determine_one() -> None:
    assert base_camera(Observations.empty(), CAMERA, CORNERS) is CAMERA
    wide = CAMERA.replaced(fx_px=2.0 * CAMERA.fx_px, fy_px=2.0 * CAMERA.fy_px)
    poses = direct_poses(BOARD, 6, tilt_deg=30.0, seed=4)
    rows = Observations.join(
        [Observations.of_view(frame, DIRECT, EVERY, seen(pose).pixels) for frame, pose in enumerate(poses)]
    )
    assert base_camera(rows, wide, CORNERS) is wide, "a focal length half the nominal one is not plausible"
    assert base_camera(rows, CAMERA, CORNERS).fx_px == pytest.approx(CAMERA.fx_px, rel=1e-3)
