"""Features as a value: read-only arrays of one length."""

from __future__ import annotations

import csv
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.light_field.features.feature_set import COLUMNS, Features, save_csv, save_features


def made(count: int, **changes: Any) -> Features:
    """Return features of a grid of 3 x 3 views, with zeros in all arrays."""
    shapes: dict[str, tuple[int, ...]] = {
        "pixels": (2,),
        "keypoint_px": (2,),
        "scale_px": (),
        "disparity_px": (),
        "disparity_sigma_px": (),
        "points_in_rig_mm": (3,),
        "depth_mm": (),
        "depth_sigma_mm": (),
        "residual_px": (),
        "seen_px": (3, 3, 2),
        "apart_disparity_px": (2,),
        "two_slope_sigma": (),
    }
    arrays: dict[str, Any] = {name: np.zeros((count, *shape)) for name, shape in shapes.items()}
    seen = np.ones((count, 3, 3), dtype=bool)
    arrays |= {"seen": seen, "refracted": seen[:, 0, 0], "descriptors": np.zeros((count, 4), dtype=np.uint64)}
    return Features(detector="ORB", layout_identity="0123456789abcdef", **(arrays | changes))


def test_features_are_as_many_as_their_pixels() -> None:
    assert len(made(5)) == 5
    assert len(made(0)) == 0


def test_arrays_are_read_only_and_those_given_stay_writable() -> None:
    given = np.ones(5)
    with pytest.raises(ValueError, match="read-only"):
        made(5, depth_mm=given).depth_mm[0] = 1.0
    given[0] = 2.0


@pytest.mark.parametrize("name", ["depth_mm", "seen", "descriptors"])
def test_arrays_of_another_length_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} has shape .*, expected 5 features"):
        made(5, **{name: getattr(made(4), name)})


def some_features(count: int) -> Features:
    """Return features without a scene, with distinct numbers; the last has no second slope."""
    random = np.random.default_rng(9)
    given: dict[str, Any] = {
        name: random.uniform(1.0, 900.0, shape)
        for name, shape in (
            *(
                ("pixels", (count, 2)),
                ("keypoint_px", (count, 2)),
                ("scale_px", count),
                ("disparity_px", count),
                ("disparity_sigma_px", count),
            ),
            *(("points_in_rig_mm", (count, 3)), ("depth_mm", count), ("depth_sigma_mm", count)),
            *(("residual_px", count), ("seen_px", (count, 3, 3, 2)), ("apart_disparity_px", (count, 2))),
            ("two_slope_sigma", count),
        )
    }
    given["apart_disparity_px"][-1:] = np.nan
    given["two_slope_sigma"][-1:] = np.nan
    return Features(
        detector="ORB",
        seen=random.random((count, 3, 3)) > 0.4,
        refracted=np.arange(count) % 2 == 1,
        descriptors=random.integers(0, 2**63, (count, 4), dtype=np.uint64),
        layout_identity="0123456789abcdef",
        **given,
    )


def test_arrays_are_loaded_bit_by_bit_and_the_same_features_give_the_same_bytes(tmp_path: Path) -> None:
    features = some_features(5)
    for name in ("a.npz", "b.npz"):
        save_features(tmp_path / name, features)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert set(archive.files) == {field.name for field in fields(Features)}
        for name in archive.files:
            np.testing.assert_array_equal(archive[name], getattr(features, name), err_msg=name)
        assert archive["descriptors"].dtype == np.uint64


def test_every_number_stands_in_the_column_of_its_name(tmp_path: Path) -> None:
    features = some_features(5)
    save_csv(tmp_path / "a.csv", features)
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    expected = {
        "u_px": features.pixels[:, 0],
        "v_px": features.pixels[:, 1],
        "views": features.seen.sum(axis=(1, 2)),
        "disparity_along_s_px": features.apart_disparity_px[:, 0],
        "disparity_along_t_px": features.apart_disparity_px[:, 1],
        **{f"{axis}_rig_mm": features.points_in_rig_mm[:, index] for index, axis in enumerate("xyz")},
    }
    for name in COLUMNS:
        values = expected[name] if name in expected else getattr(features, name)
        np.testing.assert_allclose([float(row[name] or "nan") for row in rows], values, rtol=1e-7, err_msg=name)
    assert [row["two_slope_sigma"] == "" for row in rows] == [False] * 4 + [True]


def test_a_file_may_have_no_features(tmp_path: Path) -> None:
    save_csv(tmp_path / "a.csv", some_features(0))
    assert (tmp_path / "a.csv").read_text(encoding="utf-8") == ",".join(COLUMNS) + "\n"
    save_features(tmp_path / "a.npz", some_features(0))
    with np.load(tmp_path / "a.npz") as archive:
        assert archive["pixels"].shape == (0, 2)
