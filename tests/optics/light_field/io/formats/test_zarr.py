"""Recordings as a format: their detection, and single light fields written as one frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.formats.zarr import FORMAT, is_recording, write_recording
from mirrorcam.optics.light_field.io.light_field_format import NOTHING
from tests.optics.light_field.io.formats.planes import plane


def test_recordings_are_folders_by_name_or_content(tmp_path: Path) -> None:
    for name in ("a.zarr", "a.zarr.partial", "other"):
        (tmp_path / name).mkdir()
    (tmp_path / "b.zarr").write_text("a file", encoding="utf-8")
    assert is_recording(tmp_path / "a.zarr")
    assert is_recording(tmp_path / "a.zarr.partial")
    for name in ("b.zarr", "other", "missing.zarr"):
        assert not is_recording(tmp_path / name)
    (tmp_path / "other" / "zarr.json").write_text("{}", encoding="utf-8")
    assert is_recording(tmp_path / "other")


def test_xarray_shows_the_positions_of_views_as_coordinates(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    light_field = plane(2, 3, 1.0)
    write_recording(tmp_path / "a.zarr", light_field)
    opened = xarray.open_zarr(tmp_path / "a.zarr", consolidated=False)
    assert set(opened.coords) == {"number", "time_s", "x_mm", "y_mm", "z_mm"}
    assert set(opened.data_vars) == {"samples", "weights"}
    assert opened.samples.dims == ("frame", "t", "s", "v", "u", "c")
    np.testing.assert_array_equal(opened.x_mm, light_field.positions_mm[..., 0])
    assert set(opened.samples.coords) == set(opened.coords)


def test_coordinates_are_arrays_of_the_store(tmp_path: Path) -> None:
    import zarr

    light_field = plane(2, 3, 1.0)
    write_recording(tmp_path / "a.zarr", light_field)
    group: Any = zarr.open_group(tmp_path / "a.zarr", mode="r")
    assert group["samples"].attrs["coordinates"] == "number time_s x_mm y_mm z_mm"
    for axis, name in enumerate(("x_mm", "y_mm", "z_mm")):
        assert group[name].metadata.dimension_names == ("t", "s")
        np.testing.assert_array_equal(group[name][:], light_field.positions_mm[..., axis])


def test_a_light_field_is_written_as_one_frame_and_never_over_another(tmp_path: Path) -> None:
    light_field = plane(2, 2, 1.0)
    write_recording(tmp_path / "a.zarr", light_field)
    assert [path.name for path in tmp_path.iterdir()] == ["a.zarr"]
    assert FORMAT.read is not None
    contents = FORMAT.read(tmp_path / "a.zarr", NOTHING)
    assert contents.is_recording
    assert contents.times_s == (0.0,)
    assert contents.depth_mm is None
    (found,) = contents.frames
    np.testing.assert_array_equal(found.samples, light_field.samples)
    np.testing.assert_array_equal(found.weights, light_field.weights)
    with pytest.raises(InputError, match=r"a\.zarr: exists, expected a new name"):
        write_recording(tmp_path / "a.zarr", light_field)
