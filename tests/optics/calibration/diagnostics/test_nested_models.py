"""The nested models: names of levels, free parameters of each, and plates that look like plane mirrors."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.model_comparison import compare
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    PLATE_INDEX,
    PLATE_MM,
    Fitted,
    as_second_surface,
    extended,
    fit_as,
    fit_with,
    free_intrinsics,
    further_cameras,
    joint_model,
    paper_model,
    plate_thickness,
    with_addition,
)
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Board, residuals
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from tests.nightly import a_few
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, Scene
from tests.optics.calibration.solver.scenes import SIGMA_PX, nominal_layout, scene
from tests.optics.geometry.lenses.cameras import points

CAMERA, CORNERS = Camera.c920(), BOARD.corners_in_board_mm
TARGET = Checkerboard(cols=14, rows=10, square_mm=14.0)
FRAMES, BASE = 9, 5
LENSES: dict[str, tuple[LensName, list[float]]] = {
    "joint+rational": ("rational", [1.2, 0.5, 4e-4, -6e-4, 0.1, 1.3, 0.9, 0.15]),
    "joint+prism": ("thin_prism", [0.05, -0.12, 4e-4, -6e-4, 0.01, 0.0, 0.0, 0.0, 1.5e-3, -8e-4, -1e-3, 6e-4]),
    "joint+fisheye": ("fisheye", [-0.02, 0.006, -0.004, 0.001]),
    "joint": ("brown_conrady", [0.05, -0.12, 4e-4, -6e-4, 0.01]),
}


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


def test_plates_look_the_same_along_the_chief_rays(scene: Scene) -> None:
    """Corners near the middle of each mirror move by a small part of the motion of the others."""
    start = scene.start
    middles = start.centroids_in_rig_mm
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


def test_without_a_plate_in_the_layout_its_thickness_cannot_vary(scene: Scene, solution: Solution) -> None:
    joint = fit_as("joint", solution.estimate, scene.noisy(0), JOINT)
    with pytest.raises(InputError, match="no second-surface mirror"):
        fit_with("sheet", joint, scene.noisy(0))


def test_the_plates_of_first_surface_mirrors_are_estimated_thin(scene: Scene, solution: Solution) -> None:
    joint = fit_as("joint", solution.estimate, scene.noisy(0), JOINT)
    plates = fit_with("glass", joint, scene.noisy(0))
    assert plates.name == "joint+glass"
    thickness, sigma = plate_thickness(plates)
    assert abs(thickness) < 4.0 * sigma


def test_no_cause_is_found_in_corners_without_noise(scene: Scene) -> None:
    """Residuals and noise of exactly 0 must not be divided by."""
    fitted = fit_as("joint", scene.start, scene.clean, JOINT)
    nothing = np.zeros_like(fitted.solution.standardised)
    exact = replace(fitted, solution=replace(fitted.solution, standardised=nothing, residuals=nothing, scale=0.0))
    with np.errstate(all="raise"):
        assert ranked_causes(exact, scene.clean) == []
        assert ranked_causes(fitted, scene.clean) == []


def test_additions_lead_from_one_lens_to_the_next_without_moving_pixels() -> None:
    camera = Camera.c920().replaced(distortion=[0.05, -0.12, 4e-4, -6e-4, 0.01])
    assert set(further_cameras(camera, ("joint",))) == {"walk", "colour", "rational", "prism", "fisheye", "spline"}
    for path in (("rational", "prism"), ("prism", "rational")):
        grown, made = camera, ["joint"]
        for addition in path:
            assert addition in further_cameras(grown, made)
            grown, made = with_addition(grown, addition), [*made, addition]
            np.testing.assert_array_equal(grown.project(points()), camera.project(points()))
        assert grown.lens_model == "thin_prism"
        assert further_cameras(grown, made) == ("walk", "colour")
        assert free_intrinsics(grown, made) == grown.intrinsic_names
    fisheye = with_addition(camera, "fisheye")
    assert further_cameras(with_addition(fisheye, "walk"), ("joint", "fisheye", "walk")) == ("colour",)
    assert np.nanmax(np.abs(fisheye.project(points(half_width=0.5)) - camera.project(points(half_width=0.5)))) < 2.0


def test_a_prism_alone_leaves_the_quotient_as_it_is() -> None:
    prism = with_addition(Camera.c920(), "prism")
    assert set(prism.intrinsic_names) - set(free_intrinsics(prism, ("joint", "prism"))) == {"k4", "k5", "k6"}


def waving(camera: Camera) -> Camera:
    """A camera with a random field of 0.1 px."""
    empty = with_addition(camera, "spline")
    field = 1e-4 * np.random.default_rng(0).standard_normal(len(empty.distortion) - 5)
    return empty.replaced(distortion=np.append(camera.distortion, field))


def fitted(camera: Camera, frames: int, base_frames: int) -> tuple[Fitted, Observations]:
    """Return a camera's corners with noise, and the joint fit of a Brown-Conrady lens to them."""
    nominal = nominal_layout()
    taken = scene(nominal.replaced(camera=camera), frames=frames, base_frames=base_frames, board=TARGET, seed=1)
    seen, _ = taken.noisy(0)
    seen = replace(seen, sigma_px=np.full(len(seen), SIGMA_PX))
    start = replace(taken.truth, camera=nominal.camera.replaced(distortion=LENSES["joint"][1]))
    model = joint_model(start.camera, TARGET.corners_in_board_mm)
    return fit_as("joint", start, seen, model), seen


