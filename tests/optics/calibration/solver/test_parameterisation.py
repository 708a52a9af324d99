"""Names and indices of the free parameters of a model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.parameterisation import PAIR_DEG, FrameTerms, Model, pair_prior, rotated_like
from mirrorcam.optics.calibration.solver.residuals import Board, global_names
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, reflect
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.solver.four_mirrors import four_mirrors
from tests.optics.calibration.sound_calibration import BOARD, board_poses, nominal_layout, true_layout
from tests.optics.calibration.synthetic_corners import views_of

CAMERA = Camera.c920()


def test_models_name_their_free_parameters() -> None:
    board = Board.warped(np.array([[x, y, 0.0] for y in range(3) for x in range(4)]))
    names = Model(("k1", "fx_px"), thickness=True, curvature=True, board=board).parameters(CAMERA, 2)
    assert names[:4] == ("fx_px", "k1", "mirror 0 x_mm", "mirror 0 y_mm")
    assert names[-4:] == ("mirror 1 curvature_xy_per_m", "sheet_mm", "board mode 0_mm", "board mode 1_mm")
    assert len(names) == len(set(names)) == 2 + 2 * 6 + 1 + 2
    held = Model((), thickness=False, curvature=False, board=Board.rigid(board.corners_in_board_mm), mirrors=False)
    assert held.parameters(CAMERA, 2) == ()
    with pytest.raises(ValueError, match=r"unknown intrinsics k9, expected some of fx_px, "):
        Model(("k9",), thickness=False, curvature=False, board=board).parameters(CAMERA, 2)


def test_the_indices_of_free_globals_match_their_names() -> None:
    model = Model(("cy_px",), thickness=True, curvature=False, board=Board.rigid(np.zeros((1, 3))))
    every = global_names(CAMERA.intrinsic_names, 3, 0)
    assert tuple(every[place] for place in model.free(CAMERA, 3)) == model.parameters(CAMERA, 3)
    assert (np.diff(model.free(CAMERA, 3)) > 0).all()


def test_frame_terms_name_and_weight_their_numbers() -> None:
    truth = four_mirrors().truth
    frames = len(truth.rig_from_board)
    own = replace(truth, camera_rotation=np.full((frames, 3), 0.02), bow_mm=np.full((frames, 3), 0.5))
    none, bow, both = FrameTerms(), FrameTerms(bow_per_mm=4.0), FrameTerms(100.0, 4.0)
    motion = FrameTerms(None, None, 100.0, 2.0, 50.0, 1.0)
    assert [len(terms.free) for terms in (none, bow, both, motion)] == [6, 9, 12, 18]
    assert bow.free[6:].tolist() == [9, 10, 11]
    assert motion.free[6:].tolist() == list(range(12, 24))
    assert motion.names == ("motion_per_rad", "motion_per_mm", "acceleration_per_rad", "acceleration_per_mm")
    np.testing.assert_allclose(none.values(own), 0.0)
    np.testing.assert_allclose(both.values(own)[0], [*[0.0] * 6, *[2.0] * 3, *[2.0] * 3])


def pair(layout: Layout) -> Layout:
    """The lower two mirrors of a layout of 2 x 2."""
    return layout.replaced(rows=1, cols=2, mirrors=layout.mirrors[:2])


def about_line(layout: Layout, angle: float) -> tuple[Layout, FloatArray]:
    """Return a pair rotated by an angle about the line of its planes, computed here, and the motion (4, 4)."""
    first, second = layout.mirrors
    line = np.cross(first.normal_in_rig, second.normal_in_rig)
    line /= np.linalg.norm(line)
    planes = np.array([first.normal_in_rig, second.normal_in_rig, line])
    point = np.linalg.solve(planes, [m.normal_in_rig @ m.outline_in_rig_mm[0] for m in layout.mirrors] + [0.0])
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(angle * line).as_matrix()
    motion[:3, 3] = point - motion[:3, :3] @ point
    moved = [
        Mirror.from_plane(
            transform(motion, mirror.outline_in_rig_mm[:1])[0],
            motion[:3, :3] @ mirror.normal_in_rig,
            outline_in_rig_mm=transform(motion, mirror.outline_in_rig_mm),
        )
        for mirror in layout.mirrors
    ]
    return layout.replaced(mirrors=tuple(moved), view_from_rig=layout.view_from_rig @ motion[:3, :3].T), motion


def relative(mirrors: tuple[Mirror, ...]) -> FloatArray:
    """Return the motion (4, 4) from the first view to the second, which is that of two reflections."""
    points = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]])
    once = reflect(points, mirrors[0].virtual_centre_in_rig_mm)
    return np.asarray(reflect(once, mirrors[1].virtual_centre_in_rig_mm))


@cache
def calibrated() -> Calibration:
    views = views_of(pair(true_layout()), BOARD, *board_poses(), noise_px=0.05)
    return calibrate_corners(views.mirrored, views.base, pair(nominal_layout()), BOARD.corners_in_board_mm)


def test_pictures_do_not_depend_on_the_rotation_of_the_pair() -> None:
    built = pair(true_layout())
    turned, _ = about_line(built, -0.01)
    _, motion = about_line(built, 0.02)
    board = np.array([[10.0, -20.0, 400.0], [-50.0, 30.0, 500.0], [40.0, 60.0, 450.0]])
    moved = transform(motion, board)
    assert np.abs(moved - board).max() > 5.0
    for mirror, other in zip(built.mirrors, turned.mirrors, strict=True):
        shown = reflect(moved, mirror.virtual_centre_in_rig_mm)
        np.testing.assert_allclose(reflect(board, other.virtual_centre_in_rig_mm), shown, atol=1e-9)


def test_a_rotated_pair_is_rotated_back() -> None:
    built = pair(true_layout())
    turned, _ = about_line(built, 0.03)
    found, angle = rotated_like(turned, built)
    assert abs(angle) == pytest.approx(0.03, rel=1e-9)
    np.testing.assert_allclose(found.virtual_centres_in_rig_mm, built.virtual_centres_in_rig_mm, atol=1e-9)
    np.testing.assert_allclose(found.view_from_rig, built.view_from_rig, atol=1e-12)


def test_the_prior_is_one_standard_deviation_at_its_angle() -> None:
    design = pair(nominal_layout())
    prior = pair_prior(design)
    assert prior is not None
    assert prior.value(design.virtual_centres_in_rig_mm) == pytest.approx(0.0, abs=1e-9)
    turned, _ = about_line(design, np.deg2rad(PAIR_DEG))
    assert abs(prior.value(turned.virtual_centres_in_rig_mm)) == pytest.approx(1.0, rel=0.01)


def test_three_mirrors_need_no_prior_and_one_is_refused() -> None:
    design = nominal_layout()
    assert pair_prior(design) is None
    alone = design.replaced(rows=1, cols=1, mirrors=design.mirrors[:1])
    with pytest.raises(InputError, match="one mirror without a direct view of the board, expected two or more"):
        pair_prior(alone)
    parallel = design.mirrors[0].moved(np.eye(3), -150.0 * design.mirrors[0].rig_from_plane[:3, 0])
    with pytest.raises(InputError, match="both mirrors are parallel"):
        pair_prior(pair(design).replaced(mirrors=(design.mirrors[0], parallel)))


def test_a_pair_is_calibrated_up_to_its_rotation() -> None:
    found, built = calibrated(), pair(true_layout())
    assert any(note.startswith("two mirrors without a direct view") for note in found.notes)
    assert found.metrics["common_turn_sigma_deg"].value == pytest.approx(PAIR_DEG, rel=0.05)
    np.testing.assert_allclose(relative(found.layout.mirrors), relative(built.mirrors), atol=0.05)
    turned, angle = rotated_like(found.layout, built)
    assert abs(np.rad2deg(angle)) < 3.0 * PAIR_DEG
    for mirror, true in zip(turned.mirrors, built.mirrors, strict=True):
        assert np.degrees(np.linalg.norm(np.cross(mirror.normal_in_rig, true.normal_in_rig))) < 0.01


def test_the_estimated_rotation_is_the_designs() -> None:
    """The corners do not constrain the pair's rotation: the fit ends at the expected value of the prior."""
    prior = pair_prior(pair(nominal_layout()))
    assert prior is not None
    assert prior.value(calibrated().layout.virtual_centres_in_rig_mm) == pytest.approx(0.0, abs=1e-3)


def test_another_prior_rotates_the_pair_and_keeps_the_residuals() -> None:
    views = views_of(pair(true_layout()), BOARD, *board_poses(), noise_px=0.05)
    elsewhere, _ = about_line(pair(nominal_layout()), np.deg2rad(0.5))
    other = calibrate_corners(views.mirrored, views.base, elsewhere, BOARD.corners_in_board_mm)
    assert other.metrics["rms_x_px"].value == pytest.approx(calibrated().metrics["rms_x_px"].value, rel=1e-3)
    np.testing.assert_allclose(relative(other.layout.mirrors), relative(calibrated().layout.mirrors), atol=0.01)
