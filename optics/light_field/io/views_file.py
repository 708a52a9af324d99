"""The geometry of a light field as `views.json`: other tools pass over it, our importers read it.

Most formats know a grid with even steps, or none. With this file beside them they lose nothing; without it their
importers take what the format itself says, and what is `Assumed` for what it does not.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.base.files import read_bytes, write_json
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.light_field import LightField, Views

SCHEMA = "mirrorcam.views/1"
VIEWS = "views.json"


def fields_of_views(views: Views) -> dict[str, Any]:
    """The geometry of views, as lists and numbers by the names of `Views`; JSON has no infinity, which is "inf"."""
    geometry = {field.name: getattr(views, field.name) for field in fields(Views)}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in geometry.items()}
    return plain | ({"reference_depth_mm": "inf"} if np.isinf(views.reference_depth_mm) else {})


def views_of_fields(given: Mapping[str, Any], where: str) -> Views:
    """The views of their fields, as lists, numbers or arrays; InputError in one line that begins with `where`."""

    def vector(name: str) -> FloatArray:
        # MATLAB's vectors have two dimensions.
        return np.asarray(given[name], np.float64).ravel()

    try:
        return Views(
            positions_mm=given["positions_mm"],
            focal_px=float(np.asarray(given["focal_px"]).item()),
            centre_px=vector("centre_px"),
            width_px=int(np.asarray(given["width_px"]).item()),
            height_px=int(np.asarray(given["height_px"]).item()),
            reference_depth_mm=float(np.asarray(given["reference_depth_mm"]).item()),
            reference_view_in_rig_mm=vector("reference_view_in_rig_mm"),
            view_from_rig=given["view_from_rig"],
            # Of an empty text MATLAB keeps an array without letters.
            layout_identity="".join(np.asarray(given["layout_identity"]).ravel().tolist()),
        )
    except KeyError as error:
        raise InputError(f"{where}: does not describe views: has no {error}") from None
    except (ValueError, TypeError) as error:
        raise InputError(f"{where}: does not describe views: {' '.join(str(error).split())}") from None


def light_field_of_fields(given: Mapping[str, Any], where: str) -> LightField:
    """The light field of its fields by name; InputError in one line that begins with `where`."""
    try:
        return LightField.of(views_of_fields(given, where), given["samples"], given["weights"])
    except (ValueError, TypeError) as error:
        reason = str(error).removeprefix(f"{where}: ")
        raise InputError(f"{where}: not a light field: {reason}") from None


def write_views(path: Path, views: Views, **more: Any) -> None:
    """Write the geometry of views, and what else a format wants to find again, as JSON."""
    write_json(path, {"schema": SCHEMA, **more, "views": fields_of_views(views)})


def read_views(path: Path) -> tuple[Views, dict[str, Any]] | None:
    """Read what `write_views` wrote: the views, and the rest by name; None without such a file."""
    if not path.exists():
        return None
    try:
        stated = json.loads(read_bytes(path))
    except ValueError as error:
        raise InputError(f"{path}: does not describe views: {' '.join(str(error).split())}") from None
    if not isinstance(stated, dict) or stated.get("schema") != SCHEMA:
        raise InputError(f"{path}: expected the schema {SCHEMA!r}")
    given = stated.pop("views", None)
    if not isinstance(given, dict):
        raise InputError(f"{path}: does not describe views: has no 'views'")
    return views_of_fields(given, str(path)), stated


def parallel_views(
    places_mm: FloatArray,
    size: tuple[int, int],
    focal_px: float,
    distance_mm: float,
    centre_px: FloatArray | None = None,
) -> Views:
    """Views (t, s) at places (t, s, 2) of x and y in a plane, that see the same of the plane at a distance.

    The reference view is the middle one, the pupil lies in it; `size` is width and height in px. Without a principal
    point it is in the middle of the reference view.
    """
    rows, cols = places_mm.shape[:2]
    positions = np.zeros((rows, cols, 3))
    positions[..., :2] = places_mm - places_mm[rows // 2, cols // 2]
    middle = np.array([(size[0] - 1) / 2.0, (size[1] - 1) / 2.0])
    return Views(
        positions_mm=positions,
        focal_px=focal_px,
        centre_px=middle if centre_px is None else centre_px,
        width_px=size[0],
        height_px=size[1],
        reference_depth_mm=distance_mm,
        reference_view_in_rig_mm=np.zeros(3),
        view_from_rig=np.eye(3),
        layout_identity="",
    )


def even_views(path: Path, assumed: Assumed, grid: tuple[int, int], size: tuple[int, int]) -> Views:
    """Views (rows, cols) with even steps, as assumed for a file."""
    down, across = np.meshgrid(np.arange(grid[0]), np.arange(grid[1]), indexing="ij")
    places = np.stack([across, down], axis=-1).astype(np.float64) * float(assumed.need("step_mm", path))
    focal_px, distance_mm = assumed.need("focal_px", path), assumed.need("reference_depth_mm", path)
    return parallel_views(places, size, focal_px, distance_mm)
