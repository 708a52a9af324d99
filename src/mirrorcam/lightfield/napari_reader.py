"""A reader of light fields for napari, which finds it by `napari.yaml`; it needs neither napari nor npe2.

Reader contributions of napari: https://napari.org/stable/plugins/building_a_plugin/guides.html#readers
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.depth.depth_files import load_depth_map
from mirrorcam.optics.light_field.io.formats.registry import format_of, name_of, open_light_fields
from mirrorcam.optics.light_field.io.light_field_format import Contents
from mirrorcam.optics.light_field.light_field import LightField

LayerData = tuple[Any, dict[str, Any], Literal["image"]]
"""Samples of a layer, its settings and its type, as napari reads them."""

COLOURS = 3
DEPTH_QUANTILES = (0.005, 0.995)
"""Depths between which the colours of a depth layer range: a few wrong ones would take all of them."""


def napari_reader(path: str | Sequence[str]) -> Callable[[str | Sequence[str]], list[LayerData]] | None:
    """Return a function that reads the layers of a light field, or None if the path is none.

    Parameters
    ----------
    path
        File or folder in a format of `mirrorcam export`, or a list of them, of which the first decides.
    """
    try:
        form = format_of(Path(path if isinstance(path, str) else path[0]))
    except InputError:
        return None
    return None if form.read is None else read_layers


def read_layers(path: str | Sequence[str]) -> list[LayerData]:
    """Read the layers of light fields.

    The views are an image stack with the axes t, s, v, u, and with frame before them for a recording, whose frames are
    read when they are shown. Above a single light field lie its depth in mm and confidence, hidden at first, if
    `NAME_depth.npz` of `mirrorcam depth` is in the same folder, or the depth that the file itself states.

    Raises InputError, in one line, for unreadable files, and for the depth of another light field.
    """
    paths = [path] if isinstance(path, str) else path
    return [layer for each in paths for layer in _layers(Path(each))]


def _layers(path: Path) -> list[LayerData]:
    contents, name = open_light_fields(path), name_of(path)
    first = contents.frames[0]
    axes = ["t", "s", "v", "u"]
    geometry = {
        "positions_mm": first.positions_mm,
        "focal_px": first.focal_px,
        "centre_px": first.centre_px,
        "reference_depth_mm": first.reference_depth_mm,
        "notes": contents.notes,
    }
    settings = {"name": name, "rgb": first.samples.shape[-1] == COLOURS, "metadata": geometry}
    if contents.is_recording:
        return [(_Frames(contents.frames, _samples(first)), {**settings, "axis_labels": ["frame", *axes]}, "image")]
    views: LayerData = (_samples(first), {**settings, "axis_labels": axes}, "image")
    return [views, *_depth_layers(path, name, contents)]


def _samples(light_field: LightField) -> NDArray[Any]:
    """Return samples (t, s, v, u, 3), or (t, s, v, u) without colour."""
    samples = light_field.samples
    return samples if samples.shape[-1] == COLOURS else samples[..., 0]


def _depth_layers(path: Path, name: str, contents: Contents) -> list[LayerData]:
    """Return layers (v, u) of the depth and, if it was estimated, the confidence."""
    file = path.resolve().parent / f"{name}_depth.npz"
    if file.is_file():
        depth = load_depth_map(file, contents.frames[0])
        confidence = _map(depth.confidence, f"{name} confidence", "viridis", (0.0, 1.0))
        return [_depth_layer(depth.depth_mm, name), confidence]
    return [] if contents.depth_mm is None else [_depth_layer(contents.depth_mm, name)]


def _depth_layer(depth_mm: NDArray[np.float32], name: str) -> LayerData:
    known = depth_mm[np.isfinite(depth_mm)]
    near, far = (float(edge) for edge in np.quantile(known, DEPTH_QUANTILES)) if known.size else (0.0, 1.0)
    return _map(depth_mm, f"{name} depth, mm", "turbo", (near, far if far > near else math.nextafter(near, math.inf)))


def _map(values: NDArray[np.float32], name: str, colormap: str, limits: tuple[float, float]) -> LayerData:
    settings = {"name": name, "colormap": colormap, "contrast_limits": limits, "axis_labels": ["v", "u"]}
    return values, {**settings, "visible": False}, "image"


@dataclass(frozen=True, eq=False)
class _Frames:
    """Frames of a recording as an array (frame, t, s, v, u) or (frame, t, s, v, u, 3) that reads what is indexed.

    napari accepts such arrays as its `LayerDataProtocol`: shape, dtype and indices.
    """

    frames: Sequence[LightField]
    first: NDArray[Any]

    @property
    def shape(self) -> tuple[int, ...]:
        return (len(self.frames), *self.first.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.first.dtype

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, key: Any) -> NDArray[Any]:
        frame, *rest = key if isinstance(key, tuple) else (key,)
        if isinstance(frame, slice):
            indices = range(*frame.indices(len(self)))
            return np.stack([_samples(self.frames[index])[tuple(rest)] for index in indices])
        return np.asarray(_samples(self.frames[int(frame)])[tuple(rest)])
