"""Depth maps of light fields: files, summaries and figures agree, and a kept one is used for its light field alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.lightfield import depth_maps
from mirrorcam.lightfield.depth_maps import draw_depth, record_depth, stored_depth, write_depth, write_depths
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.lightfield.requests import DepthRequest
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal import TemporalFilter
from tests.command_line import results
from tests.drawn import drawn, values_of
from tests.lightfield.recordings import noisy_walls, write_recording
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


def test_depth_is_that_of_the_wall_and_summed_up(tmp_path: Path) -> None:
    save_npz(tmp_path / "wall.npz", photograph(grid_views(), [Surface(520.0)])[0])
    (found,) = write_depths(LightFieldInputs((tmp_path / "wall.npz",)), tmp_path / "out")
    assert results(tmp_path / "out") == ["wall_depth.npz", "wall_depth.pfm", "wall_depth.png"]
    with np.load(tmp_path / "out" / "wall_depth.npz") as arrays:
        sure = arrays["confidence"] > 0.5
        assert found.confident_fraction == pytest.approx(sure.mean(), abs=0.01)
        assert found.median_mm == pytest.approx(np.nanmedian(arrays["depth_mm"][sure]), rel=1e-3)
    assert found.name == "wall"
    assert found.confident_fraction > 0.8


def depths_mm(folder: Path) -> list[NDArray[np.float32]]:
    return [np.load(path)["depth_mm"] for path in sorted(folder.glob("*_depth.npz"))]


@pytest.mark.slow
def test_frames_of_a_recording_are_filtered_in_time_unless_kept_apart(tmp_path: Path) -> None:
    frames = noisy_walls(4)
    for name in ("first", "second"):
        write_recording(tmp_path / f"{name}.zarr", frames)
    recordings = LightFieldInputs((tmp_path / "first.zarr", tmp_path / "second.zarr"))
    estimator = DepthEstimator(frames[0], quality="fast")
    alone = [estimator.estimate(each).depth_mm for each in frames]
    video = TemporalFilter()
    filtered = [estimator.estimate(video.filtered(each)).depth_mm for each in frames]
    assert not np.array_equal(filtered[1], alone[1], equal_nan=True)
    write_depths(recordings, tmp_path / "filtered", DepthRequest(fast=True))
    for found, expected in zip(depths_mm(tmp_path / "filtered"), 2 * filtered, strict=True):
        assert np.array_equal(found, expected, equal_nan=True)
    write_depths(recordings, tmp_path / "apart", DepthRequest(fast=True, frames_apart=True))
    for found, expected in zip(depths_mm(tmp_path / "apart"), 2 * alone, strict=True):
        assert np.array_equal(found, expected, equal_nan=True)


@pytest.mark.slow
def test_depth_of_a_file_does_not_depend_on_the_files_before_it(tmp_path: Path) -> None:
    frames = noisy_walls(3)
    paths = tuple(tmp_path / f"{number}.npz" for number in range(3))
    for path, each in zip(paths, frames, strict=True):
        save_npz(path, each)
    write_depths(LightFieldInputs(paths), tmp_path / "all", DepthRequest(fast=True))
    write_depths(LightFieldInputs(paths[2:]), tmp_path / "last", DepthRequest(fast=True))
    assert (tmp_path / "all/2_depth.npz").read_bytes() == (tmp_path / "last/2_depth.npz").read_bytes()


@pytest.fixture(scope="module")
def wall() -> LightField:
    return photograph(grid_views(), [Surface(500.0)])[0]


def keep(folder: Path, wall: LightField) -> None:
    estimator = DepthEstimator(wall, near_mm=300.0, far_mm=800.0)
    with output_folder(folder, "depth") as output:
        with output.staged(complete=False) as staged:
            write_depth(staged, "wall", estimator.estimate(wall), wall, (300.0, 800.0))
        record_depth(output, "wall", wall, (300.0, 800.0))


@pytest.fixture(scope="module")
def kept(wall: LightField, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    keep(folder, wall)
    return folder


def test_what_was_kept_comes_back(wall: LightField, kept: Path) -> None:
    expected = DepthEstimator(wall, near_mm=300.0, far_mm=800.0).estimate(wall).depth_mm
    for near, far in ((None, None), (300.0, None), (300.0, 800.0)):
        found = stored_depth(kept, "wall", wall, near, far)
        assert found is not None
        assert found.path == kept / "wall_depth.npz"
        assert found.searched_mm == (300.0, 800.0)
        np.testing.assert_array_equal(found.depth_mm, expected)


def test_depth_of_another_light_field_or_range_is_not_used(wall: LightField, kept: Path) -> None:
    assert stored_depth(kept, "other", wall, None, None) is None
    assert stored_depth(kept, "wall", wall, 310.0, None) is None
    assert stored_depth(kept, "wall", wall, None, np.inf) is None
    samples = wall.samples.copy()
    samples[2, 0, 5, 7, 1] ^= 1
    for changed in (LightField.of(wall, samples, wall.weights), replace(wall, layout_identity="another")):
        assert stored_depth(kept, "wall", changed, None, None) is None


def test_a_changed_file_and_depth_of_another_program_are_not_used(
    wall: LightField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(tmp_path, wall)
    with monkeypatch.context() as patch:
        patch.setattr(depth_maps, "program_of", lambda module: {"code": "0" * 64})
        assert stored_depth(tmp_path, "wall", wall, None, None) is None
    assert stored_depth(tmp_path, "wall", wall, None, None) is not None
    (tmp_path / "wall_depth.npz").write_text("mine", encoding="utf-8")
    assert stored_depth(tmp_path, "wall", wall, None, None) is None


def test_view_depth_and_confidence_are_side_by_side(tmp_path: Path) -> None:
    light_field, true_mm, _ = photograph(grid_views(), [Surface(500.0)])
    depth_mm = true_mm.astype(np.float32)
    depth_mm[:, : depth_mm.shape[1] // 2] *= 0.8
    depth_mm[:4] = np.nan
    confidence = np.where(np.isfinite(depth_mm), np.float32(0.9), np.float32(0.0))
    depth = DepthMap(
        views=light_field, view=(1, 1), depth_mm=depth_mm, sigma_mm=np.ones_like(depth_mm), confidence=confidence
    )
    figure = drawn(lambda: draw_depth(tmp_path / "depth.png", light_field, depth), tmp_path / "depth.png")
    view, nearness, sure = (values_of(axes.images[0]) for axes in figure.axes[:3])
    assert np.array_equal(view[..., 0], light_field.samples[1, 1, ..., 0])
    known = np.isfinite(depth_mm)
    assert np.array_equal(~np.ma.getmaskarray(np.ma.masked_invalid(nearness)), known)
    assert np.allclose(np.asarray(nearness)[known], 1.0 / depth_mm[known])
    assert np.allclose(np.asarray(sure)[known], 0.9)
    labels = [label.get_text() for label in figure.axes[3].get_yticklabels()]
    assert float(labels[0]) == pytest.approx(np.nanmax(depth_mm), rel=0.02)
    assert float(labels[-1]) == pytest.approx(np.nanmin(depth_mm), rel=0.02)
