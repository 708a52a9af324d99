"""Depth, features and epipolar-plane images of light fields: files and summaries agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.workflow.light_field_inputs import LightFieldInputs
from mirrorcam.workflow.light_field_results import (
    FeatureSearch,
    write_depths,
    write_epipolar_images,
    write_features,
)
from tests.mirrorcam.command_line import results
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> LightFieldInputs:
    path = tmp_path_factory.mktemp("results") / "wall.npz"
    save_npz(path, photograph(grid_views(), [Surface(520.0)])[0])
    return LightFieldInputs((path,))


def test_depth_is_that_of_the_wall_and_summed_up(inputs: LightFieldInputs, tmp_path: Path) -> None:
    (found,) = write_depths(inputs, tmp_path)
    assert results(tmp_path) == ["wall_depth.npz", "wall_depth.pfm", "wall_depth.png"]
    with np.load(tmp_path / "wall_depth.npz") as arrays:
        sure = arrays["confidence"] > 0.5
        assert found.sure == pytest.approx(sure.mean(), abs=0.01)
        assert found.median_mm == pytest.approx(np.nanmedian(arrays["depth_mm"][sure]), rel=1e-3)
    assert found.name == "wall"
    assert found.sure > 0.8


def test_features_are_counted_as_they_are_written(inputs: LightFieldInputs, tmp_path: Path) -> None:
    (found,) = write_features(inputs, tmp_path, FeatureSearch(detector="ORB"))
    assert results(tmp_path) == ["wall_features.csv", "wall_features.npz", "wall_features.png"]
    with np.load(tmp_path / "wall_features.npz") as arrays:
        assert found.count == len(arrays["pixels"]) > 0
        assert found.refracted == arrays["refracted"].sum()
        assert found.median_sigma_mm == pytest.approx(np.median(arrays["depth_sigma_mm"]))


def test_an_epipolar_image_is_cut_in_the_middle_unless_a_line_is_given(
    inputs: LightFieldInputs, tmp_path: Path
) -> None:
    light_field = next(inputs.each()).light_field
    for line, expected in ((None, light_field.width_px // 2), (7, 7)):
        write_epipolar_images(inputs, tmp_path, axis="t", line=line)
        with np.load(tmp_path / "wall_epi.npz") as arrays:
            assert (str(arrays["axis"]), int(arrays["line"])) == ("t", expected)
