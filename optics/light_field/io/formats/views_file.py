"""What a light field is beside its samples, as `views.json`: other tools pass over it, our importers read it.

Most formats know a grid with even steps, or none. With this file beside them they lose nothing; without it their
importers take what the format itself says, and `Assumed` for what it does not.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.base.files import read_bytes, write_json
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.light_field.light_field import Views

SCHEMA = "mirrorcam.views/1"
VIEWS = "views.json"


@dataclass(frozen=True, kw_only=True)
class Assumed:
    """What a file of another tool does not say of its views; what it does say is not looked up here.

    Attributes:
        rows, cols: how many views there are down and across.
        step_mm: distance of neighbouring views.
        focal_px: focal length of the views.
        reference_depth_mm: distance of the plane of zero disparity from the views.
    """

    rows: int | None = None
    cols: int | None = None
    step_mm: float | None = None
    focal_px: float | None = None
    reference_depth_mm: float | None = None

    def need(self, name: str, path: Path) -> Any:
        """The value of a name, or InputError where it is not given."""
        value = getattr(self, name)
        if value is None:
            flag = "--" + name.replace("_", "-")
            raise InputError(f"{path}: does not say its {name}, and has no {VIEWS} beside it: expected {flag}")
        return value


NOTHING = Assumed()


def write_views(path: Path, views: Views, **more: Any) -> None:
    """Write the geometry of views, and what else a format wants to find again, as JSON."""
    geometry = {field.name: getattr(views, field.name) for field in fields(Views)}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in geometry.items()}
    write_json(path, {"schema": SCHEMA, **more, "views": plain})


def read_views(path: Path) -> tuple[Views, dict[str, Any]] | None:
    """What `write_views` wrote: the views, and the rest by name; None without such a file."""
    if not path.exists():
        return None
    try:
        said = json.loads(read_bytes(path))
        if not isinstance(said, dict) or said.get("schema") != SCHEMA:
            raise InputError(f"{path}: expected the schema {SCHEMA!r}")
        given = said.pop("views")
        numbers: dict[str, Any] = {
            name: value if isinstance(value, str) else np.array(value) for name, value in given.items()
        }
        sizes = {name: int(given[name]) for name in ("width_px", "height_px")}
        lengths = {name: float(given[name]) for name in ("focal_px", "reference_depth_mm")}
        return Views(**(numbers | sizes | lengths)), said
    except InputError:
        raise
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: does not describe views: {' '.join(str(error).split())}") from None


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
