"""Checks before frames and videos are decoded: their size, and the layout they were taken with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, read_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import check_size, is_picture, picture_size, set_common_bit_depth
from mirrorcam.core.video.video_files import open_video
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import check_belongs

# The manifests of rendered sets, and the prefixes of their schemas.
MANIFESTS = {"dataset.json": "mirrorcam.dataset/", "scene.json": "mirrorcam.scene/"}


def layout_identity_of(path: Path) -> str | None:
    """Return the layout identity in the manifest of the rendered set that contains `path`; None without a manifest."""
    for folder in path.resolve().parents[:2]:
        for name, schema in MANIFESTS.items():
            if (folder / name).is_file():
                try:
                    manifest = read_json(folder / name, LARGEST_FILE_BYTES)
                except InputError:
                    continue  # another program's file with the same name
                if isinstance(manifest, dict) and str(manifest.get("schema", "")).startswith(schema):
                    if not isinstance(identity := manifest.get("layout_identity"), str):
                        raise InputError(f"{folder / name}: layout_identity is missing, expected a layout's identity")
                    return identity
    return None


def check_frames(
    paths: Sequence[Path], layout: Layout, layout_path: Path, report: Callable[[str], None] = lambda line: None
) -> None:
    """Read the headers of pictures and videos; raise InputError if one is unreadable or does not match the layout.

    Damaged pictures are skipped: decoding reports them. Pictures of 16 bits get a common number of used bits, which is
    passed to `report` in one line.
    """
    identities: dict[Path, str | None] = {}
    for path in paths:
        try:
            size = picture_size(path) if is_picture(path) else video_size(path)
        except DamagedPicture:
            continue
        check_size(path, size, (layout.camera.width_px, layout.camera.height_px), f"{layout_path}'s camera")
        folder = path.resolve().parent
        if folder not in identities:
            identities[folder] = layout_identity_of(path)
        if (identity := identities[folder]) is not None:
            check_belongs(layout, identity, str(path))
    set_common_bit_depth(paths, report)


def video_size(path: Path) -> tuple[int, int]:
    """Return width and height of a video in px, from its header."""
    video = open_video(path)
    return video.width_px, video.height_px
