"""Larger lenses as additions: which are left, what they free, and that evidence finds the lens of the pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.lens_additions import free_intrinsics, further_lenses, with_addition
from mirrorcam.optics.calibration.diagnostics.model_comparison import compare
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as, fit_with, foreseen_gain, joint_model
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.targets import Checkerboard
from tests.optics.calibration.solver.scenes import SIGMA_PX, nominal_layout, scene
from tests.optics.geometry.lenses.cameras import points

TARGET = Checkerboard(cols=14, rows=10, square_mm=14.0)
FRAMES, BASE = 9, 5
LENSES: dict[str, tuple[LensName, list[float]]] = {
    "joint+rational": ("rational", [1.2, 0.5, 4e-4, -6e-4, 0.1, 1.3, 0.9, 0.15]),
    "joint+prism": ("thin_prism", [0.05, -0.12, 4e-4, -6e-4, 0.01, 0.0, 0.0, 0.0, 1.5e-3, -8e-4, -1e-3, 6e-4]),
    "joint+fisheye": ("fisheye", [-0.02, 0.006, -0.004, 0.001]),
    "joint": ("brown_conrady", [0.05, -0.12, 4e-4, -6e-4, 0.01]),
}


def test_additions_lead_from_one_lens_to_the_next_and_keep_what_is_seen() -> None:
    camera = Camera.c920().replaced(distortion=[0.05, -0.12, 4e-4, -6e-4, 0.01])
    assert set(further_lenses(camera, ("joint",))) == {"rational", "prism", "fisheye", "spline"}
    for path in (("rational", "prism"), ("prism", "rational")):
        grown, made = camera, ["joint"]
        for addition in path:
            assert addition in further_lenses(grown, made)
            grown, made = with_addition(grown, addition), [*made, addition]
            np.testing.assert_array_equal(grown.project(points()), camera.project(points()))
        assert grown.lens_model == "thin_prism"
        assert further_lenses(grown, made) == ()
        assert free_intrinsics(grown, made) == grown.intrinsic_names
    fisheye = with_addition(camera, "fisheye")
    assert further_lenses(fisheye, ("joint", "fisheye")) == ()
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
    """Corners that a camera shows, with noise, and the joint fit of a Brown-Conrady lens to them."""
    nominal = nominal_layout()
    taken = scene(nominal.replaced(camera=camera), frames=frames, base_frames=base_frames, target=TARGET, seed=1)
    seen, _ = taken.noisy(0)
    seen = replace(seen, sigma_px=np.full(len(seen), SIGMA_PX))
    start = replace(taken.truth, camera=nominal.camera.replaced(distortion=LENSES["joint"][1]))
    model = joint_model(start.camera, TARGET.corners_in_board_mm)
    return fit_as("joint", start, seen, model), seen


def test_a_field_is_foreseen_where_residuals_have_a_pattern_and_only_there() -> None:
    plain = nominal_layout().camera.replaced(distortion=LENSES["joint"][1])
    joint, seen = fitted(plain, 5, 3)
    assert [foreseen_gain(name, joint, seen) > 0.0 for name in ("spline", "rational", "prism")] == [False] * 3
    joint, seen = fitted(waving(plain), 5, 3)
    assert foreseen_gain("spline", joint, seen) > 500.0


@pytest.mark.slow
def test_evidence_finds_a_field_that_no_formula_has() -> None:
    plain = nominal_layout().camera.replaced(distortion=LENSES["joint"][1])
    joint, seen = fitted(waving(plain), FRAMES, BASE)
    made = compare(fit_with("spline", joint, seen), joint, seen)
    assert made.supported
    assert made.held_out_rms_px < 1.03 * SIGMA_PX


@pytest.mark.parametrize("level", LENSES)
def test_evidence_finds_the_lens_that_took_the_pictures(level: str) -> None:
    nominal = nominal_layout()
    model, distortion = LENSES[level]
    layout = nominal.replaced(camera=nominal.camera.replaced(lens_model=model, distortion=distortion))
    taken = scene(layout, frames=FRAMES, base_frames=BASE, target=TARGET, seed=1)
    seen, _ = taken.noisy(0)
    frames = [seen.where(seen.frame == k).shifted(-k) for k in range(FRAMES + BASE)]
    found = calibrate_corners(frames[:FRAMES], frames[FRAMES:], nominal, TARGET.corners_in_board_mm)
    assert found.diagnostics is not None
    assert found.diagnostics.level == level
    assert not found.diagnostics.alarms
    assert found.metrics["held_out_scale"].value < 1.05
    np.testing.assert_allclose([found.metrics[f"rms_{axis}_px"].value for axis in "xy"], 0.05, rtol=0.04)


def test_a_stated_lens_is_kept() -> None:
    nominal = nominal_layout()
    model, distortion = LENSES["joint+fisheye"]
    layout = nominal.replaced(camera=nominal.camera.replaced(lens_model=model, distortion=distortion))
    taken = scene(layout, frames=5, base_frames=3, target=TARGET, seed=1)
    seen, _ = taken.noisy(0)
    frames = [seen.where(seen.frame == k).shifted(-k) for k in range(8)]
    requested = RequestedModel(lens=model)
    found = calibrate_corners(frames[:5], frames[5:], nominal, TARGET.corners_in_board_mm, model=requested)
    assert found.layout.camera.lens_model == model
    assert found.diagnostics is not None
    assert not found.diagnostics.alarms


def test_a_model_adds_what_the_lens_can_become() -> None:
    nominal = nominal_layout()
    nominal = nominal.replaced(camera=with_addition(nominal.camera, "fisheye"))
    taken = scene(nominal, frames=5, base_frames=3, target=TARGET, seed=2)
    seen, _ = taken.noisy(0)
    frames = [seen.where(seen.frame == k).shifted(-k) for k in range(8)]
    model = RequestedModel(additions=("prism",))
    with pytest.raises(InputError, match=r"level joint\+prism: the camera already has a fisheye lens"):
        calibrate_corners(frames[:5], frames[5:], nominal, TARGET.corners_in_board_mm, model=model)
