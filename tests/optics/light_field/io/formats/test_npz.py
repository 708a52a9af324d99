"""Light fields as .npz: round trip, and refusals in one line."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from mirrorcam.optics.light_field.light_field import LightField


@pytest.fixture
def light_field() -> LightField:
    random = np.random.default_rng(4)
    positions = np.zeros((2, 3, 3))
    positions[..., :2] = np.stack(np.meshgrid([-21.0, 0.0, 19.0], [-15.0, 0.0]), axis=-1)
    return LightField(
        positions_mm=positions,
        focal_px=500.5,
        centre_px=np.array([3.5, 2.25]),
        width_px=8,
        height_px=5,
        reference_depth_mm=400.25,
        reference_view_in_rig_mm=np.array([2.0, -80.0, 90.0]),
        view_from_rig=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        layout_identity="0123456789abcdef",
        samples=random.integers(0, 255, (2, 3, 5, 8, 3), dtype=np.uint8),
        weights=random.integers(0, 2, (2, 3, 5, 8)).astype(np.float32),
    )


@pytest.mark.parametrize("name", ["a.npz", "a"])
def test_an_npz_survives_the_round_trip(tmp_path: Path, light_field: LightField, name: str) -> None:
    save_npz(tmp_path / name, light_field)
    found = load_npz(tmp_path / name)
    for field in fields(LightField):
        before, after = getattr(light_field, field.name), getattr(found, field.name)
        assert type(before) is type(after)
        assert np.array_equal(before, after), field.name
    assert found.samples.dtype == np.uint8


def test_the_same_light_field_gives_the_same_bytes(tmp_path: Path, light_field: LightField) -> None:
    save_npz(tmp_path / "a.npz", light_field)
    save_npz(tmp_path / "b.npz", light_field)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_files_that_are_not_light_fields_are_refused_in_one_line(tmp_path: Path, light_field: LightField) -> None:
    whole = tmp_path / "whole.npz"
    save_npz(whole, light_field)
    arrays = dict(np.load(whole))
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "cut.npz").write_bytes(whole.read_bytes()[:-40])
    (tmp_path / "empty.npz").write_bytes(b"")
    (tmp_path / "words.npz").write_text("no arrays", encoding="utf-8")
    np.savez(tmp_path / "other.npz", samples=arrays["samples"])
    np.save(tmp_path / "plain.npy", arrays["samples"])
    (tmp_path / "plain.npy").rename(tmp_path / "plain.npz")
    spoilt = arrays["samples"].astype(np.float32)
    spoilt[0, 0, 0, 0] = np.nan
    np.savez(tmp_path / "nan.npz", **(arrays | {"samples": spoilt}))
    np.savez(tmp_path / "flat.npz", **(arrays | {"weights": arrays["weights"][0]}))
    np.savez(tmp_path / "many.npz", **(arrays | {"focal_px": np.array([1.0, 2.0])}))
    for name, reason in {
        "nowhere": "no such file",
        "folder": "is a folder",
        "cut": "not an .npz file that can be read",
        "empty": "not an .npz file that can be read",
        "words": "not an .npz file that can be read",
        "other": "has no positions_mm, focal_px",
        "plain": "not an .npz file that can be read",
        "nan": "not a light field: samples hold a value that is NaN or infinite",
        "flat": "not a light field: weights are float32 of shape",
        "many": "not a light field: ",
    }.items():
        with pytest.raises(InputError, match=reason) as caught:
            load_npz(tmp_path / f"{name}.npz")
        assert str(caught.value).startswith(str(tmp_path / f"{name}.npz"))
        assert "\n" not in str(caught.value)
