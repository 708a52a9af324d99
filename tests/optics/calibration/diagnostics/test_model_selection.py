"""Forward selection: each cause is identified, noise is ignored, and a model that is too small raises an alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, select_model
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import (
    BOARD,
    NOISE_PX,
    Scene,
    behind_glass,
    bent,
    scene_of,
)
from tests.optics.calibration.diagnostics.moving_boards import MovingBoards


def selected(scene: Scene, nominal: Layout, seed: int, model: str = "auto") -> ModelSelection:
    """Return the model selected for a layout with the mirrors of `nominal`."""
    start = Estimate.of(nominal.camera, nominal.mirrors, scene.poses)
    return select_model(start, scene.noisy(seed), BOARD.corners_in_board_mm, model=RequestedModel.parse(model))


@pytest.fixture(scope="module")
def warped(device: Layout) -> Scene:
    return scene_of(device, warp_mm=0.2)


@pytest.fixture(scope="module")
def of_warped(warped: Scene, device: Layout) -> ModelSelection:
    return selected(warped, device, 0)


def assert_noise_alone_is_recognised(scene: Scene, nominal: Layout, seeds: range) -> None:
    found = [selected(scene, nominal, seed) for seed in seeds]
    quiet = [selection for selection in found if selection.model_name == "joint" and not selection.alarms]
    assert len(quiet) >= 0.95 * len(found)


def test_noise_alone_needs_no_further_level_and_raises_no_alarm(scene: Scene, device: Layout) -> None:
    assert_noise_alone_is_recognised(scene, device, range(6))


@pytest.mark.slow
def test_noise_alone_selects_no_larger_model_in_19_of_20_sets(scene: Scene, device: Layout) -> None:
    assert_noise_alone_is_recognised(scene, device, range(100, 200))


def test_outliers_select_no_larger_model(scene: Scene, device: Layout) -> None:
    seen = scene.noisy(7)
    random = np.random.default_rng(7)
    bad = random.random(len(seen)) < 0.01
    shift = 20.0 * NOISE_PX * np.sign(random.normal(size=(len(seen), 2))) * bad[:, None]
    start = Estimate.of(device.camera, device.mirrors, scene.poses)
    found = select_model(start, replace(seen, pixels=seen.pixels + shift), BOARD.corners_in_board_mm)
    assert (found.model_name, found.alarms) == ("joint", ())


def test_a_warped_board_is_identified(of_warped: ModelSelection) -> None:
    assert of_warped.model_name == "joint+warp"
    assert of_warped.alarms == ()
    np.testing.assert_allclose(of_warped.solution.estimate.shape, [0.2, 0.0], atol=0.02)


def test_bent_mirrors_are_identified(device: Layout) -> None:
    truth = bent(device, 0.1)
    found = selected(scene_of(truth), device, 0)
    assert found.model_name == "joint+bend"
    assert found.alarms == ()
    expected = np.array([mirror.curvature_per_m for mirror in truth.mirrors])
    np.testing.assert_allclose(found.solution.estimate.curvature_per_m, expected, atol=2e-3)


def test_a_plate_of_another_thickness_is_identified(device: Layout) -> None:
    found = selected(scene_of(behind_glass(device, 2.0)), behind_glass(device, 1.7), 0)
    assert found.model_name == "joint+sheet"
    assert found.alarms == ()
    place = found.solution.parameters.index("sheet_mm")
    sigma = np.sqrt(found.solution.covariance[place, place])
    assert abs(found.solution.estimate.thickness_mm[0] - 2.0) < 3 * sigma < 0.2


def test_plates_and_a_warped_board_are_both_identified(device: Layout) -> None:
    found = selected(scene_of(behind_glass(device, 2.0), warp_mm=0.2), behind_glass(device, 1.7), 0)
    assert set(found.model_name.split("+")) == {"joint", "sheet", "warp"}


def test_second_surface_mirrors_that_the_layout_has_as_first_surface_raise_the_alarm(device: Layout) -> None:
    found = selected(scene_of(behind_glass(device, 2.0)), device, 0)
    assert found.model_name == "joint", "the layout is not overruled, but doubted"
    seen = found.other_surface
    assert seen is not None and seen.is_second_surface
    assert abs(seen.thickness_mm - 2.0) < 3.0 * seen.sigma_mm < 0.3
    narrow, wide = (seen.sentence(factor).split("+-")[1].split()[0] for factor in (1.0, 3.0))
    assert float(wide) == pytest.approx(3.0 * float(narrow), rel=0.1)
    assert found.alarms[0].startswith("the mirrors of the model joint leave residuals of 0.00")
    assert found.free_views is not None
    assert found.free_views.unexplained_px > 0.004


def test_a_requested_level_is_kept_and_the_next_one_recommended(warped: Scene, device: Layout) -> None:
    found = selected(warped, device, 0, model="joint")
    assert found.model_name == "joint"
    assert "the data support a larger model, joint+warp" in found.alarms
    assert len(found.solution.parameters) == 9 + 12


def test_a_requested_level_that_is_right_raises_no_alarm(device: Layout) -> None:
    found = selected(scene_of(bent(device, 0.02)), device, 0, model="joint+bend")
    assert found.model_name == "joint+bend"
    assert found.alarms == ()
    assert len(found.solution.parameters) == 9 + 12 + 12


def test_a_wrong_model_is_less_certain(warped: Scene, device: Layout, of_warped: ModelSelection) -> None:
    """The board's bow correlates the errors of a frame: sigmas must cover them, and a note must report them."""
    wrong = selected(warped, device, 0, model="joint")
    assert wrong.inflation > 1.5
    assert any("corners in one frame are correlated" in note for note in wrong.notes)
    assert of_warped.inflation == 1.0
    plain = wrong.solution.covariance / wrong.inflation**2
    np.testing.assert_allclose(wrong.inflated_to(1.0).solution.covariance, wrong.solution.covariance)
    np.testing.assert_allclose(wrong.inflated_to(10.0).solution.covariance, 100.0 * plain)


