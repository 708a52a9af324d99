"""Depth that is measured once: kept beside what it was measured in, and used again for the same light field."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.depth.depth_files import (
    DepthRecord,
    content_digest,
    load_depth,
    load_record,
    save_depth,
)
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField


@dataclass(frozen=True, eq=False)
class KeptDepth:
    """A depth map that is kept: its file, the depth (v, u) in mm, and the nearest and farthest depth searched, mm."""

    path: Path
    depth_mm: NDArray[np.float32]
    searched_mm: tuple[float, float]


def keep_depth(path: Path, depth: DepthMap, light_field: LightField, estimator: DepthEstimator) -> None:
    """Write a depth map with of which light field and between which depths it was measured."""
    save_depth(path, depth, DepthRecord(content_digest(light_field), (estimator.near_mm, estimator.far_mm)))


def kept_depth(
    folders: Iterable[Path], name: str, light_field: LightField, near_mm: float | None, far_mm: float | None
) -> KeptDepth | None:
    """The first NAME_depth.npz of folders that was measured in this light field, or None.

    Where a nearest or farthest depth is given, it must have been searched between just those.
    """
    content = content_digest(light_field)
    for folder in folders:
        path = folder / f"{name}_depth.npz"
        if not path.is_file():
            continue
        try:
            record = load_record(path)
        except InputError:
            continue  # a file of the user's that is called so
        if record is None or record.light_field_sha256 != content:
            continue  # of another light field, or of a version that did not note which
        if all(asked in (None, found) for asked, found in zip((near_mm, far_mm), record.searched_mm, strict=True)):
            return KeptDepth(path, load_depth(path, light_field), record.searched_mm)
    return None
