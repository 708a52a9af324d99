"""Arrays for plenpy: the disparity that it would find."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.optics.light_field.io.formats.registry import write_light_field
from tests.optics.light_field.io.formats.planes import CANDIDATES, plane, shift_that_agrees


def test_plenpys_disparity_is_that_of_its_planes(tmp_path: Path) -> None:
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
