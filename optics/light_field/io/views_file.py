"""The geometry of a light field as `views.json`, which other tools ignore and our importers read.

Most formats support only even grids, or none. This file next to them preserves the exact geometry; without it,
importers use what the format states, and `Assumed` for the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, model_from, read_bytes, tables_of, write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.light_field import LightField, Views

SCHEMA = "mirrorcam.views/1"
VIEWS = "views.json"
MAX_SIDE_PX = 100_000
ROUNDING = 1e-3
"""Tolerance for weights above 1, due to rounding in other programs."""
MAX_LENGTH = 1e9
"""Maximum length, mm or px: larger ones would overflow in products."""
_Margin = Annotated[int, Field(ge=0, le=MAX_SIDE_PX)]


def fields_of_views(views: Views) -> dict[str, Any]:
    """Convert the geometry of views to lists and numbers, keyed as in `Views`; infinity becomes "inf", for JSON."""
    geometry = {field.name: getattr(views, field.name) for field in fields(Views)}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in geometry.items()}
    return plain | ({"reference_depth_mm": "inf"} if np.isinf(views.reference_depth_mm) else {})


def views_of_fields(values: Mapping[str, Any], where: str) -> Views:
    """Build views from fields of lists, numbers or arrays; raises a one-line InputError that begins with `where`."""
    try:
        views = Views(
            positions_mm=values["positions_mm"],
            focal_px=_number(values, "focal_px"),
            centre_px=_numbers(values, "centre_px"),
            width_px=_count(values, "width_px"),
            height_px=_count(values, "height_px"),
            reference_depth_mm=np.inf if _is_infinity(values) else _number(values, "reference_depth_mm"),
            reference_view_in_rig_mm=_numbers(values, "reference_view_in_rig_mm"),
            view_from_rig=values["view_from_rig"],
            # MATLAB stores an empty text as an array without letters.
            layout_identity="".join(np.asarray(values["layout_identity"]).ravel().tolist()),
        )
        _check_plausible(views)
    except KeyError as error:
        raise InputError(f"{where}: does not describe views: has no {error}") from None
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(shortened(f"{where}: does not describe views: {' '.join(str(error).split())}")) from None
    return views


def _numbers(values: Mapping[str, Any], name: str) -> FloatArray:
    """Return a field's numbers as a vector: MATLAB's vectors have two dimensions."""
    array = np.asarray(values[name])
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} is {str(values[name])[:40]!r}, expected numbers")
    return array.astype(np.float64).ravel()


def _number(values: Mapping[str, Any], name: str) -> float:
    numbers = _numbers(values, name)
    if numbers.size != 1:
        raise ValueError(f"{name} has {numbers.size} numbers, expected one")
    return float(numbers[0])


def _count(values: Mapping[str, Any], name: str) -> int:
    number = _number(values, name)
    if not (1 <= number <= MAX_SIDE_PX and number.is_integer()):
        raise ValueError(f"{name} is {number:g}, expected a whole number from 1 to {MAX_SIDE_PX}")
    return int(number)


def _is_infinity(values: Mapping[str, Any]) -> bool:
    return isinstance(values["reference_depth_mm"], str) and values["reference_depth_mm"] == "inf"


def _check_plausible(views: Views) -> None:
    """Raise ValueError for excessive lengths, a matrix that is not a rotation, not one reference, or a bad identity."""
    lengths = (views.positions_mm, views.centre_px, views.reference_view_in_rig_mm, views.focal_px)
    if max(float(np.abs(length).max()) for length in lengths) > MAX_LENGTH:
        raise ValueError(f"a length is more than {MAX_LENGTH:g} mm or px")
    rotation = views.view_from_rig
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
        raise ValueError("view_from_rig is not a rotation matrix")
    if np.count_nonzero((views.positions_mm == 0).all(axis=2)) != 1:
        raise ValueError("positions_mm must be zero for exactly one view, the reference view")
    if not views.layout_identity.isascii() or not (views.layout_identity or "0").isalnum():
        raise ValueError(f"layout_identity is {views.layout_identity[:40]!r}, expected letters and digits")


def check_weights(weights: Any) -> None:
    """Raise InputError for weights (t, s, v, u) outside 0 to 1, or all zero."""
    min_weight, max_weight = (weights.min(), weights.max()) if weights.size else (0.0, 0.0)
    if not (min_weight >= 0 and max_weight <= 1 + ROUNDING):
        raise InputError("weights must lie within 0 to 1")
    if max_weight == 0:
        raise InputError("all weights are zero, expected some samples")


def light_field_of_fields(values: Mapping[str, Any], where: str) -> LightField:
    """Build a light field from its fields by name; raises a one-line InputError that begins with `where`."""
    try:
        light_field = LightField.of(views_of_fields(values, where), values["samples"], values["weights"])
        check_weights(light_field.weights)
    except (ValueError, TypeError) as error:
        reason = str(error).removeprefix(f"{where}: ")
        raise InputError(shortened(f"{where}: not a light field: {reason}")) from None
    return light_field


def write_views(path: Path, views: Views, **further: Any) -> None:
    """Write the geometry of views as JSON, with further values that a format needs."""
    write_json(path, {"schema": SCHEMA, **further, "views": fields_of_views(views)})


class ViewsFile(Value):
    """Content of a file written by `write_views`: the geometry, and further values that a format needs."""

    schema_id: Literal["mirrorcam.views/1"] = Field(alias="schema")
    views: dict[str, Any]
    channels: Literal[1, 3] = 3
    dtype: Literal["uint8", "float32"] | None = None
    order: Literal["eslf", "tiles"] | None = None
    margins: tuple[_Margin, _Margin, _Margin, _Margin] = (0, 0, 0, 0)


def read_views(path: Path) -> tuple[Views, ViewsFile] | None:
    """Read a file written by `write_views`: the views, and the entire file; None if it does not exist.

    Raises a one-line InputError for other files, including the `views.json` that `evaluate` gives to calibrators.
    """
    if not path.exists():
        return None
    tables = tables_of(path, read_bytes(path, LARGEST_LAYOUT_BYTES))
    if isinstance(tables, dict) and isinstance(tables.get("views"), list):
        raise InputError(
            f"{path}: describes a device's views for calibrators, expected the views of a light field ({SCHEMA})"
        )
    stated = model_from(ViewsFile, path, tables)
    return views_of_fields(stated.views, str(path)), stated


def even_views(path: Path, assumed: Assumed, grid: tuple[int, int], size: tuple[int, int]) -> Views:
    """Build views (rows, cols) with even steps, as assumed for the light field at a path."""
    t, s = np.meshgrid(np.arange(grid[0]), np.arange(grid[1]), indexing="ij")
    step_mm, focal_px, distance_mm = assumed.need(path, "step_mm", "focal_px", "reference_depth_mm")
    positions_mm = np.stack([s, t], axis=-1).astype(np.float64) * step_mm
    return Views.parallel(positions_mm, size, focal_px, distance_mm)
