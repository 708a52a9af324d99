"""Depth maps as files: they are loaded bit by bit, and only for their own light field."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth.depth_files import (
    DepthRecord,
    content_digest,
    load_depth,
    save_depth,
)
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField, Views
from tests.optics.light_field.depth.surfaces import grid_views

VIEWS = grid_views(width_px=12, height_px=9)


def light_field(views: Views = VIEWS) -> LightField:
    """Black views."""
    shape = (views.rows, views.cols, views.height_px, views.width_px)
    return LightField.of(views, np.zeros((*shape, 3), np.uint8), np.ones(shape, np.float32))


def random_depth(**changes: Any) -> DepthMap:
    """Any depth of the reference view, with pixels that have none."""
    random = np.random.default_rng(3)
    depth, sigma, confidence = random.uniform(300.0, 900.0, (3, 9, 12)).astype(np.float32)
    depth[random.random(depth.shape) < 0.2] = np.nan
    given: dict[str, Any] = {"depth_mm": depth, "sigma_mm": sigma, "confidence": confidence / np.float32(900.0)}
    return DepthMap(**({"views": VIEWS, "view": (1, 1), **given} | changes))


def test_a_saved_map_is_loaded_bit_by_bit(tmp_path: Path) -> None:
    depth = random_depth()
    save_depth(tmp_path / "depth.npz", depth)
    found = load_depth(tmp_path / "depth.npz", light_field())
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, depth.depth_mm)
    with np.load(tmp_path / "depth.npz") as archive:
        np.testing.assert_array_equal(archive["sigma_mm"], depth.sigma_mm)
        np.testing.assert_array_equal(archive["confidence"], depth.confidence)


@pytest.mark.parametrize(
    ("depth", "views", "message"),
    [
        (random_depth(), replace(VIEWS, layout_identity="fed"), "layout '0123456789abcdef', expected"),
        (random_depth(view=(0, 2)), VIEWS, r"depth of view \(0, 2\), expected the reference view"),
        (random_depth(view=(7, 0)), VIEWS, r"depth of view \(7, 0\), expected the reference view"),
        (random_depth(), replace(VIEWS, width_px=14), r"depth of \(9, 12\) px, expected \(9, 14\)"),
    ],
)
def test_depth_of_another_light_field_is_refused(depth: DepthMap, views: Views, message: str, tmp_path: Path) -> None:
    save_depth(tmp_path / "depth.npz", depth)
    with pytest.raises(InputError, match=message):
        load_depth(tmp_path / "depth.npz", light_field(views))


def test_other_files_are_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no archive", encoding="utf-8")
    np.savez(tmp_path / "other.npz", depth_mm=np.zeros((9, 12)))
    np.save(tmp_path / "array.npy", np.zeros((9, 12)))
    for name in ("text.npz", "other.npz", "array.npy"):
        with pytest.raises(InputError, match=f"{name}: not a depth map of mirrorcam depth") as refused:
            load_depth(tmp_path / name, light_field())
        assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match=r"missing\.npz"):
        load_depth(tmp_path / "missing.npz", light_field())


def test_numbers_of_other_types_are_refused(tmp_path: Path) -> None:
    save_depth(tmp_path / "a.npz", random_depth())
    good = dict(np.load(tmp_path / "a.npz"))
    for change, message in (
        ({"depth_mm": np.full((9, 12), "far")}, "depth is <U3, expected floating point"),
        ({"view": np.array([1])}, "not a depth map"),
        ({"view": np.array([-1, 0])}, r"depth of view \(-1, 0\)"),
        ({"view": np.array(["a", "b"])}, "not a depth map"),
        ({"depth_mm": np.array([None])}, "not a depth map"),
    ):
        np.savez(tmp_path / "b.npz", **(good | change))
        with pytest.raises(InputError, match=message):
            load_depth(tmp_path / "b.npz", light_field())


def test_depth_is_the_same_with_and_without_its_light_field(tmp_path: Path) -> None:
    record = DepthRecord(content_digest(light_field()), (300.0, np.inf))
    save_depth(tmp_path / "with.npz", random_depth(), record)
    save_depth(tmp_path / "without.npz", random_depth())
    with np.load(tmp_path / "with.npz") as arrays:
        assert arrays["light_field_sha256"] == record.light_field_sha256
        assert arrays["searched_mm"].tolist() == [300.0, np.inf]
    alone = load_depth(tmp_path / "without.npz", light_field())
    np.testing.assert_array_equal(load_depth(tmp_path / "with.npz", light_field()), alone)
    save_depth(tmp_path / "again.npz", random_depth(), record)
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "with.npz").read_bytes()


def test_the_digest_depends_on_the_content_of_a_light_field() -> None:
    black = light_field()
    samples = black.samples.copy()
    samples[2, 0, 5, 7, 1] = 1
    moved = black.positions_mm.copy()
    moved[0, 0, 0] += 1e-9
    others = (
        LightField.of(black, samples, black.weights),
        replace(black, weights=black.weights * np.float32(0.5)),
        replace(black, positions_mm=moved),
        replace(black, layout_identity="another"),
    )
    assert content_digest(black) == content_digest(light_field())
    assert len({content_digest(each) for each in (black, *others)}) == 5
