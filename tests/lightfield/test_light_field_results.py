"""Depth, features and epipolar-plane images of light fields: files and summaries agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.lightfield.light_field_results import (
    FeatureSearch,
    write_depths,
    write_epipolar_images,
    write_features,
)
from mirrorcam.optics.light_field.depth import DepthEstimator, VideoDepth
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from tests.command_line import results
from tests.lightfield.recordings import noisy_walls, write_recording
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


def depths_mm(folder: Path) -> list[NDArray[np.float32]]:
    return [np.load(path)["depth_mm"] for path in sorted(folder.glob("*_depth.npz"))]


def test_frames_of_a_recording_are_filtered_in_time_unless_kept_apart(tmp_path: Path) -> None:
    frames = noisy_walls(4)
    for name in ("first", "second"):
        write_recording(tmp_path / f"{name}.zarr", frames)
    recordings = LightFieldInputs((tmp_path / "first.zarr", tmp_path / "second.zarr"))
    estimator = DepthEstimator(frames[0], quality="fast")
    alone = [estimator.estimate(each).depth_mm for each in frames]
    video = VideoDepth(estimator)
    filtered = [video.estimate(each).depth_mm for each in frames]
    assert not np.array_equal(filtered[1], alone[1], equal_nan=True)
    write_depths(recordings, tmp_path / "filtered", quality="fast")
    for found, expected in zip(depths_mm(tmp_path / "filtered"), 2 * filtered, strict=True):
        assert np.array_equal(found, expected, equal_nan=True)
    write_depths(recordings, tmp_path / "apart", quality="fast", frames_apart=True)
    for found, expected in zip(depths_mm(tmp_path / "apart"), 2 * alone, strict=True):
        assert np.array_equal(found, expected, equal_nan=True)


def test_depth_of_a_file_does_not_depend_on_the_files_before_it(tmp_path: Path) -> None:
    frames = noisy_walls(3)
    paths = tuple(tmp_path / f"{number}.npz" for number in range(3))
    for path, each in zip(paths, frames, strict=True):
        save_npz(path, each)
    write_depths(LightFieldInputs(paths), tmp_path / "all", quality="fast")
    write_depths(LightFieldInputs(paths[2:]), tmp_path / "last", quality="fast")
    assert (tmp_path / "all/2_depth.npz").read_bytes() == (tmp_path / "last/2_depth.npz").read_bytes()