def test_the_model_of_the_paper_holds_the_camera(scene: Scene, device: Layout) -> None:
    found = selected(scene, device, 0, model="paper")
    assert found.model_name == "paper"
    assert found.alarms == (), "the camera it holds is the true one"
    assert found.notes == ("the intrinsics are fixed: no uncertainty includes their errors",)
    assert found.solution.estimate.camera == device.camera
    assert len(found.solution.parameters) == 12


def test_the_model_of_the_paper_with_a_wrong_camera_raises_the_alarm(scene: Scene, device: Layout) -> None:
    camera = device.camera.replaced(fx_px=1.005 * device.camera.fx_px, cx_px=device.camera.cx_px + 3.0)
    found = selected(scene, device.replaced(camera=camera), 0, model="paper")
    assert found.model_name == "paper"
    assert "the data support a larger model, joint" in found.alarms


def test_a_camera_that_corners_do_not_determine_is_held_and_noted(scene: Scene, device: Layout) -> None:
    """Thirteen corners: 26 numbers determine 12 of the mirrors and 6 of the pose, but not 9 more of a lens."""
    seen = scene.noisy(1)
    first = seen.where(seen.frame == 0)
    of_views = [np.flatnonzero(first.view == view) for view in range(4)]
    few = np.concatenate([rows[[0, len(rows) // 2 + 3, -1]] for rows in of_views] + [of_views[0][[4]]])
    first = first.where(np.isin(np.arange(len(first)), few))
    start = Estimate.of(device.camera, device.mirrors, scene.poses[:1])
    found = select_model(start, first, BOARD.corners_in_board_mm)
    assert found.model_name == "paper"
    assert found.notes[0].startswith("the corners do not determine the intrinsics")
    with pytest.raises(UndeterminedError):
        select_model(start, first, BOARD.corners_in_board_mm, model=RequestedModel())


def test_two_frames_cannot_be_held_out_and_support_no_further_level(warped: Scene, device: Layout) -> None:
    seen = warped.noisy(0)
    seen = seen.where(seen.frame < 2)
    found = select_model(Estimate.of(device.camera, device.mirrors, warped.poses[:2]), seen, BOARD.corners_in_board_mm)
    assert found.model_name == "joint"
    assert all(np.isnan(comparison.held_out_gain) and not comparison.supported for comparison in found.comparisons[1:])


def test_the_figures_of_each_comparison_follow_from_its_residuals(of_warped: ModelSelection) -> None:
    comparisons = {comparison.name: comparison for comparison in of_warped.comparisons}
    joint, warp = comparisons["joint"], comparisons["joint+warp"]
    assert warp.against == "joint"
    assert warp.parameters == joint.parameters + 2
    assert warp.supported
    assert warp.held_out_gain > 2
    assert warp.held_out_rms_px < 1.1 * NOISE_PX
    assert warp.chance == pytest.approx(chi2.sf(warp.drop, 2), abs=1e-12)


def test_first_surface_mirrors_have_no_plate_thickness(scene: Scene, device: Layout) -> None:
    with pytest.raises(InputError, match="the layout has no second-surface mirror"):
        selected(scene, device, 0, model="joint+sheet")


@pytest.mark.parametrize(("global_shutter", "expected"), [(True, "joint"), (False, "joint+motion")])
def test_only_boards_before_a_rolling_shutter_are_in_motion(global_shutter: bool, expected: str) -> None:
    boards = MovingBoards.of(0, frames=20, global_shutter=global_shutter)
    found = select_model(boards.truth, boards.noisy(0), BOARD.corners_in_board_mm)
    assert found.model_name == expected
    assert found.causes == ()
