"""The device for a robot: a URDF link with mass, shape and colours, and a frame for the camera and every view.

The adapter defines the link's frame: x level towards the scene as the device stands, y left, z up (REP 103). The frames
of camera and views are optical frames: x right, y down, z forward; the camera's is the rig frame. Units are metres and
kilograms.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import manifold3d
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.exchange.stl import export_stl

from mirrorcam.cad.assembly.components import CAMERA_RGB, ITEM_RGB, MIRROR_RGB, Component, combined
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import RobotLink
from mirrorcam.core.disk.files import atomic, write_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import inverse, rigid

XACRO = "http://www.ros.org/wiki/xacro"
USAGE = """MirrorCam on the last link of an arm: {arms}. In the arm's own xacro:
     <xacro:include filename="mirrorcam.xacro"/>
     <xacro:mirrorcam parent="{parent}" mesh_root="package://your_package/cad">{origin}</xacro:mirrorcam>
     mesh_root is the parent of this file's folder; origin is the pose of the device on that link.
     The mass assumes solid plastic; a device printed with infill is lighter."""


def write_robot(folder: Path, device: Device, components: Sequence[Component]) -> None:
    """Write `mirrorcam.xacro` (a macro), `mirrorcam.urdf` (the same on a bare link of the arm), and their meshes.

    Writes nothing if the adapter is not for an arm. Visible meshes are `../parts/NAME.stl` for printed parts, and files
    in `meshes/` for mirrors, camera and fasteners (in the rig frame, mm). Collision meshes, also in `meshes/`, are the
    convex hulls of the printed parts and of the camera.
    """
    robot = device.back.robot
    if robot is None:
        return
    groups = {
        "mirrors": ([component for component in components if component.kind == "mirror"], MIRROR_RGB),
        "camera": ([component for component in components if component.kind == "camera"], CAMERA_RGB),
        "fasteners": ([p for p in components if p.kind in ITEM_RGB], ITEM_RGB["screw"]),
    }
    visuals = {
        component.name: (f"parts/{component.name}.stl", component.rgb)
        for component in components
        if component.kind == "part"
    }
    for name, (group, rgb) in groups.items():
        if group:
            write_mesh(folder / "meshes" / f"{name}.stl", _as_one([component.mesh for component in group]))
            visuals[name] = (f"robot/meshes/{name}.stl", rgb)
    hulls = []
    for component in components:
        if component.kind in ("part", "camera"):
            write_mesh(folder / "meshes" / f"{component.name}_hull.stl", hull_of(component.mesh))
            hulls.append(f"robot/meshes/{component.name}_hull.stl")
    pose = link_from_rig(robot)
    elements = [link(pose, components, visuals, hulls), *frames(device.layout, pose)]
    write_text(folder / "mirrorcam.xacro", as_macro(elements, robot))
    write_text(folder / "mirrorcam.urdf", as_urdf(elements, robot))


def link_from_rig(robot: RobotLink) -> FloatArray:
    """The transform (4, 4), mm, from the rig frame to the link's frame."""
    return inverse(robot.rig_from_link)


def rig_from_view(layout: Layout, index: int) -> FloatArray:
    """The pose (4, 4), mm, of a virtual view in the rig frame: at its virtual centre, with the axes of all views."""
    return rigid(layout.view_from_rig.T, layout.virtual_centres_in_rig_mm[index])


def link(
    pose: FloatArray,
    components: Sequence[Component],
    visuals: dict[str, tuple[str, tuple[float, float, float]]],
    hulls: list[str],
) -> Element:
    """The link: total mass properties of the components, visible meshes (file and colour by name), collision meshes."""
    body = combined([component.mass for component in components])
    centre = (pose @ np.append(body.centre_in_rig_mm, 1.0))[:3]
    rotation = pose[:3, :3]
    inertia = rotation @ body.inertia_g_mm2 @ rotation.T * 1e-9
    element = Element("link", name="${prefix}_link")
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=_numbers(centre / 1000.0), rpy="0 0 0")
    SubElement(inertial, "mass", value=_numbers([body.mass_g / 1000.0]))
    rows = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    SubElement(inertial, "inertia", {name: _numbers([inertia[row, column]]) for name, row, column in rows})
    for name, (file, rgb) in visuals.items():
        visual = SubElement(element, "visual", name=name)
        _mesh(visual, pose, file)
        material = SubElement(visual, "material", name=f"${{prefix}}_{name}")
        SubElement(material, "color", rgba=_numbers([*rgb, 1.0]))
    for file in hulls:
        _mesh(SubElement(element, "collision"), pose, file)
    return element


