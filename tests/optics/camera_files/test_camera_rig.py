"""Numbers of files: what is one, and cameras that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.camera_files.camera_rig import camera_of, number_of, numbers_of, orthogonal, size_of
from tests.optics.camera_files.rigs import changed, device, true_rig


def test_a_rotation_of_a_few_digits_is_made_exact() -> None:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    found = orthogonal(turn + 2e-6, "here")
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(found, turn, atol=5e-6)
    assert np.linalg.det(orthogonal(np.diag([-1.0, 1.0, 1.0]), "here")) == pytest.approx(-1.0)
    with pytest.raises(InputError, match="here: is no rotation"):
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


def test_a_camera_that_cannot_be_is_refused_in_one_line() -> None:
    assert camera_of("here", [1.0, 2.0, 3.0, 4.0], "fisheye", [0.0] * 4, (640, 480)).width_px == 640
    with pytest.raises(InputError, match=r"^here: fx_px: .*greater than or equal"):
        camera_of("here", [0.0, 2.0, 3.0, 4.0], "fisheye", [0.0] * 4, None)
    with pytest.raises(InputError, match=r"^here: distortion: .*expected the 4 of a fisheye lens"):
        camera_of("here", [1.0, 2.0, 3.0, 4.0], "fisheye", [0.0] * 3, None)


def test_a_rig_is_posed_where_all_its_cameras_are() -> None:
    rig = true_rig(device().truth)
    assert rig.posed
    assert not changed(rig, 0, camera_from_rig=None).posed
