"""The robot description, read back from its XML: masses, frames and files, in the units and axes of ROS."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from shapely import Polygon
from urdf_parser_py.urdf import URDF

from mirrorcam.cad.assembly.components import Component, camera_component, combined, mirror_components
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.backs.kinova_gen2 import RingPlan
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.plan.back_table import Gen2Back
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.cad.write.robot_link import hull_of, write_robot
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

WRIST = Gen2Back()


@pytest.fixture(scope="module")
def device(default_layout: Layout) -> Device:
    """The default device on a Kinova arm."""
    return plan_device(default_layout, HARDWARE.replaced(back=WRIST))


@pytest.fixture(scope="module")
def components(device: Device, built_block: BuiltPart) -> tuple[Component, ...]:
    mesh = trimesh.load_mesh(built_block.stl)
    looks = (built_block.rgb, built_block.explode_mm, mesh, built_block.mass)
    holder = Component("mirror_holder", "part", "MC-01", "Mirror holder", *looks)
    return holder, *mirror_components(device, [holder]), camera_component(device, holder)


@pytest.fixture(scope="module")
def folder(device: Device, components: tuple[Component, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("device")
    write_robot(out / "robot", device, components)
    return out


@pytest.fixture(scope="module")
def urdf(folder: Path) -> Element:
    return ElementTree.parse(folder / "robot" / "mirrorcam.urdf").getroot()


def pose(origin: Element | None) -> FloatArray:
    """A URDF pose: metres, and successive rotations about the fixed axes x, y, z."""
    assert origin is not None
    roll, pitch, yaw = (float(turn) for turn in origin.get("rpy", "0 0 0").split())
    about = [Rotation.from_rotvec(angle * axis) for angle, axis in zip((roll, pitch, yaw), np.eye(3), strict=True)]
    shift = [float(length) for length in origin.get("xyz", "0 0 0").split()]
    return rigid((about[2] * about[1] * about[0]).as_matrix(), shift)


def attribute(element: Element, child: str, name: str) -> str:
    """An attribute of a child that must exist."""
    found = element.find(child)
    assert found is not None
    return found.attrib[name]


def root_from(urdf: Element, link: str) -> FloatArray:
    """The pose (4, 4), m, of a link in the arm's frame, composed from the joints between them."""
    joints = {attribute(joint, "child", "link"): joint for joint in urdf.findall("joint")}
    matrix = np.eye(4)
    while link in joints:
        matrix = pose(joints[link].find("origin")) @ matrix
        link = attribute(joints[link], "parent", "link")
    assert link == WRIST.link
    return matrix


def test_every_link_hangs_on_the_arm(urdf: Element, device: Device) -> None:
    links = [link.get("name") for link in urdf.findall("link")]
    assert len(set(links)) == len(links)
    views = [f"mirrorcam_view_{row}_{column}" for row in range(3) for column in range(3)]
    assert set(links) == {WRIST.link, "mirrorcam_link", "mirrorcam_camera_optical_frame", *views}
    for link in links:
        root_from(urdf, str(link))
    assert all(joint.get("type") == "fixed" for joint in urdf.findall("joint"))


@pytest.mark.parametrize("name", ["m1n6s200_link_6", "arm/tool-0", "a.b", "7", "null"])
def test_parsers_of_robots_find_the_link_that_the_device_hangs_on(
    name: str, device: Device, components: tuple[Component, ...], tmp_path: Path
) -> None:
    wrist = Gen2Back.model_validate_json(json.dumps({"link": name, "name": "--> <img src=x onerror=alert(1)>"}))
    hung = replace(device, back=plan_back(device.clip, device.mount, device.hardware.replaced(back=wrist)))
    write_robot(tmp_path / "robot", hung, components)
    robot = URDF.from_xml_file(str(tmp_path / "robot" / "mirrorcam.urdf"))
    assert robot.get_root() == name
    text = (tmp_path / "robot" / "mirrorcam.xacro").read_text(encoding="utf-8")
    with_comments = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    macro = ElementTree.fromstring(text, with_comments)
    assert macro.tag == "robot"
    assert f'<xacro:mirrorcam parent="{name}" ' in text


