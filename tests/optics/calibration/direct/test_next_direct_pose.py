"""The recommended pose for the next picture, with a board that is also seen directly, after each picture."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.next_pose import NOISE_PX, NextPose
from mirrorcam.optics.calibration.direct.direct_view import INTRINSICS
from mirrorcam.optics.calibration.direct.next_direct_pose import next_direct_pose
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.direct.two_mirrors import BOARD, CAMERA, corner_of_two_mirrors, corners_of, moved_by_hand

LAYOUT = corner_of_two_mirrors(90.0)


def shows_print(pose: FloatArray, view: int) -> bool:
    """Return whether a view sees the printed side of a board."""
    pupil = np.zeros(3) if view == DIRECT else LAYOUT.mirrors[view].virtual_centre_in_rig_mm
    return bool(((pupil - pose[:3, 3]) @ pose[:3, :3])[2] < 0.0)


def seen(poses: FloatArray) -> Observations:
    """Return the corners on the sensor of prints seen from the front."""
    _, rows = corners_of(LAYOUT, poses)
    size = np.array([CAMERA.width_px, CAMERA.height_px]) - 1.0
    towards = np.array([shows_print(poses[frame], view) for frame, view in zip(rows.frame, rows.view, strict=True)])
    return rows.where(((rows.pixels >= 0.0) & (rows.pixels <= size)).all(axis=1) & towards)


def hint(poses: FloatArray, *, base: tuple[Observations, ...] = ()) -> NextPose:
    """Return the recommendation after pictures of boards at some poses."""
    start, _ = corners_of(LAYOUT, poses)
    names = [f"{number}.png" for number in range(len(poses))]
    found = next_direct_pose(start, seen(poses), BOARD, intrinsics=INTRINSICS, pictures=names, base=base)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def followed() -> tuple[list[NextPose], FloatArray]:
    """Return a session of six pictures, all but the first by the hints, and their poses."""
    poses, advised = moved_by_hand(1), []
    for _ in range(5):
        advised.append(hint(poses))
        poses = np.concatenate([poses, advised[-1].rig_from_board[None]])
    return [*advised, hint(poses)], poses


@pytest.mark.slow
def test_following_the_hints_needs_fewer_pictures(followed: tuple[list[NextPose], FloatArray]) -> None:
    advised, _ = followed
    worst = [float(each.sigma_deg.max()) for each in advised]
    assert worst == sorted(worst, reverse=True)
    for now, then in pairwise(advised):
        # Mirrors may show more of the board than their known outlines.
        assert (then.sigma_deg < 1.02 * now.predicted_deg).all()
    by_chance = [float(hint(moved_by_hand(6, seed)).sigma_deg.max()) for seed in range(1, 6)]
    assert worst[-1] < 0.8 * min(by_chance)


def test_standard_deviations_match_the_solver() -> None:
    poses = moved_by_hand(8, seed=2)
    start, _ = corners_of(LAYOUT, poses)
    rows = seen(poses)
    noisy = replace(rows, pixels=rows.pixels + np.random.default_rng(1).normal(0.0, NOISE_PX, rows.pixels.shape))
    model = Model(INTRINSICS, thickness=False, curvature=False, board=Board.rigid(BOARD.corners_in_board_mm))
    solution = fit(start, noisy, model)
    for mirror, (sigma, centre) in enumerate(zip(hint(poses).sigma_deg, start.virtual_centres_in_rig_mm, strict=True)):
        at = solution.parameters.index(f"mirror {mirror} x_mm")
        away = np.eye(3) - np.outer(centre, centre) / (centre @ centre)
        block = away @ solution.covariance[at : at + 3, at : at + 3] @ away
        expected = np.degrees(np.sqrt(np.linalg.eigvalsh(block)[-1]) / np.linalg.norm(centre))
        # The camera has a prior of some per cent.
        assert 0.8 * expected < sigma < 1.05 * expected


def test_words_describe_how_to_move_the_board(followed: tuple[list[NextPose], FloatArray]) -> None:
    advised, poses = followed
    for each in advised:
        name = next(f"{n}.png" for n in range(len(poses)) if f"as in {n}.png" in each.sentence)
        before = poses[int(name[0])]
        half = np.array([*BOARD.size_mm, 0.0]) / 2.0
        old, new = (transform(pose, half) for pose in (before, each.rig_from_board))
        assert ("nearer" in each.sentence) == (new[2] < old[2] - 1.0)
        assert ("farther" in each.sentence) == (new[2] > old[2] + 1.0)
        # A rotation about the camera's x brings the upper edge nearer, or farther away.
        turn = each.rig_from_board[:3, :3] @ before[:3, :3].T
        nearer = {
            "upper": (turn @ [0.0, -1.0, 0.0])[2] < -0.1,
            "lower": (turn @ [0.0, 1.0, 0.0])[2] < -0.1,
            "left": (turn @ [-1.0, 0.0, 0.0])[2] < -0.1,
            "right": (turn @ [1.0, 0.0, 0.0])[2] < -0.1,
        }
        assert {edge for edge in nearer if f"its {edge} edge" in each.sentence} == {e for e, n in nearer.items() if n}


def test_the_pose_shows_the_print_directly_and_in_a_mirror(followed: tuple[list[NextPose], FloatArray]) -> None:
    for each in followed[0]:
        views = seen(each.rig_from_board[None]).view
        assert DIRECT in views
        assert len(np.unique(views)) > 1


def test_pictures_without_mirrors_count() -> None:
    poses = moved_by_hand(2, seed=3)
    rows = seen(moved_by_hand(6, seed=4))
    base = tuple(
        rows.where((rows.frame == frame) & (rows.view == DIRECT)).with_frame_offset(-frame) for frame in range(6)
    )
    without, helped = hint(poses), hint(poses, base=base)
    assert (helped.sigma_deg < without.sigma_deg).all()
