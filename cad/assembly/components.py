"""The components of an assembled device as meshes with their masses: printed parts, mirrors, camera and fasteners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
import trimesh
from build123d import (
    Align,
    Box,
    BuildPart,
    BuildSketch,
    Cone,
    Cylinder,
    Hole,
    Locations,
    Mode,
    Part,
    Plane,
    RectangleRounded,
    RegularPolygon,
    SlotOverall,
    extrude,
)

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.device_names import CAMERA, CLIP, HOLDER, UNMOUNTED, carrier_name
from mirrorcam.cad.plan.hardware import MIRROR_DENSITIES
from mirrorcam.cad.plan.part_plan import FORMING, BuiltPart, MassProperties, PurchasedItem, Rgb
from mirrorcam.cad.plan.seats import Frustum, mirror_prism
from mirrorcam.cad.plan.threads import COUNTERSUNK, SUNK_HEAD, THREADS, diameter_mm, thread_of
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody, Threads
from mirrorcam.optics.geometry.mirror import Mirror

Kind = Literal["part", "mirror", "camera", "screw", "washer", "spring", "insert", "nut", "pin"]

MIRROR_RGB: Rgb = (0.80, 0.88, 0.95)
CAMERA_RGB: Rgb = (0.13, 0.14, 0.16)
ITEM_RGB: dict[str, Rgb] = {
    "screw": (0.62, 0.64, 0.67),
    "insert": (0.80, 0.62, 0.28),
    "nut": (0.70, 0.72, 0.75),
    "washer": (0.78, 0.80, 0.82),
    "pin": (0.62, 0.64, 0.67),
    "spring": (0.66, 0.70, 0.76),
}
# Densities in g/cm3: acrylic (PMMA, 1.18 to 1.19 in data sheets), float glass (EN 572-1), brass CuZn39Pb3, steel.
BRASS_DENSITY, STEEL_DENSITY = 8.47, 7.85
MIRROR_EXPLODE_MM = 35.0
CAMERA_EXPLODE_MM = 15.0
BOARD_EXPLODE_MM = 40.0

TOLERANCE_MM = 0.05
ANGLE_RAD = 0.35


@dataclass(frozen=True)
class Component:
    """A component of the assembled device: `mesh` in the rig frame, mm.

    `name` is unique: the name of a part or fastener, or "mirror_ROW-COLUMN". `number` is a part or mirror number, ""
    for purchased items. `explode_mm` (3,) is the displacement in an exploded view; `item` is the purchased item of a
    fastener.
    """

    name: str
    kind: Kind
    number: str
    title: str
    rgb: Rgb
    explode_mm: FloatArray
    mesh: trimesh.Trimesh
    mass: MassProperties
    item: PurchasedItem | None = None


ComponentOrPart = TypeVar("ComponentOrPart", Component, BuiltPart)


def components_of(device: Device, parts: Iterable[BuiltPart]) -> tuple[Component, ...]:
    """All components of a device, with the printed parts read from their STL files."""
    printed = [_printed(part) for part in parts if part.name not in UNMOUNTED]
    return (
        *printed,
        *mirror_components(device, printed),
        camera_component(device, next(component for component in printed if component.name.startswith(CLIP))),
        *item_components(purchased_items(device)),
    )


def _printed(part: BuiltPart) -> Component:
    mesh = trimesh.load_mesh(part.stl)
    return Component(part.name, "part", part.number, part.title, part.rgb, part.explode_mm, mesh, part.mass)


def mirror_components(device: Device, printed: Sequence[Component]) -> tuple[Component, ...]:
    """The mirrors as cut; in an exploded view they move with their carriers or holder segments, and away from them."""
    components = []
    carriers = {component.name: component for component in printed}
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        mesh = mesh_of(mirror_prism(mirror))
        nearest = carriers.get(carrier_name(name)) or holder_under(mirror, printed)
        components.append(
            Component(
                name=f"mirror_{name}",
                kind="mirror",
                number=f"M{name}",
                title=f"Mirror {name}",
                rgb=MIRROR_RGB,
                explode_mm=nearest.explode_mm + MIRROR_EXPLODE_MM * mirror.normal_in_rig,
                mesh=mesh,
                mass=mass_of(mesh, MIRROR_DENSITIES[device.hardware.cutting.material]),
            )
        )
    return tuple(components)


def holder_under(mirror: Mirror, parts: Sequence[ComponentOrPart]) -> ComponentOrPart:
    """The holder or, if it is split, the segment whose centre of mass is nearest to the centre of a mirror."""
    centre = mirror.outline_in_rig_mm.mean(axis=0)
    holders = [part for part in parts if part.name.startswith(HOLDER)]
    return min(holders, key=lambda part: float(np.linalg.norm(part.mass.centre_in_rig_mm - centre)))


def camera_component(device: Device, clip: Component) -> Component:
    """The camera with its stated mass; in an exploded view it moves by its exit from the clip."""
    camera = device.hardware.camera
    mesh = tessellated(camera_solid(camera))
    mass = mass_of(mesh, camera.mass_g / (mesh.volume / 1000.0))
    return Component(
        CAMERA, "camera", "", camera.name, CAMERA_RGB, clip.explode_mm + camera_exit_mm(camera), mesh, mass
    )


def camera_exit_mm(camera: CameraBody) -> FloatArray:
    """The move (3,) by which a camera leaves its clip, in the rig frame: a body to the scene, a board forwards."""
    if camera.held_by.kind == "board":
        return np.array([0.0, 0.0, BOARD_EXPLODE_MM])
    return np.array([0.0, camera.height_mm + CAMERA_EXPLODE_MM, 0.0])


def item_components(items: Sequence[PurchasedItem]) -> tuple[Component, ...]:
    """The fasteners in their positions."""
    meshes: dict[tuple[str, str, float], trimesh.Trimesh] = {}
    components = []
    for name, item in zip(item_names(items), items, strict=True):
        key = (item.kind, item.size, item.length_mm)
        if key not in meshes:
            meshes[key] = tessellated(item_solid(item))
        mesh = meshes[key].copy()
        mesh.apply_transform(item.rig_from_item)
        components.append(
            Component(
                name=name,
                kind=item.kind,
                number="",
                title=item_title(item),
                rgb=ITEM_RGB[item.kind],
                explode_mm=item.explode_mm,
                mesh=mesh,
                mass=mass_of(mesh, BRASS_DENSITY if item.kind == "insert" else STEEL_DENSITY),
                item=item,
            )
        )
    return tuple(components)


def item_names(items: Sequence[PurchasedItem]) -> tuple[str, ...]:
    """Names of fasteners, numbered by kind: "screw_01".

    A thread-forming screw is "screw_forming_13", one in a camera's own thread "screw_camera_12".
    """
    counts: Counter[str] = Counter()
    names = []
    for item in items:
        counts[item.kind] += 1
        form = "forming_" if item.size.endswith(FORMING) else "camera_" if CAMERA in item.joins else ""
        names.append(f"{item.kind}_{form}{counts[item.kind]:02d}")
    return tuple(names)


def item_title(item: PurchasedItem) -> str:
    """The title of a purchased item: "M3 x 12 screw", "M3 nut", "M3 x 12 countersunk screw" (size "M3 countersunk").

    A nut with an inch thread has its trade name, "1/4-20 UNC hexagon nut".
    """
    if item.kind in ("nut", "washer"):
        return f"{item.size}{' hexagon' if item.size.endswith('UNC') else ''} {item.kind}"
    if item.kind == "spring":
        return f"{item.size} compression spring"
    thread = next((name for name in THREADS if f"{item.size} ".startswith(f"{name} ")), item.size)
    form = item.size.removeprefix(thread).strip()
    name = "heat-set insert" if item.kind == "insert" else f"{form} {item.kind}".strip()
    return f"{thread} x {item.length_mm:g} {name}"


def mesh_of(volume: Frustum) -> trimesh.Trimesh:
    """A convex volume as a mesh of triangle fans."""
    corners = np.concatenate(volume.faces)
    starts = np.cumsum([0, *(len(face) for face in volume.faces)])
    fans = [
        (start, start + corner, start + corner + 1)
        for start, face in zip(starts, volume.faces, strict=False)
        for corner in range(1, len(face) - 1)
    ]
    return trimesh.Trimesh(corners, np.array(fans))


def tessellated(solid: Part) -> trimesh.Trimesh:
    """A solid as a mesh."""
    points, faces = solid.tessellate(TOLERANCE_MM, ANGLE_RAD)
    return trimesh.Trimesh(np.array([tuple(point) for point in points]), np.array(faces))


def mass_of(mesh: trimesh.Trimesh, density_g_per_cm3: float) -> MassProperties:
    """Volume, mass, centre and inertia of a mesh in the rig frame, filled with one material."""
    density_g_per_mm3 = density_g_per_cm3 / 1000.0
    return MassProperties(
        volume_mm3=mesh.volume,
        mass_g=mesh.volume * density_g_per_mm3,
        centre_in_rig_mm=mesh.center_mass,
        # trimesh assumes a density of 1 unless it is set.
        inertia_g_mm2=mesh.moment_inertia / mesh.density * density_g_per_mm3,
    )


def combined(bodies: Sequence[MassProperties]) -> MassProperties:
    """The mass properties of several bodies as one, by the parallel axis theorem.

    I = sum of I_k + m_k (|d_k|^2 1 - d_k d_k^T), with d_k from the common centre of mass to that of body k.
    """
    masses = np.array([body.mass_g for body in bodies])
    centres = np.array([body.centre_in_rig_mm for body in bodies])
    centre = masses @ centres / masses.sum()
    offsets = centres - centre
    squared = (offsets**2).sum(axis=1)[:, None, None] * np.eye(3) - offsets[:, :, None] * offsets[:, None, :]
    inertia = sum(body.inertia_g_mm2 for body in bodies) + (masses[:, None, None] * squared).sum(axis=0)
    return MassProperties(
        volume_mm3=sum(body.volume_mm3 for body in bodies),
        mass_g=masses.sum(),
        centre_in_rig_mm=centre,
        inertia_g_mm2=inertia,
    )


ABOVE: Any = (Align.CENTER, Align.CENTER, Align.MIN)
BELOW: Any = (Align.CENTER, Align.CENTER, Align.MAX)
HINGE_DIAMETER_MM = 7.8
CABLE_STUB_MM = 20.0
# Coils of a spring that is drawn as a sleeve, including the inactive ones.
SLEEVE_COILS = 5.5
# ISO 7089: ratio of a washer's outer diameter, and of its hole, to the thread's diameter.
WASHER, WASHER_HOLE = 7.0 / 3.0, 3.2 / 3.0


def camera_solid(camera: CameraBody) -> Part:
    """The camera in the rig frame, its pupil at the origin: body, lens ring, folded foot, hinge, cable."""
    front = camera.pupil_behind_front_mm
    centre = (-camera.lens_x_mm, -camera.lens_y_mm)
    with BuildPart() as body:
        if camera.end_radius_mm > 0.0:
            with BuildSketch(Plane((*centre, front))):
                _rounded(camera)
            extrude(amount=-camera.depth_mm)
        else:
            with Locations((*centre, front)):
                Box(camera.width_mm, camera.height_mm, camera.depth_mm, align=BELOW)
        if camera.lens_protrusion_mm > 0.0:
            with Locations((0.0, 0.0, front)):
                Cylinder(camera.lens_ring_mm / 2.0, camera.lens_protrusion_mm, align=ABOVE)
        if camera.hinge_mm > 0.0:
            hinge_z = front - camera.depth_mm + HINGE_DIAMETER_MM / 2.0
            with Locations((centre[0], centre[1] + camera.height_mm / 2.0, hinge_z)):
                Cylinder(HINGE_DIAMETER_MM / 2.0, camera.hinge_mm, rotation=(0.0, 90.0, 0.0))
        if camera.foot_mm is not None:
            width, height, depth = camera.foot_mm
            with Locations((centre[0], centre[1] + (camera.height_mm + height) / 2.0, front - camera.depth_mm)):
                Box(width, height, min(depth, camera.depth_mm), align=ABOVE)
        if camera.has_cable:
            with Locations((camera.cable_x_mm, centre[1] + camera.cable_y_mm, front - camera.depth_mm)):
                if camera.cable_thick_mm > 0.0:
                    Box(camera.cable_mm, camera.cable_thick_mm, CABLE_STUB_MM, align=BELOW)
                else:
                    Cylinder(camera.cable_mm / 2.0, CABLE_STUB_MM, align=BELOW)
        if isinstance(camera.held_by, BoardHoles):
            with Locations(*((*hole, front) for hole in camera.held_by.holes_mm)):
                Hole(camera.held_by.hole_mm / 2.0)
        if isinstance(camera.held_by, Threads):
            radius, depth = thread_of(camera.held_by.thread).diameter_mm / 2.0, camera.held_by.thread_depth_mm
            for x, behind in camera.held_by.threads_mm:
                with Locations((x, centre[1] - camera.height_mm / 2.0, front - behind)):
                    Cylinder(radius, 2.0 * depth, rotation=(90.0, 0.0, 0.0), mode=Mode.SUBTRACT)
    return _solid(body)


def _rounded(camera: CameraBody) -> None:
    """Add the outline of a body with round ends to a sketch: a slot if its shorter sides have no flat."""
    width, height, radius = camera.width_mm, camera.height_mm, camera.end_radius_mm
    if 2.0 * radius < min(width, height):
        RectangleRounded(width, height, radius)
    else:
        SlotOverall(max(width, height), min(width, height), rotation=0.0 if width > height else 90.0)


def item_solid(item: PurchasedItem) -> Part:
    """A purchased item in its own frame: origin under a head or at the mouth of a hole, z outwards."""
    if item.kind == "spring":
        return _sleeve(item)
    diameter = diameter_mm(item.size)
    with BuildPart() as body:
        if item.kind == "screw":
            Cylinder(diameter / 2.0, item.length_mm, align=BELOW)
            if item.size.endswith(COUNTERSUNK):
                Cone(diameter / 2.0, SUNK_HEAD * diameter / 2.0, (SUNK_HEAD - 1.0) * diameter / 2.0, align=BELOW)
            else:
                thread = thread_of(item.size)
                Cylinder(thread.head_mm / 2.0, thread.head_height_mm, align=ABOVE)
        elif item.kind == "washer":
            Cylinder(WASHER * diameter / 2.0, item.length_mm, align=ABOVE)
            Hole(WASHER_HOLE * diameter / 2.0)
        elif item.kind == "nut":
            with BuildSketch(Plane.XY.offset(-item.length_mm)):
                RegularPolygon(thread_of(item.size).nut_flats_mm / 2.0, 6, major_radius=False)
            extrude(amount=item.length_mm)
            Hole(diameter / 2.0)
        elif item.kind == "insert":
            # An M3 insert has an outer diameter of 4.6; it is drawn with the 4.0 of the hole into which it is pressed.
            Cylinder(4.0 / 3.0 * diameter / 2.0, item.length_mm, align=BELOW)
            Hole(diameter / 2.0)
        else:
            Cylinder(diameter / 2.0, item.length_mm, align=BELOW)
    return _solid(body)


def _sleeve(spring: PurchasedItem) -> Part:
    """A spring as a sleeve of its mean diameter and its wire's volume, including the inactive coils."""
    wire, mean, _ = (float(number) for number in spring.size.split(" x "))
    thickness = min(np.pi * wire**2 * SLEEVE_COILS / (4.0 * spring.length_mm), wire)
    with BuildPart() as body:
        Cylinder((mean + thickness) / 2.0, spring.length_mm, align=BELOW)
        Cylinder((mean - thickness) / 2.0, spring.length_mm, align=BELOW, mode=Mode.SUBTRACT)
    return _solid(body)


def _solid(body: BuildPart) -> Part:
    part = body.part
    if part is None or len(part.solids()) != 1:
        raise ValueError("the body must be one solid")
    return part
