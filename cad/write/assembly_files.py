"""The assembled device as one STEP file and as GLB.

The STEP file is a labelled, coloured tree in a fixed order, assembled by joints. Open CASCADE numbers the placed
components per process (`NEXT_ASSEMBLY_USAGE_OCCURRENCE`), and writes colours in the order of a map whose keys are
memory addresses. `ordered_step` makes the text independent of both; the geometry is already in the order of its input.

The GLB has a node for every component, with its name, number, colour and displacement in an exploded view.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh
from build123d import (
    Axis,
    Color,
    Compound,
    Face,
    LinearJoint,
    Location,
    Plane,
    RigidJoint,
    Shape,
    Solid,
    Vector,
    Wire,
    import_step,
)
from trimesh.exchange.gltf import export_glb
from trimesh.graph import smooth_shade
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import (
    CAMERA_RGB,
    ITEM_RGB,
    MIRROR_RGB,
    Component,
    Kind,
    camera_solid,
    holder_under,
    item_names,
    item_solid,
)
from mirrorcam.cad.assembly.device_plan import Device, connections
from mirrorcam.cad.plan.device_names import CLIP, UNMOUNTED
from mirrorcam.cad.plan.part_plan import LICENCE, BuiltPart, Connection, Rgb
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.cad.write.threemf import DESIGNER
from mirrorcam.core.disk.files import atomic, write_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import inverse, rigid

# An entity "#12 = NAME(...);", possibly over several lines. A TOKEN in its body is quoted text or a reference.
ENTITY = re.compile(r"^#(\d+) = (.*?);$", re.DOTALL | re.MULTILINE)
TOKEN = re.compile(r"'(?:[^']|'')*'|#(\d+)")
COLOUR_ROOTS = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"
OCCURRENCE = re.compile(r"^NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+'")


def ordered_step(text: str) -> str:
    """A STEP file's text with its components numbered from 1, and its colours in the order of their shapes."""
    start, _, rest = text.partition("DATA;\n")
    data, _, end = rest.partition("ENDSEC;")
    bodies = {int(number): re.sub(r"\n\s*", "", body) for number, body in ENTITY.findall(data)}
    references = {number: _references(body) for number, body in bodies.items()}
    referenced = {other for others in references.values() for other in others}
    roots = [number for number in bodies if number not in referenced]
    colours = [root for root in roots if bodies[root].startswith(COLOUR_ROOTS)]
    uncoloured = {number for root in roots if root not in colours for number in _reachable(root, references)}

    def coloured_entities(root: int) -> list[int]:
        return sorted(
            other for number in _reachable(root, references) for other in references[number] if other in uncoloured
        )

    # Entities shared by several colours come with the first colour.
    order = dict.fromkeys(sorted(uncoloured))
    for root in sorted(colours, key=coloured_entities):
        order |= dict.fromkeys(number for number in _reachable(root, references) if number not in order)
    new_number = {number: index for index, number in enumerate(order, start=1)}
    component_count = 0
    lines = []
    for number in order:
        body, components = OCCURRENCE.subn(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{component_count + 1}'", bodies[number])
        component_count += components
        body = TOKEN.sub(lambda token: f"#{new_number[int(token[1])]}" if token[1] else token[0], body)
        lines.append(f"#{new_number[number]} = {body};\n")
    return f"{start}DATA;\n{''.join(lines)}ENDSEC;{end}"


def _references(body: str) -> list[int]:
    return [int(token[1]) for token in TOKEN.finditer(body) if token[1]]


def _reachable(root: int, references: dict[int, list[int]]) -> list[int]:
    """An entity and all entities that it references, directly or indirectly, in depth-first order."""
    reached, pending = {root: None}, [root]
    while pending:
        new = [other for other in references[pending.pop()] if other not in reached]
        reached |= dict.fromkeys(new)
        pending += reversed(new)
    return list(reached)


ROOT = "mirrorcam"


def write_assembly(path: Path, device: Device, parts: Iterable[BuiltPart]) -> None:
    """Write the device as STEP, with its printed parts read from their STEP files.

    The root `mirrorcam` has the groups `printed`, `mirrors` and `bought`, with components named and coloured as in the
    GLB.
    """
    assembly = assemble(device, parts)
    with TemporaryDirectory() as folder:
        raw = Path(folder) / path.name
        write_step(raw, assembly)
        write_text(path, ordered_step(raw.read_text(encoding="utf-8")))


def assemble(device: Device, parts: Iterable[BuiltPart]) -> Compound:
    """The device in the rig frame: printed parts joined as planned, and every other component joined to one of them.

    Parts are modelled in their positions, so joints move them only by differences between their planned frames.
    """
    mounted = [part for part in parts if part.name not in UNMOUNTED]
    printed = {part.name: _printed(part) for part in mounted}
    for connection in connections(device):
        parent, child = _printed_part((connection.parent,), printed), _printed_part((connection.child,), printed)
        connect(connection, parent, child)
    mirrors, bought = [], []
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        solid = _coloured(_mirror_solid(mirror), f"mirror_{name}", MIRROR_RGB)
        seat = mirror.rig_from_plane.copy()
        seat[:3, 3] += mirror.back_mm * mirror.normal_in_rig
        mirrors.append(_joined(printed[holder_under(mirror, mounted).name], solid, seat))
    camera = _coloured(camera_solid(device.hardware.camera), "camera", CAMERA_RGB)
    bought.append(_joined(_printed_part((CLIP,), printed), camera, np.eye(4)))
    items = purchased_items(device)
    shapes: dict[tuple[str, str, float], Shape[Any]] = {}
    for name, item in zip(item_names(items), items, strict=True):
        key = (item.kind, item.size, item.length_mm)
        if key not in shapes:
            shapes[key] = item_solid(item)
        solid = _coloured(shapes[key], name, ITEM_RGB[item.kind])
        bought.append(_joined(_printed_part(item.joins, printed), solid, item.rig_from_item))
    groups = {"printed": list(printed.values()), "mirrors": mirrors, "bought": bought}
    return Compound(label=ROOT, children=[Compound(label=name, children=group) for name, group in groups.items()])


def connect(connection: Connection, parent: Solid, child: Solid) -> None:
    """Join two parts, given in the rig frame, by joints with the connection's name; sliding parts are at mid-travel."""
    rig_from_parent, rig_from_child = connection.rig_from_parent_joint, connection.rig_from_child_joint
    if connection.slides_mm == 0.0:
        joint = RigidJoint(connection.name, parent, location_of(rig_from_parent))
        joint.connect_to(RigidJoint(connection.name, child, location_of(rig_from_child)))
        return
    origin = rig_from_parent[:3, 3]
    axis = Axis(tuple(origin), tuple(rig_from_parent[:3, 0]))
    slide = LinearJoint(connection.name, parent, axis, (-connection.slides_mm, connection.slides_mm))
    # A linear joint passes on its position but not its orientation, which the child's joint must have.
    unrotated = rigid(np.eye(3), origin)
    child_joint = rig_from_child @ inverse(rig_from_parent) @ unrotated
    slide.connect_to(RigidJoint(connection.name, child, location_of(child_joint)), position=0.0)


def _printed(part: BuiltPart) -> Solid:
    return _coloured(import_step(part.step), part.name, part.rgb)


def _coloured(shape: Shape[Any], label: str, rgb: Rgb) -> Solid:
    """A labelled and coloured copy of a shape's one solid; solids that share geometry would share a name in STEP."""
    (solid,) = deepcopy(shape).solids()
    solid.label, solid.color = label, Color(*rgb)
    return solid


def _mirror_solid(mirror: Mirror) -> Solid:
    """A mirror as cut, in its own frame but with the back at z = 0."""
    corners = [Vector(x, y, 0.0) for x, y in mirror.outline_in_plane_mm]
    face = Face(Wire.make_polygon(corners))
    return Solid.extrude(face, Vector(0.0, 0.0, mirror.thickness_mm))


def _joined(part: Solid, solid: Solid, rig_from_solid: FloatArray) -> Solid:
    """The solid, with the origin of its own frame joined to a position on a part."""
    joint = RigidJoint(solid.label, part, location_of(rig_from_solid))
    joint.connect_to(RigidJoint("origin", solid, Location()))
    return solid


def _printed_part(names: tuple[str, ...], printed: dict[str, Solid]) -> Solid:
    """The printed part, or its first segment, of the first name that exists."""
    for name in names:
        for label, solid in printed.items():
            if label == name or label.startswith(f"{name}_"):
                return solid
    raise ValueError(f"{names=} are not printed parts, expected one of {', '.join(printed)}")


def location_of(rig_from_frame: FloatArray) -> Location:
    """A rigid transform (4, 4) as a location."""
    x_axis, _, z_axis, origin = (tuple(column) for column in rig_from_frame[:3].T)
    return Plane(origin=origin, x_dir=x_axis, z_dir=z_axis).location


GLB_ROOT = "device"
GLTF_FROM_STAND: FloatArray = 0.001 * np.array(
    [[-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1000.0]]
)
"""glTF is in metres, with +Y up and the front towards +Z: the stand's z is up, and the device looks along its y."""

# Metalness and roughness of a component's material.
FINISH: dict[Kind, tuple[float, float]] = {
    "part": (0.0, 0.75),
    "mirror": (1.0, 0.04),
    "camera": (0.0, 0.45),
    "screw": (0.9, 0.35),
    "insert": (0.9, 0.35),
    "washer": (0.9, 0.35),
    "nut": (0.9, 0.35),
    "pin": (0.9, 0.35),
    "spring": (0.9, 0.35),
}
# glTF's ELEMENT_ARRAY_BUFFER and ARRAY_BUFFER.
INDICES, VERTICES = 34963, 34962
# Sharper edges are shaded flat; the facets of a round hole are shaded smooth.
CREASE_RAD = np.radians(30.0)


def write_glb(path: Path, components: Sequence[Component], rig_from_stand: FloatArray) -> None:
    """Write the components as binary glTF 2.0, as the device stands.

    The node `device` has the matrix from the rig frame to glTF's axes; its child nodes, one for each component and with
    its name, are in the rig frame, mm. Their `extras` are `kind`, `number`, `title` and `explode_mm` [x, y, z] in the
    rig frame. To explode the device, move each node by a fraction of `explode_mm`.
    """
    scene = trimesh.Scene()
    gltf_from_rig = GLTF_FROM_STAND @ rigid(rig_from_stand.T, np.zeros(3))
    scene.graph.update(GLB_ROOT, scene.graph.base_frame, matrix=gltf_from_rig)
    for component in components:
        extras = {
            "kind": component.kind,
            "number": component.number,
            "title": component.title,
            "explode_mm": [round(float(length), 4) for length in component.explode_mm],
        }
        scene.add_geometry(
            _shaded(component),
            node_name=component.name,
            geom_name=component.name,
            parent_node_name=GLB_ROOT,
            metadata=extras,
        )
    colours = {component.name: [*linear(np.array(component.rgb)).round(6).tolist(), 1.0] for component in components}

    def finish(tree: dict[str, Any]) -> None:
        tree["asset"]["copyright"] = f"{DESIGNER}, {LICENCE}"
        # trimesh rounds colours to 1/255.
        for material in tree["materials"]:
            material["pbrMetallicRoughness"]["baseColorFactor"] = colours[material["name"]]
        for mesh in tree["meshes"]:
            for primitive in mesh["primitives"]:
                _set_target(tree, primitive["indices"], INDICES)
                for accessor in primitive["attributes"].values():
                    _set_target(tree, accessor, VERTICES)

    data = export_glb(scene, include_normals=True, tree_postprocessor=finish)
    with atomic(path) as temporary:
        temporary.write_bytes(data)


def _set_target(tree: dict[str, Any], accessor: int, target: int) -> None:
    """Set the target of an accessor's buffer view, a hint for viewers."""
    tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] = target


def _shaded(component: Component) -> trimesh.Trimesh:
    """The mesh of a component with duplicate vertices along sharp edges, and its material."""
    mesh = smooth_shade(component.mesh, angle=CREASE_RAD, facet_minarea=None)
    metallic, roughness = FINISH[component.kind]
    material = PBRMaterial(
        name=component.name, baseColorFactor=[*component.rgb, 1.0], metallicFactor=metallic, roughnessFactor=roughness
    )
    normals = np.array(mesh.vertex_normals)
    # Facets without area have no normals; they are invisible, but glTF requires unit vectors.
    normals[np.linalg.norm(normals, axis=1) < 0.5] = (0.0, 0.0, 1.0)
    return trimesh.Trimesh(
        mesh.vertices,
        mesh.faces,
        vertex_normals=normals,
        visual=TextureVisuals(material=material),
        process=False,
    )


def linear(srgb: FloatArray) -> FloatArray:
    """Linear light from sRGB values 0 to 1 (IEC 61966-2-1), since glTF's colours are linear."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
