"""All diagnostics of one calibration, from corners to the figures of its report."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics, diagnose, reference_of
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_uncertainty
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, select_model
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import depth_uncertainty
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.diagnostics.conftest import BOARD, NOISE_PX, Scene, behind_glass, scene_of


def gathered(scene: Scene, seed: int, model: str = "auto") -> Diagnostics:
    seen = scene.noisy(seed)
    reached = select_model(scene.start, seen, BOARD.corners_in_board_mm, model=RequestedModel.parse(model))
    return diagnose(reached, seen, scene.calibrated(reached.solution))


@pytest.fixture(scope="module")
def diagnostics(scene: Scene) -> Diagnostics:
    return gathered(scene, 4)


def test_a_good_calibration_raises_no_alarm(diagnostics: Diagnostics) -> None:
    assert diagnostics.model_name == "joint"
    assert diagnostics.alarms == ()
    assert diagnostics.notes == ()
    assert diagnostics.inflation == 1.0
    assert len(diagnostics.splits) == 2
    assert len(diagnostics.weak) == 3


def test_every_view_has_a_map_and_the_central_mirror_is_the_reference(diagnostics: Diagnostics, device: Layout) -> None:
    assert [shown.view for shown in diagnostics.projection] == [0, 1, 2, 3]
    assert diagnostics.reference == device.central_index == 3
    assert all(shown.range_mm == diagnostics.range_mm for shown in diagnostics.projection)


def test_the_figures_equal_those_of_the_parts(diagnostics: Diagnostics) -> None:
    figures = diagnostics.metrics
    assert diagnostics.mirrors is not None
    assert figures["alarms"].value == 0
    assert figures["mirror_to_mirror_normal_sigma_deg"].value == diagnostics.mirrors.relative_normal_deg.max()
    worst = max(shown.in_rig_px.max() for shown in diagnostics.projection)
    assert 0.0 < figures["projection_against_reference_sigma_px"].value < figures["projection_sigma_px"].value < worst
    assert diagnostics.depth.range_mm[0] < diagnostics.range_mm < diagnostics.depth.range_mm[-1]
    near, far = diagnostics.depth.calibration_mm[[0, -1]]
    assert near < figures["depth_calibration_sigma_mm"].value < far
    assert figures["unexplained_px"].value < 0.1 * NOISE_PX
    assert {"split_halves_ratio", "split_near_ratio"} <= figures.keys()
    assert all(np.isfinite(metric.value) for metric in figures.values())


def test_every_check_detects_a_wrong_model(device: Layout) -> None:
    """Boards that bow: model selection, free views and a split each detect it."""
    found = gathered(scene_of(device, warp_mm=0.3), 0, model="joint")
    assert any("joint+warp" in alarm for alarm in found.alarms)
    assert any(alarm.startswith("split") for alarm in found.alarms)
    assert found.metrics["alarms"].value == len(found.alarms) >= 2


def test_corners_without_noise_support_no_conclusion(scene: Scene) -> None:
    reached = select_model(scene.start, scene.clean, BOARD.corners_in_board_mm)
    assert (reached.model_name, reached.alarms, reached.notes) == ("joint", (), ())
    found = diagnose(reached, scene.clean, scene.calibrated(reached.solution))
    assert found.alarms == ()
    assert found.notes == ("not split: the corners have no noise to compare halves by",)


def test_halves_that_differ_widen_all_sigmas(device: Layout) -> None:
    scene = scene_of(device, warp_mm=0.3)
    seen = scene.noisy(0)
    reached = select_model(scene.start, seen, BOARD.corners_in_board_mm, model=RequestedModel())
    found = diagnose(reached, seen, scene.calibrated(reached.solution))
    assert found.inflation == max(reached.inflation, *(split.inflation for split in found.splits)) > reached.inflation
    layout = scene.calibrated(reached.inflated_to(found.inflation).solution)
    again = mirror_uncertainty(layout, lever_mm=found.range_mm)
    assert found.mirrors is not None
    np.testing.assert_allclose(found.mirrors.normal_deg, again.normal_deg, rtol=1e-9)
    assert (found.depth.calibration_mm > depth_of(scene, reached, found)).all()


def depth_of(scene: Scene, reached: ModelSelection, found: Diagnostics) -> FloatArray:
    layout = scene.calibrated(reached.solution)
    depth = found.depth
    return depth_uncertainty(
        layout, depth.range_mm, reference=found.reference, pixel=depth.pixel, matching_px=depth.matching_px
    ).calibration_mm


def test_glass_raises_the_alarm_of_the_splits(device: Layout) -> None:
    truth = scene_of(behind_glass(device, 2.0))
    flat = Scene(device, truth.poses, truth.clean)
    found = gathered(flat, 0)
    assert found.model_name == "joint"
    assert found.alarms[0].startswith("the mirrors appear to be second-surface")
    assert any(alarm.startswith("split") for alarm in found.alarms)


def test_a_board_seen_directly_and_in_mirrors_makes_the_direct_view_the_reference(scene: Scene, device: Layout) -> None:
    seen = scene.clean
    assert reference_of(seen, device) == 3
    direct = Observations.of_view(0, DIRECT, np.array([0]), np.zeros((1, 2)))
    assert reference_of(Observations.join([seen, direct]), device) == DIRECT
