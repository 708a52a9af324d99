"""A back of your own: the part of an `Adapter` with the holes of the foot's screws, as a `Back` like any other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from itertools import product
from pathlib import Path

import manifold3d
import numpy as np
from build123d import Compound, GeomType, Location, Part, Plane, Solid
from OCP.BRep import BRep_Builder
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepTools import BRepTools
from OCP.TopoDS import TopoDS_Shape
from OCP.TopTools import TopTools_FormatVersion
from scipy.spatial import ConvexHull

from mirrorcam.cad.backs.adapter import Fastener, MountFace
from mirrorcam.cad.backs.adapter_file import open_adapter
from mirrorcam.cad.backs.back import RGB, Back, BackPart, Load, Stand, in_sentence
from mirrorcam.cad.backs.blocks import countersunk_hole, head_cuts
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.part_solids import Cut, cut_solid
from mirrorcam.cad.parts.truss import Foot, foot_stack
from mirrorcam.cad.plan.back_table import FileBack
from mirrorcam.cad.plan.dimension import Hole, Length, holes, length
from mirrorcam.cad.plan.fasteners import head_space_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import COUNTERSUNK
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

(OWN,) = FileBack.parts
EXPLODE = np.array([0.0, 0.0, -45.0])
# Move by which nuts and inserts leave their seats, and distance of screws from their heads in an exploded view.
EXIT_MM, SCREW_EXPLODE_MM = 25.0, 30.0
# Largest angle of a hole's axis from the bed's vertical at which it needs no roof.
UPRIGHT_COSINE = 0.9
# Length of the holes for heads and screwdriver below the heads: longer than any part that fits a printer.
SINK_MM = 400.0
# Smallest angle of a round hole's wall, in rad: half a turn, rounded.
HALF_TURN = 3.14
# Tolerances of contact with the desk, and of the volume that light may share with the part, for its mesh's rounding.
ON_DESK_MM, IN_LIGHT_MM3 = 0.05, 1e-2
# Tolerance of the mesh that stands for the part in planning.
MESH_MM, MESH_RAD = 0.02, 0.2
# The material under a screw's head is tested at this many points round the screw, just below the face.
POINTS, JUST_MM = 8, 0.1


@dataclass(frozen=True)
class OwnPlan:
    """A part of your own in the stand frame, mm: its solid as BREP text, and its bounding box on the bed.

    `corners` (8, 3) are the corners of that box, and `dimensions` are for its drawing.
    """

    name: str
    brep: str
    corners: FloatArray
    dimensions: tuple[Length | Hole, ...]

    @property
    def hulls(self) -> tuple[Frustum, ...]:
        """None: `plan_own` compares the solid itself with the light."""
        return ()


def make_own(plan: OwnPlan) -> Part:
    """The solid of a plan."""
    shape = TopoDS_Shape()
    BRepTools.Read_s(shape, BytesIO(plan.brep.encode()), BRep_Builder())
    return Part(Compound.cast(shape).solids(), label=plan.name)


def file_of(table: FileBack) -> Path:
    """The file of a table; raises InputError if it has none."""
    if table.file is None:
        raise InputError("[back] is a file of your own, which only the command line may name: expected --adapter FILE")
    return table.file


def require_own(table: FileBack) -> None:
    """Raise InputError for a file that cannot be opened, before anything is planned."""
    open_adapter(file_of(table))


def face_of(
    table: FileBack, foot: Foot, load: Load, light: tuple[Frustum, ...], hardware: Hardware
) -> tuple[MountFace, FloatArray]:
    """The face of a mount's foot in its own frame, and the origin (3,) of that frame in the stand frame."""
    origin = foot.screws.mean(axis=0)
    look, centre = np.radians(table.look_deg), load.centre - origin
    return (
        MountFace(
            screws_mm=tuple((float(x), float(y)) for x, y, _ in foot.screws - origin),
            thread=hardware.screw.thread,
            grip_mm=table.grip_mm,
            head_mm=2.0 * head_space_mm(hardware),
            low_mm=(-foot.half_width_mm, foot.back_y_mm - float(origin[1])),
            high_mm=(foot.half_width_mm, foot.front_y_mm - float(origin[1])),
            look=(0.0, float(np.cos(look)), float(np.sin(look))),
            load_g=load.mass_g,
            load_mm=(float(centre[0]), float(centre[1]), float(centre[2])),
            light_volumes=tuple(
                Frustum(volume.base @ foot.rig_from_stand - origin, volume.top @ foot.rig_from_stand - origin)
                for volume in light
            ),
        ),
        origin,
    )


