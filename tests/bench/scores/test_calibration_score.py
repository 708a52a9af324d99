"""Scores against closed forms: of a true calibration, of one wrong in a known way, and of ones twice as wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.bench.scores.calibration_score import NO_POSES, NO_SCALE, ONE_VIEW
from mirrorcam.bench.scores.gauge import score_points
from mirrorcam.bench.scores.score_report import FIGURES
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.read.registry import rig_of
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform
from tests.optics.camera_files.rigs import (
    DISTANCE_MM,
    EXACT,
    changed,
    device,
    lens_of,
    moved,
    pose_of,
    true_rig,
    with_random_poses,
)

ZERO = ("rms_px", "max_px", "rms_mm", "baseline_error_max_mm", "angle_error_max_deg", "triangulation_max_mm")


def value(score: object, name: str) -> float:
    return float(score.figures[name].value)  # type: ignore[attr-defined]


def test_a_true_calibration_scores_zero() -> None:
    score = device().score(true_rig(device().truth))
    assert max(value(score, name) for name in ZERO) < 1e-9
    assert abs(value(score, "scale_error_percent")) < 1e-9
    assert abs(value(score, "focal_error_percent")) < 1e-6
    assert value(score, "shown_share") == 1.0
    assert (score.alignment, score.mirrored, score.missing) == ("rigid", False, ())
    assert len(score.views) == 6


def test_every_figure_is_given_or_said_not_to_be() -> None:
    for rig in (true_rig(device().truth), replace(true_rig(device().truth), unit_mm=None)):
        score = device().score(rig)
        overall = {name for name in score.figures if not name.startswith("view_")}
        assert (overall | score.not_given.keys()) | {"nees_low", "nees_high", "nees_freedom"} == set(FIGURES)
        assert not overall & score.not_given.keys()


def test_a_true_layout_scores_zero_also_where_its_mirrors_are_plates_or_bent() -> None:
    truth = device().truth.with_surface("second", 2.0)
    bent = truth.replaced(
        mirrors=tuple(mirror.replaced(curvature_per_m=[0.02, -0.01, 0.005]) for mirror in truth.mirrors)
    )
    for layout in (truth, bent):
        score = replace(device(), truth=layout).score(rig_of(layout))
        assert max(value(score, name) for name in ZERO) < 1e-7
    assert value(replace(device(), truth=bent).score(rig_of(truth)), "rms_px") > 0.1


@pytest.mark.parametrize("turn", [0.1, 1.5, 3.1])
def test_a_rig_that_stands_elsewhere_is_as_good(turn: float) -> None:
    motion = rigid(Rotation.from_rotvec(turn * np.array([0.6, 0.0, 0.8])).as_matrix(), [300.0, -2000.0, 50.0])
    score = device().score(moved(true_rig(device().truth), motion))
    assert max(value(score, name) for name in ZERO) < 1e-8


def test_a_rig_without_scale_is_as_good_and_says_so() -> None:
    motion = rigid(0.0137 * Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix(), [1.0, -2.0, 0.5])
    rig = replace(moved(true_rig(device().truth), motion), unit_mm=None)
    score = device().score(rig)
    assert max(value(score, name) for name in ZERO) < 1e-8
    assert score.alignment == "similarity"
    assert score.not_given["scale_error_percent"] == score.not_given["baseline_error_percent"] == NO_SCALE


def test_a_rig_that_is_too_large_has_that_error_of_scale() -> None:
    score = device().score(moved(true_rig(device().truth), np.diag([1.002, 1.002, 1.002, 1.0])))
    assert value(score, "scale_error_percent") == pytest.approx(0.2, abs=1e-9)
    assert value(score, "baseline_error_percent") == pytest.approx(0.2, abs=1e-9)
    assert value(score, "angle_error_max_deg") < 1e-6
    assert value(score, "triangulation_rms_mm") > 0.1


def test_a_longer_focal_length_of_one_view_shows_there_by_its_closed_form() -> None:
    rig, number = true_rig(device().truth), 4
    lens = lens_of(rig.cameras[number])
    wrong = lens.replaced(fx_px=1.01 * lens.fx_px, fy_px=1.01 * lens.fy_px)
    score = device().score(changed(rig, number, lens=wrong))
    points = score_points(device().truth, [number], DISTANCE_MM)
    camera = device().truth.camera
    expected = 0.01 * (points.pixels - [camera.cx_px, camera.cy_px])  # f x + c
    assert value(score, "view_1_1_rms_px") == pytest.approx(np.sqrt(np.mean(np.sum(expected**2, axis=1))), rel=1e-4)
    assert value(score, "view_1_1_bias_x_px") == pytest.approx(expected[:, 0].mean(), rel=1e-3, abs=1e-3)
    assert value(score, "view_1_1_bias_y_px") == pytest.approx(expected[:, 1].mean(), rel=1e-3)
    assert value(score, "view_1_1_focal_error_percent") == pytest.approx(1.0, abs=1e-3)
    assert value(score, "worst_view_rms_px") == value(score, "view_1_1_rms_px")
    others = [name for name in score.views if name != "view_1_1"]
    assert max(value(score, f"{name}_max_px") for name in others) < 1e-2


def test_a_camera_that_is_moved_by_a_millimetre_shows_by_its_closed_form() -> None:
    rig, number = true_rig(device().truth), 0
    camera = rig.cameras[number]
    score = device().score(changed(rig, number, camera_from_rig=rigid(np.eye(3), [1.0, 0.0, 0.0]) @ pose_of(camera)))
    points = score_points(device().truth, [number], DISTANCE_MM)
    in_camera = transform(pose_of(camera), points.points_in_rig)
    off = camera.lens.project(in_camera + np.array([1.0, 0.0, 0.0])) - camera.lens.project(in_camera)
    assert value(score, "view_0_0_rms_px") == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=1))), rel=1e-4)
    # About f / z px, and a point's shift of 1 mm, less what of it is along the ray.
    assert value(score, "view_0_0_rms_px") == pytest.approx(np.sqrt(np.mean((700.0 / in_camera[:, 2]) ** 2)), rel=0.1)
    assert 0.85 < value(score, "view_0_0_rms_mm") < 1.0
    centres = np.array([inverse(pose_of(each))[:3, 3] for each in rig.cameras])
    own = inverse(rigid(np.eye(3), [1.0, 0.0, 0.0]) @ pose_of(camera))[:3, 3]
    change = np.linalg.norm(centres[1:] - own, axis=1) - np.linalg.norm(centres[1:] - centres[0], axis=1)
    assert value(score, "baseline_error_max_mm") == pytest.approx(np.abs(change).max(), rel=1e-9)
    assert value(score, "baseline_error_rms_mm") == pytest.approx(np.sqrt(np.sum(change**2) / 15), rel=1e-9)
    assert value(score, "angle_error_max_deg") < 1e-6


def test_a_camera_that_is_turned_has_that_error_of_angle() -> None:
    rig = true_rig(device().truth)
    turn = rigid(Rotation.from_rotvec([0.0, np.radians(0.05), 0.0]).as_matrix(), np.zeros(3))
    score = device().score(changed(rig, 3, camera_from_rig=turn @ pose_of(rig.cameras[3])))
    assert value(score, "angle_error_max_deg") == pytest.approx(0.05, rel=1e-6)
    assert value(score, "angle_error_rms_deg") == pytest.approx(0.05 * np.sqrt(5 / 15), rel=1e-6)


def test_a_shifted_principal_point_is_the_bias_of_its_view_in_the_frame_as_it_is() -> None:
    """The pictures are flipped top-bottom: down in them is up in the frame."""
    rig = true_rig(device().truth)
    lens = lens_of(rig.cameras[2])
    score = device().score(changed(rig, 2, lens=lens.replaced(cx_px=lens.cx_px + 0.3, cy_px=lens.cy_px + 0.2)))
    assert value(score, "view_0_2_bias_x_px") == pytest.approx(0.3, abs=1e-3)
    assert value(score, "view_0_2_bias_y_px") == pytest.approx(-0.2, abs=1e-3)
    assert value(score, "view_0_2_median_px") == pytest.approx(np.hypot(0.3, 0.2), abs=1e-3)


def test_a_calibration_twice_as_wrong_scores_twice_as_much() -> None:
    rig = true_rig(device().truth)
    once, twice = (device().score(with_random_poses(rig, size)) for size in (1.0, 2.0))
    names = ("rms_px", "median_px", "p95_px", "rms_mm", "baseline_error_rms_mm", "triangulation_rms_mm")
    for name in names:
        assert value(twice, name) == pytest.approx(2.0 * value(once, name), rel=0.01)
    assert value(once, "rms_px") > 0.01


def test_percentiles_are_in_their_order() -> None:
    score = device().score(with_random_poses(true_rig(device().truth), 3.0))
    order = [value(score, name) for name in ("median_px", "p95_px", "max_px")]
    assert 0.0 < order[0] < order[1] < order[2]


def test_a_rig_of_some_views_is_scored_for_those() -> None:
    rig = true_rig(device().truth)
    score = device().score(replace(rig, cameras=rig.cameras[1:4]))
    assert list(score.views) == ["view_0_1", "view_0_2", "view_1_0"]
    assert score.missing == ("view_0_0", "view_1_1", "view_1_2")
    assert value(score, "rms_px") < 1e-9


def test_cameras_without_poses_are_judged_alone() -> None:
    rig = true_rig(device().truth)
    alone = replace(rig, cameras=tuple(replace(camera, camera_from_rig=None) for camera in rig.cameras))
    score = device().score(alone)
    assert score.alignment == "each view alone"
    assert value(score, "max_px") < 1e-8
    assert set(score.not_given.values()) == {NO_POSES, "the calibration has no covariance"}
    assert "baseline_error_rms_mm" in score.not_given
    lens = lens_of(rig.cameras[0])
    wrong = device().score(changed(alone, 0, lens=lens.replaced(distortion=[0.09, -0.11, 1.2e-3, -8e-4, 0.0])))
    assert value(wrong, "view_0_0_rms_px") > 0.01 > value(wrong, "view_0_1_rms_px")


def test_one_view_has_no_baseline() -> None:
    rig = true_rig(device().truth)
    score = device().score(replace(rig, cameras=rig.cameras[:1]))
    assert score.not_given["baseline_error_rms_mm"] == ONE_VIEW
    assert value(score, "max_px") < 1e-9


def test_frames_as_they_are_make_a_mirrored_world() -> None:
    """Poses of cameras of frames that are not flipped are rigid in a world that is mirrored."""
    truth = device().truth
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    rig = rig_of(truth)
    proper = tuple(
        replace(camera, lens=truth.camera, camera_from_rig=pose_of(camera) @ mirrored) for camera in rig.cameras
    )
    assert all(np.linalg.det(pose_of(camera)[:3, :3]) > 0 for camera in proper)
    score = device().score(replace(rig, cameras=proper, layout=None, pictures=None), pictures="as-is")
    assert max(value(score, name) for name in ZERO) < 1e-8
    assert score.mirrored


def test_pictures_flipped_the_other_way_are_turned_half_round() -> None:
    """Left-right instead of top-bottom: a picture turned by 180 degrees, so that a camera turned so is right."""
    truth, half = device().truth, np.diag([-1.0, -1.0, 1.0, 1.0])
    rig = true_rig(truth)
    lens = lens_of(rig.cameras[0])
    k1, k2, p1, p2, k3 = lens.distortion
    turned = lens.replaced(
        cx_px=lens.width_px - 1 - lens.cx_px, cy_px=lens.height_px - 1 - lens.cy_px, distortion=[k1, k2, -p1, -p2, k3]
    )
    cameras = tuple(replace(camera, lens=turned, camera_from_rig=half @ pose_of(camera)) for camera in rig.cameras)
    score = device().score(replace(rig, cameras=cameras), pictures="left-right")
    assert value(score, "max_px") < EXACT


@pytest.mark.parametrize(
    ("factor", "complaint"), [(1000.0, "1e+03 times as far apart"), (0.001, "0.001 times as far apart")]
)
def test_another_unit_is_noticed(factor: float, complaint: str) -> None:
    rig = moved(true_rig(device().truth), np.diag([factor, factor, factor, 1.0]))
    with pytest.raises(InputError, match="--unit") as caught:
        device().score(rig)
    assert complaint in str(caught.value)


def test_a_calibration_that_looks_elsewhere_is_refused() -> None:
    rig = true_rig(device().truth)
    back = np.diag([1.0, -1.0, -1.0, 1.0])
    alone = tuple(replace(camera, camera_from_rig=back @ pose_of(camera)) for camera in rig.cameras[:1])
    swapped = changed(rig, 0, camera_from_rig=back @ pose_of(rig.cameras[0]))
    assert value(device().score(replace(rig, cameras=alone)), "max_px") < 1e-8  # alone, it may stand anywhere
    with pytest.raises(InputError, match=r"camera 'view_0_0' shows 0% of what view_0_0 does"):
        device().score(swapped)


def test_layouts_of_different_devices_are_refused() -> None:
    other = device().nominal.replaced(rows=1, mirrors=device().nominal.mirrors[:3], spec=None)
    with pytest.raises(InputError, match="different devices"):
        replace(device(), nominal=other).score(true_rig(device().truth))
    with pytest.raises(InputError, match="the calibration has 1 x 3 mirrors, expected 2 x 3 like the set"):
        device().score(rig_of(other))