def test_views_look_from_their_virtual_centres_to_the_scene(urdf: Element, device: Device) -> None:
    camera_from_root = np.linalg.inv(root_from(urdf, "mirrorcam_camera_optical_frame"))
    for index, centre in enumerate(device.layout.virtual_centres_in_rig_mm):
        name = f"mirrorcam_view_{index // 3}_{index % 3}"
        rig_from_view = camera_from_root @ root_from(urdf, name)
        np.testing.assert_allclose(rig_from_view[:3, 3] * 1000.0, centre, atol=1e-6)
        # Optical: z forward, x right, y down of the view.
        np.testing.assert_allclose(rig_from_view[:3, :3], device.layout.view_from_rig.T, atol=1e-9)


def test_views_of_another_fold_look_along_their_own_axis(
    device: Device, components: tuple[Component, ...], tmp_path: Path
) -> None:
    sine, cosine = np.sin(np.radians(120.0)), np.cos(np.radians(120.0))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    folded = replace(device, layout=device.layout.replaced(view_from_rig=turn, spec=None))
    write_robot(tmp_path / "robot", folded, components)
    urdf = ElementTree.parse(tmp_path / "robot" / "mirrorcam.urdf").getroot()
    rig_from_view = np.linalg.inv(root_from(urdf, "mirrorcam_camera_optical_frame")) @ root_from(
        urdf, "mirrorcam_view_1_1"
    )
    np.testing.assert_allclose(rig_from_view[:3, 2], [0.0, sine, cosine], atol=1e-9)


