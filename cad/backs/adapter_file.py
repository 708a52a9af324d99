"""Read a back of your own from a file: a Python file with a function, or a STEP file with named faces."""

from __future__ import annotations

import runpy
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from build123d import Compound, Face, GeomType, Plane, Shape
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader
from OCP.TopLoc import TopLoc_Location

from mirrorcam.cad.backs.adapter import Adapter, MountFace
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

FUNCTION = "adapter"
"""Name of the function in a Python file."""


def open_adapter(path: Path) -> Callable[[MountFace], Adapter]:
    """The function of a file that makes its adapter for a mount's face; runs a Python file.

    Both raise InputError, in one line: this one for a file without a function or without the named faces.
    """
    return _from_python(path) if path.suffix.lower() == ".py" else _from_step(path)


def _from_python(path: Path) -> Callable[[MountFace], Adapter]:
    make = _call(path, lambda: runpy.run_path(str(path), run_name=FUNCTION)).get(FUNCTION)
    if not callable(make):
        raise InputError(
            f"{path}: has no function {FUNCTION}, expected {FUNCTION}(face) that returns a mirrorcam.Adapter"
        )

    def made_for(face: MountFace) -> Adapter:
        made = _call(path, lambda: make(face))
        if not isinstance(made, Adapter):
            raise InputError(f"{path}: {FUNCTION}(face) returned {made!r:.60}, expected a mirrorcam.Adapter")
        return made

    return made_for


def _call(path: Path, function: Callable[[], Any]) -> Any:
    """Call a function of a user's file; any error becomes an InputError with its line in that file."""
    try:
        return function()
    except (Exception, SystemExit) as error:
        name = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        raise InputError(f"{path}{_line_of(error, path)}: {name}{' '.join(str(error).split())}") from error


def _line_of(error: BaseException, path: Path) -> str:
    """The line of a user's file at which an error was raised, as text; "" if it was in none."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return f", line {lines[-1]}" if lines else ""


MOUNT, FRONT, SCREW, DESK, BED = "mount", "front", "screw", "desk", "bed"
"""Names of faces in a STEP file, and the first letters of the holes' names."""
SCREWS = 4
# Tolerance of the distances of the screws' holes from their pattern, which their clearance takes up.
PATTERN_MM = 0.2


def _from_step(path: Path) -> Callable[[MountFace], Adapter]:
    """Read the solid of a STEP file, and place it by its named faces.

    `mount` lies against the mount, `front` faces the scene, and the names of the walls of the four holes of the screws
    begin with `screw`. `desk` stands on a desk, and `bed` lies on the printer's bed; both are optional.
    """
    shape, named = _read_step(path)
    mount, front = (_plane(path, named, name) for name in (MOUNT, FRONT))
    centre = mount.from_local_coords((*_holes(path, named, mount).mean(axis=0), 0.0))
    placed = Plane(centre, x_dir=front.z_dir.cross(mount.z_dir), z_dir=mount.z_dir)
    local = [(name, placed.to_local_coords(face)) for name, face in named]
    desk, bed = (_plane(path, local, name) if name in dict(local) else None for name in (DESK, BED))
    adapter = _call(
        path,
        lambda: Adapter(
            part=placed.to_local_coords(shape),
            title=path.stem.replace("_", " ").capitalize(),
            print_up=tuple(-bed.z_dir) if bed else (0.0, 0.0, 1.0),
            stands_on=Plane(desk.origin, z_dir=-desk.z_dir) if desk else None,
        ),
    )
    holes = _holes(path, local, Plane.XY)

    def made_for(face: MountFace) -> Adapter:
        _require_pattern(path, holes, face)
        return adapter

    return made_for


def _read_step(path: Path) -> tuple[Shape[Any], list[tuple[str, Face]]]:
    """The shape of a STEP file, in mm, and its faces by their names."""
    reader = STEPControl_Reader()
    # The reader prints its own messages about any other file.
    is_step = path.read_bytes()[:1000].lstrip().startswith(b"ISO-10303-21")
    read = is_step and reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
    if not read or not reader.TransferRoots():
        raise InputError(f"{path}: is no STEP file with a solid, expected one (AP203, AP214 or AP242)")
    shape = Compound.cast(reader.OneShape())
    transferred = reader.WS().TransferReader()
    named = []
    for face in shape.faces():
        # Names belong to faces as they are in the file, before the placement of their solid.
        entity = transferred.EntityFromShapeResult(face.wrapped.Located(TopLoc_Location()), 1)
        if entity is not None:
            named.append((entity.Name().ToCString().strip(), face))
    return shape, named


def _plane(path: Path, named: list[tuple[str, Face]], name: str) -> Plane:
    """The plane of a named face, z out of the part."""
    faces = [face for other, face in named if other == name]
    if not faces or faces[0].geom_type != GeomType.PLANE:
        names = ", ".join(sorted({other for other, _ in named if other and other != "NONE"})) or "no face has a name"
        raise InputError(f"{path}: has no flat face named {name!r} ({names}), expected {MOUNT!r} and {FRONT!r}")
    return Plane(faces[0].center(), z_dir=faces[0].normal_at())


def _holes(path: Path, named: list[tuple[str, Face]], plane: Plane) -> FloatArray:
    """The positions (4, 2) of the screws' holes in a plane."""
    axes = [face.axis_of_rotation for name, face in named if name.startswith(SCREW)]
    found = [plane.to_local_coords(axis.position) for axis in axes if axis is not None]
    # Some programs write a hole as two half cylinders.
    points = np.array([(point.X, point.Y) for point in found]).reshape(-1, 2)
    points = points[np.unique(points.round(3), axis=0, return_index=True)[1]]
    if len(points) != SCREWS:
        raise InputError(f"{path}: {len(points)} round holes have a name that begins with {SCREW!r}, expected {SCREWS}")
    return points


def _require_pattern(path: Path, points: FloatArray, face: MountFace) -> None:
    """Raise InputError if points (4, 2) are not where the screws of a mount are."""
    screws = np.array(face.screws_mm)
    distances = np.linalg.norm(points[:, None] - screws[None], axis=-1)
    if distances.min(axis=0).max() > PATTERN_MM:
        width, depth = np.ptp(screws, axis=0)
        found = " x ".join(f"{side:.2f}" for side in np.ptp(points, axis=0))
        raise InputError(
            f"{path}: the holes {SCREW!r} are {found} mm apart (across and along the view), expected {width:g} x "
            f"{depth:g} mm"
        )
