"""Depth that is measured once: kept beside what it was measured in, and used again for the same light field."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.disk.output_folder import OutputFolder, results_folder
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.disk.results import Results
from mirrorcam.optics.light_field.depth.depth_files import DepthRecord, content_digest, load_depth, save_depth
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.light_field import LightField

CODE = "mirrorcam.optics.light_field.depth.estimate"
_SHA256, _SEARCHED = "sha256", "searched_mm"


@dataclass(frozen=True, eq=False)
class KeptDepth:
    """A depth map that is kept: its file, the depth (v, u) in mm, and the nearest and farthest depth searched, mm."""

    path: Path
    depth_mm: NDArray[np.float32]
    searched_mm: tuple[float, float]


def write_depth(
    folder: Path, name: str, depth: DepthMap, light_field: LightField, searched_mm: tuple[float, float]
) -> None:
    """Write a depth map as NAME_depth.npz, with what it was measured in."""
    save_depth(folder / f"{name}_depth.npz", depth, DepthRecord(content_digest(light_field), searched_mm))


def keep_depth(output: OutputFolder, name: str, light_field: LightField, searched_mm: tuple[float, float]) -> None:
    """Note in the store of a folder what its NAME_depth.npz was measured in, and between which depths."""
    contents = {_SHA256: file_digest(output.path / f"{name}_depth.npz"), _SEARCHED: " ".join(map(str, searched_mm))}
    output.results.put(f"depth-{name}", _made_of(light_field), {key: text.encode() for key, text in contents.items()})


def kept_depth(
    folders: Iterable[Path], name: str, light_field: LightField, near_mm: float | None, far_mm: float | None
) -> KeptDepth | None:
    """The first NAME_depth.npz of folders that this program measured in this light field, or None.

    Where a nearest or farthest depth is given, it must have been searched between just those.
    """
    for folder in folders:
        contents = Results(results_folder(folder)).get(f"depth-{name}", _made_of(light_field))
        if contents is None:
            continue
        path, (near, far) = folder / f"{name}_depth.npz", map(float, contents[_SEARCHED].split())
        fits = near_mm in (None, near) and far_mm in (None, far)
        if fits and path.is_file() and file_digest(path) == contents[_SHA256].decode():
            return KeptDepth(path, load_depth(path, light_field), (near, far))
    return None


def _made_of(light_field: LightField) -> dict[str, str]:
    return {"light_field": content_digest(light_field)} | program_of(CODE)
