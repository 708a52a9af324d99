"""A light field is exported under its name, with the depth that belongs to it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.lightfield.exporting import export_light_field
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.light_field_format import NOTHING
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.fixture(scope="module")
def wall() -> LightField:
    return photograph(grid_views(), [Surface(520.0)])[0]


def test_what_was_written_is_named(wall: LightField, tmp_path: Path) -> None:
    save_npz(tmp_path / "wall.npz", wall)
    found = export_light_field(tmp_path / "wall.npz", "lftoolbox", tmp_path / "out", assumed=NOTHING)
    assert found.path == tmp_path / "out" / "wall.mat"
    assert found.path.exists()
    assert found.source_format == "npz"
    assert found.measured is None


def test_depth_without_a_sure_pixel_is_no_point_cloud(wall: LightField, tmp_path: Path) -> None:
    blank = LightField.of(wall, np.full_like(wall.samples, 90), wall.weights)
    save_npz(tmp_path / "blank.npz", blank)
    with pytest.raises(InputError, match=r"no depth with confidence above 0\.5"):
        export_light_field(tmp_path / "blank.npz", "ply", tmp_path, assumed=NOTHING)
    assert not (tmp_path / "blank.ply").exists()