def _mesh(parent: Element, pose: FloatArray, file: str) -> None:
    """Add a mesh file in the rig frame, mm, to an element of the link."""
    parent.append(_origin(pose))
    geometry = SubElement(parent, "geometry")
    SubElement(geometry, "mesh", filename=f"${{mesh_root}}/{file}", scale="0.001 0.001 0.001")


def frames(layout: Layout, pose: FloatArray) -> list[Element]:
    """Links without a body, each with its fixed joint: the camera's frame, and its children, one for each view."""
    camera = "${prefix}_camera_optical_frame"
    elements = _frame(camera, "${prefix}_link", pose)
    for index in range(len(layout.mirrors)):
        row, column = divmod(index, layout.cols)
        elements += _frame(f"${{prefix}}_view_{row}_{column}", camera, rig_from_view(layout, index))
    return elements


def _frame(name: str, parent: str, pose: FloatArray) -> list[Element]:
    joint = Element("joint", name=f"{name}_joint", type="fixed")
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=name)
    joint.append(_origin(pose))
    return [Element("link", name=name), joint]


def _origin(pose: FloatArray) -> Element:
    """A pose (4, 4) in mm as a URDF origin: metres, and rotations about the fixed x, y and z."""
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
    return Element("origin", xyz=_numbers(pose[:3, 3] / 1000.0), rpy=_numbers(angles))


def _numbers(values: Sequence[float] | FloatArray) -> str:
    """Numbers as text: ten digits, no negative zeros."""
    return " ".join(f"{round(float(value), 14) + 0.0:.10g}" for value in values)


def _parent_from_link(robot: RobotLink) -> str:
    """The pose of the device's link in its parent, as XML."""
    xyz = _numbers([length / 1000.0 for length in robot.xyz_mm])
    return f'<origin xyz="{xyz}" rpy="{_numbers(robot.rpy)}"/>'


def as_macro(elements: Sequence[Element], robot: RobotLink) -> str:
    """The elements as a xacro macro `mirrorcam`, for use on any link."""
    text = "\n".join(_text(element, 2) for element in elements)
    usage = USAGE.format(arms=robot.arms, parent=robot.parent, origin=_parent_from_link(robot))
    return (
        f'<?xml version="1.0"?>\n<!-- {usage} -->\n<robot xmlns:xacro="{XACRO}">\n'
        f'  <xacro:macro name="mirrorcam" params="parent prefix:=mirrorcam mesh_root:=.. *origin">\n'
        '    <joint name="${prefix}_joint" type="fixed">\n      <parent link="${parent}"/>\n'
        '      <child link="${prefix}_link"/>\n      <xacro:insert_block name="origin"/>\n    </joint>\n'
        f"{text}\n  </xacro:macro>\n</robot>\n"
    )


def as_urdf(elements: Sequence[Element], robot: RobotLink) -> str:
    """The elements on a bare link of the arm, with mesh paths relative to the file."""
    text = "\n".join(_text(element, 1) for element in elements)
    text = text.replace("${prefix}", "mirrorcam").replace("${mesh_root}", "..")
    return (
        f'<?xml version="1.0"?>\n<robot name="mirrorcam">\n  <link name="{robot.parent}"/>\n'
        f'  <joint name="mirrorcam_joint" type="fixed">\n    <parent link="{robot.parent}"/>\n'
        f'    <child link="mirrorcam_link"/>\n    {_parent_from_link(robot)}\n  </joint>\n{text}\n</robot>\n'
    )


def _text(element: Element, level: int) -> str:
    indent(element, "  ", level)
    return "  " * level + tostring(element, encoding="unicode").rstrip()


def _as_one(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Several meshes concatenated into one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return trimesh.Trimesh(np.vstack([mesh.vertices for mesh in meshes]), np.vstack(faces), process=False)


def hull_of(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The convex hull of a mesh by manifold3d, since trimesh's reverses faces that are flat within rounding."""
    hull = manifold3d.Manifold.hull_points(np.array(mesh.vertices)).to_mesh64()
    return trimesh.Trimesh(np.array(hull.vert_properties), np.array(hull.tri_verts, dtype=np.int64), process=False)


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> None:
    """Write a mesh as binary STL atomically."""
    with atomic(path) as temporary:
        temporary.write_bytes(export_stl(mesh))
