"""Folders with the views as one NumPy array, for the formats `plenpy` and `plenopticam`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.core.disk.array_files import read_npy
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.io.views_file import VIEWS, check_weights, even_views, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField

WEIGHTS = "weights.npy"


def write_arrays(path: Path, light_field: LightField, full_scale: float) -> None:
    """Write the samples as float32 from 0 to `full_scale`, with the weights and the geometry next to them."""
    samples: Any = light_field.samples.astype(np.float32)
    if light_field.samples.dtype == np.uint8:
        samples /= np.float32(255.0)
    _save(path, samples * np.float32(full_scale))
    _save(path.with_name(WEIGHTS), light_field.weights)
    write_views(path.with_name(VIEWS), light_field, dtype=str(light_field.samples.dtype))


def _save(path: Path, array: np.ndarray) -> None:
    with atomic(path) as temporary, temporary.open("wb") as file:
        np.save(file, array, allow_pickle=False)


def _load(path: Path, dimensions: int) -> Any:
    array = read_npy(path)
    if array.ndim != dimensions or array.dtype.kind not in "fu":
        raise InputError(f"{path}: expected an array of numbers with {dimensions} dimensions")
    return array


def read_arrays(path: Path, full_scale: float, assumed: Assumed) -> LightField:
    """Read the light field of an array [t, s, v, u, c] of floats up to `full_scale`, or of integers up to their
    maximum.

    Without `views.json`, samples are float32 on an even grid with the assumed geometry. Raises a one-line InputError
    for arrays of other shapes, or non-finite values.
    """
    array, stated = _load(path, 5), read_views(path.with_name(VIEWS))
    full_scale = float(np.iinfo(array.dtype).max) if array.dtype.kind == "u" else full_scale
    with np.errstate(over="ignore", invalid="ignore"):  # non-finite values raise an error below
        samples = array.astype(np.float32)
        del array  # it may fill the memory
        samples /= np.float32(full_scale)
    rows, cols, height, width = samples.shape[:4]
    if path.with_name(WEIGHTS).exists():
        weights = _load(path.with_name(WEIGHTS), 4).astype(np.float32)
    else:
        weights = np.ones(samples.shape[:4], np.float32)
    if stated is not None and stated[1].dtype == "uint8":
        if not np.isfinite(samples).all():
            raise InputError(f"{path}: holds a value that is NaN or infinite, expected finite numbers")
        np.clip(samples, 0.0, 1.0, out=samples)
        samples *= np.float32(255.0)
        samples = np.rint(samples, out=samples).astype(np.uint8)
    views = even_views(path.parent, assumed, (rows, cols), (width, height)) if stated is None else stated[0]
    try:
        check_weights(weights)
        return LightField.of(views, samples, weights)
    except InputError as error:
        raise InputError(f"{path.parent}: {error}") from None
