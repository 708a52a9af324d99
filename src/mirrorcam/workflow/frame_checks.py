"""Checks of frames and videos before they are decoded: size, and the layout that they were taken with."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from mirrorcam.optics.base.files import is_picture, read_image
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import check_belongs
from mirrorcam.optics.light_field.io.frames import Video

# The manifests of rendered sets, and how their schemas begin.
MANIFESTS = {"dataset.json": "mirrorcam.dataset/", "scene.json": "mirrorcam.scene/"}


def layout_identity_of(path: Path) -> str | None:
    """Identity of the layout that a frame or video was rendered with, by the manifest of its set; None without one."""
    for folder in path.resolve().parents[:2]:
        for name, schema in MANIFESTS.items():
            if (folder / name).is_file():
                try:
                    manifest = json.loads((folder / name).read_bytes())
                except ValueError:
                    continue  # of another program, which may call a file of its own so
                if isinstance(manifest, dict) and str(manifest.get("schema", "")).startswith(schema):
                    return str(manifest["layout_identity"])
    return None


def check_frames(paths: Sequence[Path], layout: Layout, layout_path: Path) -> None:
    """Read pictures once, open videos: raise InputError for one that cannot be read or is not of the layout."""
    expected = layout.camera.width_px, layout.camera.height_px
    for path in paths:
        if is_picture(path):
            height, width = read_image(path).shape[:2]
        else:
            video = Video(path)
            width, height = video.width_px, video.height_px
        if (width, height) != expected:
            wanted = f"expected {expected[0]}x{expected[1]} of {layout_path}'s camera"
            raise InputError(f"{path}: {width}x{height} px, {wanted}")
        identity = layout_identity_of(path)
        if identity is not None:
            check_belongs(layout, identity, str(path))
