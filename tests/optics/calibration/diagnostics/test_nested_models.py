"""The nested models: names of levels, what each addition frees, and plates that look like plane mirrors."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    PLATE_INDEX,
    PLATE_MM,
    as_second_surface,
    extended,
    fit_as,
    fit_with,
    foreseen_gain,
    joint_model,
    paper_model,
    plate_thickness,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Board, residuals
from mirrorcam.optics.geometry.camera import Camera
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, Scene

CAMERA, CORNERS = Camera.c920(), BOARD.corners_in_board_mm


def test_every_model_is_nested_in_the_next() -> None:
    models = [joint_model(CAMERA, CORNERS)]
    for addition in ("sheet", "bend", "warp"):
        models.append(extended(models[-1], addition))
    names = [set(model.parameters(CAMERA, 4)) for model in (paper_model(CORNERS), *models)]
    assert [len(some) for some in names] == [12, 12 + 9, 12 + 9 + 1, 12 + 9 + 1 + 12, 12 + 9 + 1 + 12 + 2]
    assert all(smaller < larger for smaller, larger in pairwise(names))


def test_the_stand_in_for_plates_has_the_same_free_parameters_as_plates() -> None:
    stand_in, plates = extended(joint_model(CAMERA, CORNERS), "glass"), extended(joint_model(CAMERA, CORNERS), "sheet")
    assert stand_in.parameters(CAMERA, 4) == plates.parameters(CAMERA, 4)


def test_plates_look_alike_along_the_chief_rays(scene: Scene) -> None:
    """Corners near the middle of each mirror stay where they are to a part of what a plate moves the others by."""
    start = scene.start
    middles = start.middles_in_rig_mm
    rows = Observations.join([Observations.of_view(0, m, np.array([m]), np.zeros((1, 2))) for m in range(4)])
    # Points far out along the reflected chief rays: seen through the middle of each outline.
    units = start.virtual_centres_in_rig_mm / np.linalg.norm(start.virtual_centres_in_rig_mm, axis=1, keepdims=True)
    reflected = middles - 2.0 * np.sum(middles * units, axis=1, keepdims=True) * units
    points = Board.rigid(middles + 5.0 * reflected)
    pose = start.with_poses(np.eye(4)[None])
    plates = as_second_surface(pose, PLATE_MM, PLATE_INDEX)
    assert (plates.thickness_mm == PLATE_MM).all()
    np.testing.assert_allclose(residuals(plates, rows, points), residuals(pose, rows, points), atol=0.05)
    unmoved = replace(plates, virtual_centres_in_rig_mm=start.virtual_centres_in_rig_mm)
    moved = np.linalg.norm(residuals(unmoved, rows, points) - residuals(pose, rows, points), axis=1)
    assert (moved > 1.0).all()


def test_a_plate_cannot_vary_where_the_layout_has_none(scene: Scene, solution: Solution) -> None:
    joint = fit_as("joint", solution.estimate, scene.noisy(0), JOINT)
    with pytest.raises(InputError, match="no second-surface mirror"):
        fit_with("sheet", joint, scene.noisy(0))


def test_plates_of_first_surface_mirrors_come_out_thin(scene: Scene, solution: Solution) -> None:
    joint = fit_as("joint", solution.estimate, scene.noisy(0), JOINT)
    plates = fit_with("glass", joint, scene.noisy(0))
    assert plates.name == "joint+glass"
    thickness, sigma = plate_thickness(plates)
    assert abs(thickness) < 4.0 * sigma


@pytest.mark.parametrize("addition", ["spline", "rational", "fisheye"])
def test_no_lens_is_foreseen_of_corners_without_noise(scene: Scene, addition: str) -> None:
    """Residuals and noise that are exactly 0 are nothing to divide by."""
    fitted = fit_as("joint", scene.start, scene.clean, JOINT)
    nothing = np.zeros_like(fitted.solution.standardised)
    exact = replace(fitted, solution=replace(fitted.solution, standardised=nothing, scale=0.0))
    with np.errstate(all="raise"):
        assert foreseen_gain(addition, exact, scene.clean) == 0.0
        assert foreseen_gain(addition, fitted, scene.clean) <= 0.0
