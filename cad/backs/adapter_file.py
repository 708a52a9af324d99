"""Read a back of your own from a file: a Python file with a function, or a STEP file with named faces."""

from __future__ import annotations

import runpy
import traceback
from pathlib import Path

import numpy as np
from build123d import Compound, Face, GeomType, Part, Plane
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader

from mirrorcam.cad.backs.adapter import Adapter, MountFace
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

FUNCTION = "adapter"
"""Name of the function in a Python file."""


def read_adapter(path: Path, face: MountFace) -> Adapter:
    """The adapter of a file for a mount's face; raises InputError, in one line, for a file that gives none."""
    return _from_python(path, face) if path.suffix.lower() == ".py" else _from_step(path, face)


def _from_python(path: Path, face: MountFace) -> Adapter:
    """Run a user's file and its function."""
    expected = f"expected a function {FUNCTION}(face) that returns a mirrorcam.Adapter"
    try:
        make = runpy.run_path(str(path), run_name=FUNCTION).get(FUNCTION)
        if not callable(make):
            raise InputError(f"{path}: has no function {FUNCTION}, {expected}")
        made = make(face)
    except (Exception, SystemExit) as error:
        if isinstance(error, InputError) and str(error).startswith(f"{path}: "):
            raise
        text = " ".join(str(error).split())
        name = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        raise InputError(f"{path}{_line_of(error, path)}: {name}{text}") from error
    if not isinstance(made, Adapter):
        raise InputError(f"{path}: {FUNCTION}(face) returned a {type(made).__name__}, {expected}")
    return made


def _line_of(error: BaseException, path: Path) -> str:
    """The line of a user's file at which an error was raised, as text; "" if it was in none."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return f", line {lines[-1]}" if lines else ""


MOUNT, FRONT, SCREW, DESK, BED = "mount", "front", "screw", "desk", "bed"
"""Names of faces in a STEP file."""
# Tolerance of the distances of the screws' holes from their pattern, which their clearance takes up.
PATTERN_MM = 0.2


def _from_step(path: Path, face: MountFace) -> Adapter:
    """Read the solid of a STEP file, and place it by its named faces.

    `mount` lies against the mount, `front` faces the scene, and four cylinders whose names begin with `screw` are the
    holes of the screws. `desk` stands on a desk, and `bed` lies on the printer's bed; both are optional.
    """
    shape, named = _read_step(path)
    mount, front = (_plane(path, named, name) for name in (MOUNT, FRONT))
    holes = [hole for name, hole in named if name.startswith(SCREW) and hole.geom_type == GeomType.CYLINDER]
    if len(holes) != len(face.screws_mm):
        raise InputError(
            f"{path}: {len(holes)} round faces have a name that begins with {SCREW!r}, expected one in each of the "
            f"{len(face.screws_mm)} holes of the screws"
        )
    up = mount.z_dir
    axes = [mount.to_local_coords(hole.axis_of_rotation.position) for hole in holes]
    centre = mount.from_local_coords((sum(axis.X for axis in axes) / len(axes), sum(a.Y for a in axes) / len(axes), 0.0))
    placed = Plane(centre, x_dir=front.z_dir.cross(up), z_dir=up)
    points = [placed.to_local_coords(hole.axis_of_rotation.position) for hole in holes]
    _require_pattern(path, np.array([(point.X, point.Y) for point in points]), face)
    found = dict(named)
    bed = -placed.to_local_coords(_plane(path, named, BED)).z_dir if BED in found else None
    return Adapter(
        part=placed.to_local_coords(shape),
        title=path.stem.replace("_", " ").capitalize(),
        print_up=(0.0, 0.0, 1.0) if bed is None else tuple(bed),
        stands_on=None if DESK not in found else _upwards(placed.to_local_coords(_plane(path, named, DESK))),
    )


def _read_step(path: Path) -> tuple[Part, list[tuple[str, Face]]]:
    """The shape of a STEP file, in mm, and its faces by their names."""
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.TransferRoots():
        raise InputError(f"{path}: is no STEP file with a solid, expected one (AP203, AP214 or AP242)")
    shape = Compound.cast(reader.OneShape())
    transferred = reader.WS().TransferReader()
    entities = [(transferred.EntityFromShapeResult(face.wrapped, 1), face) for face in shape.faces()]
    return shape, [(entity.Name().ToCString().strip(), face) for entity, face in entities if entity is not None]


def _plane(path: Path, named: list[tuple[str, Face]], name: str) -> Plane:
    """The plane of a named face, z out of the part."""
    faces = [face for other, face in named if other == name]
    if not faces or faces[0].geom_type != GeomType.PLANE:
        names = ", ".join(sorted({other for other, _ in named if other and other != "NONE"})) or "no face has a name"
        raise InputError(f"{path}: has no flat face named {name!r} ({names}), expected {MOUNT!r} and {FRONT!r}")
    return Plane(faces[0].center(), z_dir=faces[0].normal_at())


def _upwards(plane: Plane) -> Plane:
    """A plane of a part's lower face with z into the part."""
    return Plane(plane.origin, z_dir=-plane.z_dir)


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
