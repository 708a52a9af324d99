"""Frames are checked against their layout before they are decoded: size, and the manifest of their set."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.frame_checks import check_frames, layout_identity_of


def frame(path: Path, layout: Layout, smaller: int = 0) -> Path:
    """Return a black frame of a layout's camera, or a smaller one."""
    size = layout.camera.height_px - smaller, layout.camera.width_px, 3
    write_image(path, np.zeros(size, np.uint8))
    return path


def test_a_frame_of_another_size_is_refused(small_layout: Layout, tmp_path: Path) -> None:
    check_frames([frame(tmp_path / "a.png", small_layout)], small_layout, Path("layout.json"))
    with pytest.raises(InputError, match=r"b\.png: 1920x1072 px, expected 1920x1080 of layout\.json's camera"):
        check_frames([frame(tmp_path / "b.png", small_layout, 8)], small_layout, Path("layout.json"))


def test_the_manifest_of_a_set_names_the_layout_of_a_frame(small_layout: Layout, tmp_path: Path) -> None:
    path = frame(tmp_path / "frames" / "0000.png", small_layout)
    assert layout_identity_of(path) is None
    manifest = tmp_path / "dataset.json"
    manifest.write_text(json.dumps({"schema": "another/1", "layout_identity": "feed"}), encoding="utf-8")
    assert layout_identity_of(path) is None
    manifest.write_text("[" * 100_000, encoding="utf-8")
    assert layout_identity_of(path) is None
    manifest.write_text(json.dumps({"schema": "mirrorcam.dataset/1"}), encoding="utf-8")
    with pytest.raises(InputError, match="layout_identity is missing"):
        layout_identity_of(path)
    manifest.write_text(json.dumps({"schema": "mirrorcam.dataset/1", "layout_identity": "feed"}), encoding="utf-8")
    assert layout_identity_of(path) == "feed"
    with pytest.raises(InputError, match="was taken with layout feed"):
        check_frames([path], small_layout, Path("layout.json"))