def plan_own(table: FileBack, foot: Foot, load: Load, light: tuple[Frustum, ...], hardware: Hardware) -> Back:
    """Lay out a back of your own, made by the table's file, for a mount's foot.

    `light` are the volumes in the rig frame that no part may enter. Raises InputError if the file gives no part that
    can carry the device.
    """
    face, origin = face_of(table, foot, load, light, hardware)
    file = file_of(table)
    adapter = open_adapter(file)(face)
    up = _unit(adapter.print_up)
    (solid,) = adapter.part.solids()
    _require_under_heads(file, solid, face, hardware)
    solid = solid.moved(Location(tuple(origin)))
    drilled = _drilled(solid)
    heads = foot.screws - table.grip_mm * ABOVE
    cuts, form = _screw_cuts(heads, table.grip_mm, up, hardware)
    cut = solid - [cut_solid(hole) for hole in cuts]
    if len(cut.solids()) != 1:
        raise InputError(f"{file}: the holes of the screws cut the part into {len(cut.solids())} pieces")
    (solid,) = cut.solids()
    bed_from_stand = _bed(up)
    points, mesh = _meshed(solid)
    _require_dark(file, mesh, face, origin)
    stand, planned_from_stand = (
        (None, np.eye(3)) if adapter.stands_on is None else _stand(table, adapter.stands_on, points - origin, origin)
    )
    lengths = (length(np.array(start) + origin, np.array(end) + origin) for start, end in adapter.lengths)
    dimensions: tuple[Length | Hole, ...] = (*lengths, *drilled, *holes(cuts))
    return Back(
        table=table,
        parts=(
            BackPart(
                OWN,
                adapter.title,
                OwnPlan(OWN, _brep(solid), _corners(solid, bed_from_stand), dimensions),
                bed_from_stand,
                EXPLODE,
                RGB,
            ),
        ),
        foot=foot_stack(hardware),
        foot_heads=heads,
        heading=f"screw on the {in_sentence(adapter.title)}",
        foot_form=form,
        items=tuple(_item(fastener, origin) for fastener in adapter.fasteners),
        stand=stand,
        planned_from_stand=planned_from_stand,
        steps=adapter.steps,
    )


def _drilled(solid: Solid) -> tuple[Hole, ...]:
    """The round holes of a solid, for its drawing; fillets, which span less than half a turn, are none."""
    found: dict[tuple[float, ...], Hole] = {}
    for face in solid.faces().filter_by(GeomType.CYLINDER):
        surface, axis, radius = BRepAdaptor_Surface(face.wrapped), face.axis_of_rotation, face.radius
        if axis is None or radius is None or not face.is_circular_concave:
            continue
        if surface.LastUParameter() - surface.FirstUParameter() < HALF_TURN:
            continue
        along = np.array(tuple(axis.direction))
        start = np.array(tuple(axis.position)) + surface.FirstVParameter() * along
        depth = surface.LastVParameter() - surface.FirstVParameter()
        # Some programs write a hole as two half cylinders.
        found.setdefault(
            tuple(np.round([*start, radius], 3)),
            Hole(start, along, round(2.0 * radius, 3), cut_mm=depth),
        )
    return tuple(found.values())


def _unit(vector: Iterable[float]) -> FloatArray:
    direction = np.array(tuple(vector), dtype=np.float64)
    return np.asarray(direction / np.linalg.norm(direction))


def _bed(up: FloatArray) -> FloatArray:
    """A rotation (3, 3) to a bed on which a direction (3,) points up."""
    hint = np.eye(3)[0] if abs(up[0]) < UPRIGHT_COSINE else np.eye(3)[1]
    x = _unit(hint - (hint @ up) * up)
    return np.array([x, np.cross(up, x), up])


def _screw_cuts(heads: FloatArray, grip_mm: float, up: FloatArray, hardware: Hardware) -> tuple[tuple[Cut, ...], str]:
    """The holes of the foot's screws for a print orientation, and the form of the screws.

    Printed upright, a counterbore would have a ceiling in the air, so that the screws are countersunk. Lying holes get
    roofs.
    """
    if up @ ABOVE > UPRIGHT_COSINE:
        thread = hardware.screw.thread
        return tuple(cut for head in heads for cut in countersunk_hole(head, grip_mm, SINK_MM, thread)), COUNTERSUNK
    roof = None if up @ ABOVE < -UPRIGHT_COSINE else _unit(up - (up @ ABOVE) * ABOVE)
    return tuple(head_cuts(heads, grip_mm, roof, hardware)), ""


