"""Numbers in files: valid and invalid ones, and invalid cameras."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import (
    SphereLens,
    SphereName,
    camera_of,
    number_of,
    numbers_of,
    orthogonal,
    size_of,
)
from mirrorcam.optics.geometry.camera import Camera
from tests.optics.camera_files.rigs import changed, device, true_rig

CAMERA = Camera(
    width_px=640, height_px=480, fx_px=300.0, fy_px=310.0, cx_px=320.0, cy_px=240.0, distortion=[0.02, 0.0, 1e-3, 0, 0]
)


def test_a_rotation_of_a_few_digits_is_made_exact() -> None:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    found = orthogonal(turn + 2e-6, "here")
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(found, turn, atol=5e-6)
    assert np.linalg.det(orthogonal(np.diag([-1.0, 1.0, 1.0]), "here")) == pytest.approx(-1.0)
    with pytest.raises(InputError, match="here: not a rotation"):
        orthogonal(1.01 * turn, "here")
    with pytest.raises(InputError, match="expected a rotation"):
        orthogonal(np.eye(4), "here")


@pytest.mark.parametrize(("value", "number"), [(1, 1.0), (2.5, 2.5), ("1e-05", 1e-5), (np.float32(0.5), 0.5)])
def test_numbers(value: object, number: float) -> None:
    assert number_of(value, "here") == number


@pytest.mark.parametrize("value", [True, None, "a", [1.0], float("inf"), "nan", {}])
def test_what_is_no_number(value: object) -> None:
    with pytest.raises(InputError, match=r"^here: "):
        number_of(value, "here")


def test_lists_of_numbers_and_sizes() -> None:
    assert numbers_of((1, "2"), "here", 2) == [1.0, 2.0]
    assert size_of([640, 480], "here") == (640, 480)
    for wrong in ([0, 480], [640.5, 480], [640, 70000]):
        with pytest.raises(InputError, match="expected the size of a picture"):
            size_of(wrong, "here")


def test_an_invalid_camera_is_refused_in_one_line() -> None:
    assert camera_of("here", [1.0, 2.0, 3.0, 4.0], "fisheye", [0.0] * 4, (640, 480)).width_px == 640
    with pytest.raises(InputError, match=r"^here: fx_px: .*greater than or equal"):
        camera_of("here", [0.0, 2.0, 3.0, 4.0], "fisheye", [0.0] * 4, None)
    with pytest.raises(InputError, match=r"^here: distortion: .*expected 4 for a fisheye lens"):
        camera_of("here", [1.0, 2.0, 3.0, 4.0], "fisheye", [0.0] * 3, None)


def test_a_rig_is_posed_where_all_its_cameras_are() -> None:
    rig = true_rig(device().truth)
    assert rig.posed
    assert not changed(rig, 0, camera_from_rig=None).posed


def rays() -> FloatArray:
    return np.random.default_rng(0).uniform([-0.8, -0.8, 0.5], [0.8, 0.8, 2.0], (60, 3))


def shown(model: SphereName, *numbers: float) -> FloatArray:
    return SphereLens(model, np.array(numbers), CAMERA).project(rays())


@pytest.mark.parametrize(
    ("model", "numbers"), [("unified", (0.0,)), ("extended_unified", (0.0, 1.3)), ("double_sphere", (0.0, 0.0))]
)
def test_without_a_sphere_they_are_pinholes(model: SphereName, numbers: tuple[float, ...]) -> None:
    np.testing.assert_allclose(shown(model, *numbers), CAMERA.project(rays()), atol=1e-9)


@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.8])
def test_they_are_one_another(alpha: float) -> None:
    """alpha d + (1 - alpha) z for both; (1 - alpha) (z + xi d) for the unified model with xi = alpha / (1 - alpha)."""
    extended = shown("extended_unified", alpha, 1.0)
    np.testing.assert_allclose(shown("double_sphere", 0.0, alpha), extended, atol=1e-9)
    scaled = CAMERA.replaced(distortion=[0.0] * 5)
    factor = 1.0 - alpha
    unified = SphereLens(
        "unified", np.array([alpha / factor]), scaled.replaced(fx_px=300.0 / factor, fy_px=310.0 / factor)
    )
    plain = SphereLens("extended_unified", np.array([alpha, 1.0]), scaled)
    np.testing.assert_allclose(unified.project(rays()), plain.project(rays()), atol=1e-9)


@pytest.mark.parametrize(
    ("model", "numbers"), [("unified", (0.8,)), ("extended_unified", (0.6, 1.1)), ("double_sphere", (-0.2, 0.55))]
)
def test_rays_from_behind_are_not_shown(model: SphereName, numbers: tuple[float, ...]) -> None:
    lens = SphereLens(model, np.array(numbers), CAMERA)
    found = lens.project(np.array([[0.0, 0.0, 1.0], [0.01, 0.0, -1.0], [0.0, 0.0, 0.0]]))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()


def test_parameters_are_those_of_sphere_and_camera() -> None:
    lens = SphereLens("double_sphere", np.array([-0.2, 0.55]), CAMERA)
    assert lens.intrinsic_names[:4] == ("xi", "alpha", "fx_px", "fy_px")
    other = lens.with_intrinsics(lens.intrinsics + 0.01)
    np.testing.assert_allclose(other.intrinsics, lens.intrinsics + 0.01)