def test_the_link_stands_on_the_wrist_and_looks_forward(urdf: Element, device: Device) -> None:
    link_from_rig = np.linalg.inv(root_from(urdf, "mirrorcam_link")) @ root_from(urdf, "mirrorcam_camera_optical_frame")
    saddle = device.back.parts[0].plan.plan
    assert isinstance(saddle, RingPlan)
    on_axis = device.back.rig_from_stand @ [0.0, saddle.band_mm.mean() / 1000.0, saddle.axis_z_mm / 1000.0]
    np.testing.assert_allclose(link_from_rig @ [*on_axis, 1.0], [0.0, 0.0, 0.0, 1.0], atol=1e-9)
    # REP 103: x forward, as the views look, z up, y left.
    right, down, forward = device.layout.view_from_rig
    np.testing.assert_allclose(link_from_rig[:3, :3] @ forward, [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(link_from_rig[:3, :3] @ -down, [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(link_from_rig[:3, :3] @ -right, [0.0, 1.0, 0.0], atol=1e-9)
    # The arm's fingers and the scene are towards its link's -z, and the clamp is at z = -14 mm.
    np.testing.assert_allclose(root_from(urdf, "mirrorcam_link")[:3, 3], [0.0, 0.0, -0.014], atol=1e-9)
    np.testing.assert_allclose(root_from(urdf, "mirrorcam_link")[:3, 0], [0.0, 0.0, -1.0], atol=1e-9)


def test_mass_and_inertia_are_those_of_all_pieces(urdf: Element, components: tuple[Component, ...]) -> None:
    body = combined([component.mass for component in components])
    (inertial,) = urdf.findall("link/inertial")
    assert float(attribute(inertial, "mass", "value")) == pytest.approx(body.mass_g / 1000.0)
    link_from_rig = np.linalg.inv(root_from(urdf, "mirrorcam_link")) @ root_from(urdf, "mirrorcam_camera_optical_frame")
    centre = pose(inertial.find("origin"))
    np.testing.assert_allclose(centre[:3, :3], np.eye(3))
    np.testing.assert_allclose(centre[:3, 3], (link_from_rig @ [*(body.centre_in_rig_mm / 1000.0), 1.0])[:3], atol=1e-9)
    element = inertial.find("inertia")
    assert element is not None
    found = {name: float(value) for name, value in element.items()}
    matrix = np.array([[found["i" + "".join(sorted(a + b))] for b in "xyz"] for a in "xyz"])
    turn = link_from_rig[:3, :3]
    np.testing.assert_allclose(matrix, turn @ body.inertia_g_mm2 @ turn.T * 1e-9, rtol=1e-6, atol=1e-12)
    lengths = np.linalg.eigvalsh(matrix)
    assert lengths[0] > 0.0
    assert lengths[0] + lengths[1] >= lengths[2]


def test_meshes_are_there_at_their_scale(urdf: Element, folder: Path, components: tuple[Component, ...]) -> None:
    (link,) = (link for link in urdf.findall("link") if link.get("name") == "mirrorcam_link")
    files = {}
    for kind in ("visual", "collision"):
        for element in link.findall(kind):
            mesh = element.find("geometry/mesh")
            assert mesh is not None
            assert mesh.get("scale") == "0.001 0.001 0.001"
            files[mesh.get("filename", "")] = kind
            np.testing.assert_allclose(pose(element.find("origin")), pose(link.find("visual/origin")))
    assert files.pop("../parts/mirror_holder.stl") == "visual"
    hulls = {"../robot/meshes/mirror_holder_hull.stl", "../robot/meshes/camera_hull.stl"}
    assert {name for name, kind in files.items() if kind == "collision"} == hulls
    assert set(files) - hulls == {"../robot/meshes/mirrors.stl", "../robot/meshes/camera.stl"}
    for name in files:
        assert trimesh.load_mesh(folder / "robot" / name).is_watertight
    mirrors = trimesh.load_mesh(folder / "robot" / "meshes" / "mirrors.stl")
    assert mirrors.volume == pytest.approx(sum(p.mass.volume_mm3 for p in components if p.kind == "mirror"), rel=1e-4)
    assert trimesh.load_mesh(folder / "robot" / "meshes" / "camera_hull.stl").is_convex


def test_the_macro_is_the_same_with_its_names_left_open(folder: Path, urdf: Element) -> None:
    text = (folder / "robot" / "mirrorcam.xacro").read_text(encoding="utf-8")
    root = ElementTree.fromstring(text)
    (macro,) = root
    assert macro.tag == "{http://www.ros.org/wiki/xacro}macro"
    assert macro.get("params") == "parent prefix:=mirrorcam mesh_root:=.. *origin"

    def plain(element: Element) -> str:
        filled = ElementTree.tostring(element, encoding="unicode").replace("${prefix}", "mirrorcam")
        return ElementTree.canonicalize(filled.replace("${mesh_root}", ".."), strip_text=True)

    # All except the arm's own link and the joint to it, with an origin from the caller.
    for ours, theirs in zip(list(macro)[1:], list(urdf)[2:], strict=True):
        assert plain(ours).replace(' xmlns:xacro="http://www.ros.org/wiki/xacro"', "") == plain(theirs)


def test_the_same_device_gives_the_same_bytes(
    device: Device, components: tuple[Component, ...], folder: Path, tmp_path: Path
) -> None:
    write_robot(tmp_path / "robot", device, components)
    names = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file())
    assert len(names) == 6
    assert all((tmp_path / name).read_bytes() == (folder / name).read_bytes() for name in names)


def test_a_hull_is_closed_though_a_face_is_flat_but_for_rounding() -> None:
    """Corners of a holder's cut face, rounded as in an STL file, and two corners behind it."""
    points = [
        (-1.9913226424250752e-05, 21.540422439575195, 226.02523803710938),
        (-1.9085578969679773e-05, 115.0848617553711, 292.2449035644531),
        (-1.9895858713425696e-05, 21.679487228393555, 225.57745361328125),
        (-1.9890763724106364e-05, 21.695926666259766, 225.42152404785156),
        (-1.912917105073575e-05, 117.41444396972656, 296.06719970703125),
        (-2.0255993149476126e-05, 95.05144500732422, 311.6801452636719),
        (-1.9998846255475655e-05, 19.408340454101562, 226.77545166015625),
        (-31.309097290039062, 117.41448211669922, 296.0672912597656),
        (-164.52926635742188, 48.19211196899414, 267.5191345214844),
    ]
    hull = hull_of(trimesh.Trimesh(np.array(points), [(i, i + 1, i + 2) for i in range(7)], process=False))
    assert hull.is_volume
    assert hull.is_convex
    # The face and its furthest corner span a pyramid; the other corner is outside it.
    base = Polygon([point[1:] for point in points[:7]]).convex_hull.area
    assert hull.volume > base * 164.529 / 3.0


def test_a_device_for_no_arm_has_no_link(device: Device, components: tuple[Component, ...], tmp_path: Path) -> None:
    stands = replace(device, back=replace(device.back, robot=None))
    write_robot(tmp_path / "robot", stands, components)
    assert not list(tmp_path.iterdir())
