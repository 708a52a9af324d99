"""Depth that is measured once: kept beside what it was measured in, and used again for the same light field."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.array_files import read_npz
from mirrorcam.optics.base.fingerprint import digest
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.depth.depth_files import WHAT, load_depth, save_depth
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField

CONTENT, SEARCHED = "light_field_sha256", "searched_mm"


def content_digest(light_field: LightField) -> str:
    """The sha256 of samples, weights and geometry: that of the same light field, whatever file it was read from."""
    parts = []
    for field in fields(LightField):
        value = getattr(light_field, field.name)
        array = np.ascontiguousarray(value) if isinstance(value, np.ndarray) else np.array(value)
        parts += [f"{field.name} {array.dtype.str} {array.shape}".encode(), array.tobytes()]
    return digest(*parts)


def keep_depth(path: Path, depth: DepthMap, light_field: LightField, estimator: DepthEstimator) -> None:
    """Write a depth map as `save_depth` does, and of which light field and between which depths it was measured."""
    save_depth(path, depth)
    found = {
        CONTENT: np.array(content_digest(light_field)),
        SEARCHED: np.array([estimator.near_mm, estimator.far_mm], dtype=np.float64),
    }
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        for name, array in found.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


def kept_depth(
    folders: Iterable[Path], name: str, light_field: LightField, near_mm: float | None, far_mm: float | None
) -> tuple[Path, NDArray[np.float32]] | None:
    """The first NAME_depth.npz of folders that was measured in this light field, and its depth (v, u) in mm, or None.

    Where a nearest or farthest depth is given, it must have been searched between just those.
    """
    content = content_digest(light_field)
    for folder in folders:
        path = folder / f"{name}_depth.npz"
        if not path.is_file():
            continue
        try:
            arrays = read_npz(path, (CONTENT, SEARCHED), WHAT)
        except InputError:
            continue  # a file of the user's that is called so
        if _belongs(arrays, content, near_mm, far_mm):
            return path, load_depth(path, light_field)
    return None


def _belongs(arrays: Any, content: str, near_mm: float | None, far_mm: float | None) -> bool:
    if CONTENT not in arrays or SEARCHED not in arrays:
        return False  # of a version that did not note them
    searched = arrays[SEARCHED]
    if searched.shape != (2,) or searched.dtype.kind != "f" or str(arrays[CONTENT])[: len(content) + 1] != content:
        return False
    return all(asked is None or asked == found for asked, found in zip((near_mm, far_mm), searched, strict=True))
