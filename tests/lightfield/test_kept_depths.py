"""Depth that is used again: only that of the same light field."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.lightfield.kept_depths import keep_depth, kept_depth
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.fixture(scope="module")
def wall() -> LightField:
    return photograph(grid_views(), [Surface(500.0)])[0]


@pytest.fixture(scope="module")
def kept(wall: LightField, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, estimator = tmp_path_factory.mktemp("kept"), DepthEstimator(wall, near_mm=300.0, far_mm=800.0)
    keep_depth(folder / "wall_depth.npz", estimator.estimate(wall), wall, estimator)
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


def test_older_files_and_others_are_not_used(wall: LightField, kept: Path, tmp_path: Path) -> None:
    with np.load(kept / "wall_depth.npz") as arrays:
        older = {name: arrays[name] for name in arrays if name != "light_field_sha256"}
        np.savez(tmp_path / "wall_depth.npz", **older)
    assert kept_depth([tmp_path], "wall", wall, None, None) is None
    (tmp_path / "wall_depth.npz").write_text("no archive", encoding="utf-8")
    assert kept_depth([tmp_path], "wall", wall, None, None) is None