def test_a_field_is_predicted_only_where_residuals_have_a_pattern() -> None:
    plain = nominal_layout().camera.replaced(distortion=LENSES["joint"][1])
    joint, seen = fitted(plain, 5, 3)
    assert ranked_causes(joint, seen) == []
    joint, seen = fitted(waving(plain), 5, 3)
    first = ranked_causes(joint, seen)[0]
    assert (first.addition, first.gain > 500.0) == ("spline", True)


@pytest.mark.slow
def test_evidence_finds_a_field_that_no_formula_has() -> None:
    plain = nominal_layout().camera.replaced(distortion=LENSES["joint"][1])
    joint, seen = fitted(waving(plain), FRAMES, BASE)
    made = compare(fit_with("spline", joint, seen), joint, seen)
    assert made.supported
    assert made.held_out_rms_px < 1.03 * SIGMA_PX


@pytest.mark.parametrize("level", a_few(1, LENSES))
def test_evidence_finds_the_lens_that_took_the_pictures(level: str) -> None:
    nominal = nominal_layout()
    model, distortion = LENSES[level]
    layout = nominal.replaced(camera=nominal.camera.replaced(lens_model=model, distortion=distortion))
    taken = scene(layout, frames=FRAMES, base_frames=BASE, board=TARGET, seed=1)
    seen, _ = taken.noisy(0)
    frames = [seen.where(seen.frame == k).with_frame_offset(-k) for k in range(FRAMES + BASE)]
    found = calibrate_corners(frames[:FRAMES], frames[FRAMES:], nominal, TARGET.corners_in_board_mm)
    assert found.diagnostics is not None
    assert found.diagnostics.model_name == level
    assert not found.diagnostics.alarms
    assert found.metrics["held_out_scale"].value < 1.05
    np.testing.assert_allclose([found.metrics[f"rms_{axis}_px"].value for axis in "xy"], 0.05, rtol=0.04)


def test_a_stated_lens_is_kept() -> None:
    nominal = nominal_layout()
    model, distortion = LENSES["joint+fisheye"]
    layout = nominal.replaced(camera=nominal.camera.replaced(lens_model=model, distortion=distortion))
    taken = scene(layout, frames=5, base_frames=3, board=TARGET, seed=1)
    seen, _ = taken.noisy(0)
    frames = [seen.where(seen.frame == k).with_frame_offset(-k) for k in range(8)]
    requested = RequestedModel(lens=model)
    found = calibrate_corners(frames[:5], frames[5:], nominal, TARGET.corners_in_board_mm, model=requested)
    assert found.layout.camera.lens_model == model
    assert found.diagnostics is not None
    assert not found.diagnostics.alarms


def test_a_model_adds_the_extensions_of_its_lens() -> None:
    nominal = nominal_layout()
    nominal = nominal.replaced(camera=with_addition(nominal.camera, "fisheye"))
    taken = scene(nominal, frames=5, base_frames=3, board=TARGET, seed=2)
    seen, _ = taken.noisy(0)
    frames = [seen.where(seen.frame == k).with_frame_offset(-k) for k in range(8)]
    model = RequestedModel(additions=("prism",))
    with pytest.raises(InputError, match=r"model joint\+prism: the camera already has a fisheye lens"):
        calibrate_corners(frames[:5], frames[5:], nominal, TARGET.corners_in_board_mm, model=model)
