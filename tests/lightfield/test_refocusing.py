"""Which pictures of a light field a request stands for."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.lightfield.depth_maps import write_depths
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.lightfield.refocusing import stills, write_refocused
from mirrorcam.lightfield.requests import RefocusRequest
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.temporal import TemporalFilter
from tests.command_line import results
from tests.lightfield.recordings import noisy_walls, write_recording
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.mark.parametrize(
    ("request_", "needed"),
    [
        (RefocusRequest(), False),
        (RefocusRequest(depth_mm=(400.0,), sweep="gif"), False),
        (RefocusRequest(all_in_focus=True), True),
        (RefocusRequest(from_mm=(0.0, 0.0)), True),
        (RefocusRequest(behind_mm=300.0), True),
        (RefocusRequest(between=2), True),
        (RefocusRequest(orbit="mp4"), True),
    ],
)
def test_depth_is_measured_only_where_a_picture_needs_it(request_: RefocusRequest, needed: bool) -> None:
    assert request_.needs_depth == needed


def test_without_a_wish_the_reference_plane_is_in_focus() -> None:
    light_field = photograph(grid_views(), [Surface(500.0)])[0]
    reference = f"focus_{light_field.reference_depth_mm:g}mm"
    assert [title for title, _ in stills(light_field, None, RefocusRequest())] == [reference]
    asked = RefocusRequest(depth_mm=(400.0, np.inf))
    assert [title for title, _ in stills(light_field, None, asked)] == ["focus_400mm", "focus_infmm"]
    assert list(stills(light_field, None, RefocusRequest(sweep="gif"))) == []


def test_a_picture_and_its_array_are_written_under_the_name_of_the_light_field(tmp_path: Path) -> None:
    light_field = photograph(grid_views(), [Surface(500.0)])[0]
    save_npz(tmp_path / "wall.npz", light_field)
    inputs = LightFieldInputs((tmp_path / "wall.npz",))
    made = write_refocused(inputs, tmp_path / "out", RefocusRequest(depth_mm=(500.0,)))
    names = results(tmp_path / "out")
    assert names == ["wall_focus_500mm.npz", "wall_focus_500mm.png"]
    with np.load(tmp_path / "out" / "wall_focus_500mm.npz") as arrays:
        hidden = float((arrays["weights"] == 0).mean())
    assert [each.hidden for each in made.grey] == ([pytest.approx(hidden)] if hidden > 0.01 else [])


def test_depth_is_measured_once(tmp_path: Path) -> None:
    light_field = photograph(grid_views(), [Surface(500.0)])[0]
    save_npz(tmp_path / "wall.npz", light_field)
    inputs, request = LightFieldInputs((tmp_path / "wall.npz",)), RefocusRequest(all_in_focus=True)
    first = write_refocused(inputs, tmp_path / "out", request).depths[0]
    assert (first.path, first.measured) == (tmp_path / "out/wall_depth.npz", True)
    picture = (tmp_path / "out/wall_all_in_focus.png").read_bytes()
    again = write_refocused(inputs, tmp_path / "out", request).depths[0]
    assert (again.path, again.measured) == (first.path, False)
    assert (tmp_path / "out/wall_all_in_focus.png").read_bytes() == picture
    # Another range is another depth: measured, and what is kept here already is replaced by it, as it is our own.
    narrow = request.replaced(near_mm=400.0, far_mm=700.0)
    assert write_refocused(inputs, tmp_path / "out", narrow).depths[0].measured
    # In the folder of `mirrorcam depth`, its file is used and stays.
    write_depths(inputs, tmp_path / "depths")
    beside = write_refocused(inputs, tmp_path / "depths", request).depths[0]
    assert (beside.path, beside.measured) == (tmp_path / "depths/wall_depth.npz", False)
    (tmp_path / "out/wall_depth.npz").write_bytes((tmp_path / "depths/wall_depth.npz").read_bytes())
    with pytest.raises(InputError, match=r"wall_depth\.npz: was changed since this command wrote it"):
        write_refocused(inputs, tmp_path / "out", narrow)


@pytest.mark.slow
def test_depth_of_a_recording_is_the_same_whichever_frames_have_it_already(tmp_path: Path) -> None:
    frames = noisy_walls(4)
    write_recording(tmp_path / "film.zarr", frames)
    inputs, request = LightFieldInputs((tmp_path / "film.zarr",)), RefocusRequest(all_in_focus=True)
    write_refocused(inputs, tmp_path / "whole", request)
    shutil.copytree(tmp_path / "whole", tmp_path / "resumed")
    for number in (0, 2):
        (tmp_path / f"resumed/film_{number:06d}_depth.npz").unlink()
    used = write_refocused(inputs, tmp_path / "resumed", request).depths
    assert [depth.measured for depth in used] == [True, False, True, False]
    for path in (tmp_path / "whole").glob("film_*"):
        assert path.read_bytes() == (tmp_path / "resumed" / path.name).read_bytes()
    video, estimator = TemporalFilter(), DepthEstimator(frames[0])
    expected = [estimator.estimate(video.filtered(each)).depth_mm for each in frames]
    with np.load(tmp_path / "whole/film_000003_depth.npz") as arrays:
        assert np.array_equal(arrays["depth_mm"], expected[3], equal_nan=True)
