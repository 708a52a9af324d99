"""Files of filtered light fields."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.lightfield.filtering import write_filtered
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.optics.light_field.filters import Passband, filter_light_field
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from tests.command_line import results
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


def test_what_is_written_is_what_the_filter_gives(tmp_path: Path) -> None:
    light_field = photograph(grid_views(), [Surface(480.0, seed=1)])[0]
    save_npz(tmp_path / "wall.npz", light_field)
    found = write_filtered(
        LightFieldInputs((tmp_path / "wall.npz",)), tmp_path / "out", "dual-fan", near_mm=370.0, far_mm=450.0
    )
    expected = filter_light_field(light_field, Passband.of(light_field, "dual-fan", 370.0, 450.0))
    assert results(tmp_path / "out") == ["wall_filtered.npz", "wall_filtered_views.png"]
    assert [(each.name, each.outside, each.left_out) for each in found] == [("wall", expected.outside, 0.0)]
    written = load_npz(tmp_path / "out" / "wall_filtered.npz")
    np.testing.assert_array_equal(written.samples, expected.light_field.samples)
    np.testing.assert_array_equal(written.positions_mm, light_field.positions_mm)