def _require_under_heads(file: Path, solid: Solid, face: MountFace, hardware: Hardware) -> None:
    """Raise InputError if there is no material between the mount and a screw's head."""
    radius = hardware.screw.head_mm / 2.0
    turns = 2.0 * np.pi / POINTS * np.arange(POINTS)
    circle = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    for x, y in face.screws_mm:
        for z in (-JUST_MM, JUST_MM - face.grip_mm):
            if not all(solid.is_inside((x + dx, y + dy, z)) for dx, dy in circle):
                raise InputError(
                    f"{file}: no material under the head of the screw at x = {x:g}, y = {y:g} mm, expected it within "
                    f"{radius:g} mm of the screw from z = 0 (the mount) to -{face.grip_mm:g} mm"
                )


def _meshed(solid: Solid) -> tuple[FloatArray, manifold3d.Manifold]:
    """The corners (n, 3) of a solid's mesh, and the mesh as a solid."""
    points, triangles = Part([solid]).tessellate(MESH_MM, MESH_RAD)
    corners = np.array([tuple(point) for point in points])
    mesh = manifold3d.Mesh64(corners, np.array(triangles, dtype=np.uint64))
    mesh.merge()
    return corners, manifold3d.Manifold(mesh)


def _require_dark(file: Path, mesh: manifold3d.Manifold, face: MountFace, origin: FloatArray) -> None:
    """Raise InputError if light enters the part."""
    for volume in face.light_volumes:
        hull = manifold3d.Manifold.hull_points(np.vstack([volume.base, volume.top]) + origin)
        shared = (mesh ^ hull).volume()
        if shared > IN_LIGHT_MM3:
            raise InputError(f"{file}: light enters the part ({shared:.1f} mm3), expected none: see face.light")


def _stand(table: FileBack, desk: Plane, points: FloatArray, face_origin: FloatArray) -> tuple[Stand, FloatArray]:
    """The base of a part on a desk, and the rotation (3, 3) from the frame in which it stands to its own.

    Desk and corners (n, 3) are in the frame of the mount's face, whose origin (3,) is in the stand frame.
    """
    up = np.array(tuple(desk.z_dir))
    forward = _unit(np.eye(3)[1] - up[1] * up)
    planned_from_stand = np.column_stack([np.cross(forward, up), forward, up])
    heights = (points - np.array(tuple(desk.origin))) @ up
    if heights.min() < -ON_DESK_MM:
        raise InputError(f"{table.file}: the part reaches {-heights.min():.2f} mm below stands_on, expected 0 mm")
    base = ((points[heights < ON_DESK_MM] + face_origin) @ planned_from_stand)[:, :2]
    if len(base) < 3 or np.linalg.matrix_rank(base - base[0], tol=1.0) < 2:
        raise InputError(
            f"{table.file}: the part has no face on stands_on, expected one (nearest: {heights.min():.2f} mm)"
        )
    hull = base[ConvexHull(base).vertices]
    z_mm = float((np.array(tuple(desk.origin)) + face_origin) @ up)
    return Stand(hull, z_mm, table.tip_deg), planned_from_stand


def _brep(solid: Solid) -> str:
    """A solid as text, without its mesh."""
    stream = BytesIO()
    version = TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1
    BRepTools.Write_s(solid.wrapped, stream, False, False, version)
    return stream.getvalue().decode()


def _corners(solid: Solid, bed_from_stand: FloatArray) -> FloatArray:
    """The corners (8, 3) of a solid's bounding box along the bed's axes, in the stand frame."""
    plane = Plane((0.0, 0.0, 0.0), x_dir=tuple(bed_from_stand[0]), z_dir=tuple(bed_from_stand[2]))
    bounds = plane.to_local_coords(solid).bounding_box()
    ends = ((bounds.min.X, bounds.max.X), (bounds.min.Y, bounds.max.Y), (bounds.min.Z, bounds.max.Z))
    return np.array(list(product(*ends))) @ bed_from_stand


def _item(fastener: Fastener, origin: FloatArray) -> PurchasedItem:
    """A fastener in the stand frame; nuts and inserts leave along its axis."""
    plane = fastener.plane
    axes = np.column_stack([tuple(axis) for axis in (plane.x_dir, plane.y_dir, plane.z_dir)])
    frame, out = rigid(axes, np.array(tuple(plane.origin)) + origin), axes[:, 2]
    moves = (EXIT_MM * out)[None] if fastener.kind in ("nut", "insert") else np.zeros((0, 3))
    explode = EXPLODE + (moves.sum(axis=0) if len(moves) else SCREW_EXPLODE_MM * out)
    return PurchasedItem(fastener.kind, fastener.size, fastener.length_mm, frame, explode, (OWN,), moves)
