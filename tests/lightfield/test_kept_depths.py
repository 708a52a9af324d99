"""Depth that is used again: only that of the same light field."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.lightfield import kept_depths
from mirrorcam.lightfield.kept_depths import keep_depth, kept_depth, write_depth
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.fixture(scope="module")
def wall() -> LightField:
    return photograph(grid_views(), [Surface(500.0)])[0]


def keep(folder: Path, wall: LightField) -> None:
    estimator = DepthEstimator(wall, near_mm=300.0, far_mm=800.0)
    with output_folder(folder, "depth") as output:
        with output.staged(complete=False) as staged:
            write_depth(staged, "wall", estimator.estimate(wall), wall, (300.0, 800.0))
        keep_depth(output, "wall", wall, (300.0, 800.0))


@pytest.fixture(scope="module")
def kept(wall: LightField, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    keep(folder, wall)
    return folder


def test_what_was_kept_comes_back(wall: LightField, kept: Path) -> None:
    expected = DepthEstimator(wall, near_mm=300.0, far_mm=800.0).estimate(wall).depth_mm
    for near, far in ((None, None), (300.0, None), (300.0, 800.0)):
        found = kept_depth([kept / "none", kept], "wall", wall, near, far)
        assert found is not None
        assert found.path == kept / "wall_depth.npz"
        assert found.searched_mm == (300.0, 800.0)
        np.testing.assert_array_equal(found.depth_mm, expected)


def test_depth_of_another_light_field_or_range_is_not_used(wall: LightField, kept: Path) -> None:
    assert kept_depth([kept], "other", wall, None, None) is None
    assert kept_depth([kept], "wall", wall, 310.0, None) is None
    assert kept_depth([kept], "wall", wall, None, np.inf) is None
    samples = wall.samples.copy()
    samples[2, 0, 5, 7, 1] ^= 1
    for changed in (LightField.of(wall, samples, wall.weights), replace(wall, layout_identity="another")):
        assert kept_depth([kept], "wall", changed, None, None) is None


def test_a_changed_file_and_depth_of_another_program_are_not_used(
    wall: LightField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(tmp_path, wall)
    with monkeypatch.context() as patch:
        patch.setattr(kept_depths, "program_of", lambda module: {"code": "0" * 64})
        assert kept_depth([tmp_path], "wall", wall, None, None) is None
    assert kept_depth([tmp_path], "wall", wall, None, None) is not None
    (tmp_path / "wall_depth.npz").write_text("mine", encoding="utf-8")
    assert kept_depth([tmp_path], "wall", wall, None, None) is None
