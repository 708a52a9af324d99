"""Where a rig stands: found from any start, with its factor, and with one camera that is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.bench.scores.gauge import Gauge, centre, gauges, score_points
from mirrorcam.bench.scores.matched_views import matched_views
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.camera_rig import CameraRig
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.camera_files.rigs import DISTANCE_MM, changed, device, moved, pose_of, true_rig


def placed(rig: CameraRig, *, scaled: bool = False) -> tuple[Gauge, ...]:
    views = matched_views(rig, device().truth, device().nominal)
    points = score_points(device().truth, [view.view for view in views], DISTANCE_MM)
    return gauges(views, points, scaled=scaled)


def test_the_motion_is_that_of_the_rig() -> None:
    motion = rigid(Rotation.from_rotvec([1.0, 2.0, -0.5]).as_matrix(), [10.0, 20.0, 900.0])
    (gauge,) = placed(moved(true_rig(device().truth), motion))
    np.testing.assert_allclose(gauge.rig_from_true, motion, atol=1e-9)
    assert gauge.scale == pytest.approx(1.0)
    np.testing.assert_allclose(gauge.pixels, gauge.points.pixels, atol=1e-9)
    np.testing.assert_allclose(gauge.d_point, gauge.points.d_point, rtol=1e-5, atol=1e-6)


def test_one_camera_that_is_wrong_does_not_move_it() -> None:
    rig = true_rig(device().truth)
    wrong = rigid(Rotation.from_rotvec([0.0, 0.03, 0.0]).as_matrix(), [5.0, 0.0, 0.0]) @ pose_of(rig.cameras[0])
    (gauge,) = placed(changed(rig, 0, camera_from_rig=wrong))
    np.testing.assert_allclose(gauge.rig_from_true, np.eye(4), atol=1e-3)
    assert gauge.weights[gauge.points.view == 0].max() < 1e-6


def test_a_factor_is_free_only_without_a_scale() -> None:
    rig = moved(true_rig(device().truth), np.diag([0.5, 0.5, 0.5, 1.0]))
    (gauge,) = placed(rig, scaled=True)
    np.testing.assert_allclose(gauge.pixels, gauge.points.pixels, atol=1e-9)
    assert gauge.motion_columns.shape[2] == 7
    (gauge,) = placed(rig)
    assert gauge.motion_columns.shape[2] == 6
    assert np.abs(gauge.pixels - gauge.points.pixels).max() > 1.0


def test_cameras_at_one_place_are_refused() -> None:
    rig = true_rig(device().truth)
    same = replace(rig, cameras=tuple(replace(camera, camera_from_rig=np.eye(4)) for camera in rig.cameras))
    with pytest.raises(InputError, match="all cameras are at one point"):
        placed(same)


def test_the_centre_is_where_the_pose_puts_the_origin() -> None:
    pose = rigid(Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix(), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(pose @ [*centre(pose), 1.0], [0.0, 0.0, 0.0, 1.0], atol=1e-12)
