"""Folders with the views as one array: round trips, and scaling of foreign arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed
from mirrorcam.optics.light_field.io.view_arrays import read_arrays, write_arrays
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import grid_views
from tests.optics.light_field.io.formats.planes import plane, with_gaps

GIVEN = Assumed(step_mm=10.0, focal_px=400.0, reference_depth_mm=455.0)


@pytest.mark.parametrize("largest", [1.0, 65535.0])
def test_bytes_are_recovered_from_floats_of_any_range(tmp_path: Path, largest: float) -> None:
    light_field = with_gaps(plane(2, 2, 1.0, uneven=True))
    write_arrays(tmp_path / "a.npy", light_field, largest)
    array = np.load(tmp_path / "a.npy")
    assert array.dtype == np.float32
    np.testing.assert_allclose(array, light_field.samples * (largest / 255.0), rtol=1e-6)
    found = read_arrays(tmp_path / "a.npy", largest, NOTHING)
    assert found.samples.dtype == np.uint8
    for name in ("samples", "weights", "positions_mm", "centre_px", "view_from_rig"):
        np.testing.assert_array_equal(getattr(found, name), getattr(light_field, name), err_msg=name)


def test_every_byte_is_recovered_although_floats_are_rounded(tmp_path: Path) -> None:
    views = grid_views(1, 2, width_px=16, height_px=16)
    samples = np.broadcast_to(np.arange(256, dtype=np.uint8).reshape(16, 16, 1), (1, 2, 16, 16, 1))
    write_arrays(tmp_path / "a.npy", LightField.of(views, samples, np.ones((1, 2, 16, 16), np.float32)), 1000.0)
    np.testing.assert_array_equal(read_arrays(tmp_path / "a.npy", 1000.0, NOTHING).samples, samples)


@pytest.mark.parametrize("name", ["a.npy", "a"])
def test_floats_stay_floats(tmp_path: Path, name: str) -> None:
    views = grid_views(1, 2, width_px=5, height_px=4)
    samples = np.random.default_rng(6).random((1, 2, 4, 5, 3), dtype=np.float32)
    write_arrays(tmp_path / name, LightField.of(views, samples, np.ones((1, 2, 4, 5), np.float32)), 1.0)
    np.testing.assert_array_equal(read_arrays(tmp_path / name, 1.0, NOTHING).samples, samples)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_foreign_integers_are_scaled_to_their_largest_value(tmp_path: Path, kind: Any) -> None:
    values = np.random.default_rng(7).integers(0, np.iinfo(kind).max, (2, 3, 4, 5, 3), endpoint=True).astype(kind)
    np.save(tmp_path / "a.npy", values)
    found = read_arrays(tmp_path / "a.npy", 1.0, GIVEN)
    np.testing.assert_allclose(found.samples, values / np.iinfo(kind).max, atol=1e-6)
    assert (found.weights == 1.0).all()
    np.testing.assert_allclose(found.step_mm(), 10.0)
    with pytest.raises(InputError, match="does not state its step_mm"):
        read_arrays(tmp_path / "a.npy", 1.0, NOTHING)


def test_files_that_are_not_arrays_of_views_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for content, message in (
        (np.zeros((2, 2, 4, 5)), "expected an array of numbers with 5 dimensions"),
        (np.zeros((1, 1, 4, 5, 3), complex), "expected an array of numbers with 5 dimensions"),
        (np.full((1, 2, 4, 5, 3), np.nan), "NaN or infinite"),
    ):
        np.save(path, content)
        with pytest.raises(InputError, match=message) as refused:
            read_arrays(path, 1.0, GIVEN)
        assert "\n" not in str(refused.value)
    path.write_bytes(b"no array")
    with pytest.raises(InputError, match=r"a\.npy: not an \.npy file that can be read"):
        read_arrays(path, 1.0, GIVEN)


def test_samples_of_bytes_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    write_arrays(tmp_path / "a.npy", plane(1, 2, 0.0), 1.0)
    values = np.load(tmp_path / "a.npy")
    values[0, 0, 0, 0, 0] = np.inf
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(InputError, match=r"a\.npy: holds a value that is NaN or infinite"):
        read_arrays(tmp_path / "a.npy", 1.0, NOTHING)
