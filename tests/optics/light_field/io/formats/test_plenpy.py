"""Arrays for plenpy: the disparity that it finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.light_field.io.formats.registry import write_light_field
from tests.optics.light_field.io.formats.planes import CANDIDATES, plane, shift_that_agrees


def test_plenpys_disparity_matches_the_planes(tmp_path: Path) -> None:
    """Its fit of planes reads view n at + linspace(-0.5, 0.5, N) N slope, and calls -slope the disparity."""
    light_field = plane(3, 4, 1.5)
    write_light_field(tmp_path, light_field, "plenpy")
    array = np.load(tmp_path / "light_field.npy")
    assert array.shape == (3, 4, 90, 120, 3)
    assert 0.0 <= array.min() < array.max() <= 1.0
    v_steps = np.linspace(-0.5, 0.5, 4) * 4
    row = shift_that_agrees(array[1:2] * 255, lambda k, u, v: (-k * v_steps[v], 0.0), CANDIDATES)
    assert row == pytest.approx(1.5 * (4 - 1) / 4, abs=0.02)
    u_steps = np.linspace(-0.5, 0.5, 3) * 3
    column = shift_that_agrees(array[:, 1:2] * 255, lambda k, u, v: (0.0, -k * u_steps[u]), CANDIDATES)
    assert column == pytest.approx(1.5 * (3 - 1) / 3, abs=0.02)


def test_plenpy_opens_arrays_mat_files_and_pictures(tmp_path: Path) -> None:
    stored = pytest.importorskip("plenpy.lightfields", reason="plenpy is not installed").LightField
    light_field = plane(3, 3, 1.5)
    expected = light_field.samples / 255.0
    for to, name in (("plenpy", "a_plenpy"), ("lftoolbox", "a.mat"), ("tiles", "a.png"), ("eslf", "b.png")):
        write_light_field(tmp_path / name, light_field, to)
    size = light_field.samples.shape[2:4]
    opened = {
        "array": stored(np.load(tmp_path / "a_plenpy/light_field.npy")),
        "mat": stored.from_mat_file(tmp_path / "a.mat", key="LF"),
        "views side by side": stored.from_img_data(read_image(tmp_path / "a.png") / 255.0, *size, method="SAI"),
        "lenslets": stored.from_img_data(read_image(tmp_path / "b.png") / 255.0, *size, method="MLI"),
    }
    for name, found in opened.items():
        np.testing.assert_allclose(np.asarray(found)[..., :3], expected, atol=1e-6, err_msg=name)
