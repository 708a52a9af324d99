"""Brackets: one solid on the foot's screws, with its plate in the requested position.

Arms with a flange: holes as in the standard or the published mesh, views along the flange's axis.

The VESA bracket: four nuts on the square, engaged by screws through the arm's plate.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import Back
from mirrorcam.cad.backs.brackets import plan_bracket
from mirrorcam.cad.backs.plan_backs import MAKERS, plan_back
from mirrorcam.cad.plan.back_table import Gen3Back, Iso9409Back, VesaBack
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.write.robot_link import link_from_rig
from mirrorcam.core.values import FloatArray
from tests.cad.backs.planned_blocks import blocks_of, planned_back


def test_a_bracket_extends_from_the_foot_to_below_its_centre(device: Device) -> None:
    bracket = plan_bracket("part", 40.0, (30.0, 20.0, 8.0), 25.0, (), 5.5, device.mount.foot, device.hardware)
    foot_z = device.mount.foot.z_mm
    assert bracket.back_centre[2] == pytest.approx(foot_z - 40.0)
    solid = MAKERS[type(bracket.plan)](bracket.plan)
    assert solid.is_valid
    box = solid.bounding_box()
    np.testing.assert_allclose([box.min.Z, box.max.Z], [foot_z - 60.0, foot_z], atol=1e-6)
    np.testing.assert_allclose(
        [box.min.Y, box.max.Y], [bracket.back_centre[1], device.mount.foot.front_y_mm], atol=1e-6
    )
    assert bracket.front_mm - bracket.back_centre[1] == pytest.approx(8.0)
    assert bracket.critical_section.stress_mpa(12.0, np.array([0.0, 0.0, 30.0])) < 5.0
    assert plan_back(device.clip, device.mount, device.hardware).kind == "none"


def holes_about(back: Back, part: int, radius_mm: float) -> FloatArray:
    """The centres (n, 2; x and z about the flange's axis) of the holes along y with a radius."""
    assert back.robot is not None
    origin = back.robot.rig_from_link[:3, 3]
    return np.array(
        [
            (cut.mouth - origin)[[0, 2]]
            for cut in blocks_of(back.parts[part]).cuts
            if isinstance(cut, Bore) and cut.axis[1] == 1.0 and cut.radius_mm == pytest.approx(radius_mm)
        ]
    )


def test_iso_9409_1_50_4_m6_has_its_circle_its_ring_and_its_pin(device: Device) -> None:
    back = planned_back(device, Iso9409Back())
    screws = holes_about(back, 0, 3.3)
    np.testing.assert_allclose(np.hypot(*screws.T), 25.0)
    angles = np.sort(np.degrees(np.arctan2(screws[:, 1], screws[:, 0])))
    np.testing.assert_allclose(angles, [-135.0, -45.0, 45.0, 135.0])
    np.testing.assert_allclose(holes_about(back, 0, 31.5 / 2.0), [[0.0, 0.0]], atol=1e-9)
    assert np.hypot(*holes_about(back, 0, 3.1)[0]) == pytest.approx(25.0)
    ring = back.parts[1].plan.corners
    assert np.ptp(ring[:, 0]) == pytest.approx(31.5 - 0.4, abs=0.02)
    # It extends into the flange's recess, 3.5 mm deep, and ends flush with the plate's front.
    assert back.robot is not None
    face = back.robot.rig_from_link[1, 3]
    assert face - ring[:, 1].min() == pytest.approx(3.0)
    assert ring[:, 1].max() == pytest.approx(face + 10.0)
    assert {(item.kind, item.size, item.length_mm) for item in back.items} == {("screw", "M6", 16.0)}


@pytest.mark.parametrize("table", [Iso9409Back(), Gen3Back()], ids=["iso9409", "gen3"])
def test_the_views_look_along_the_axis_and_parts_are_solids(device: Device, table: Iso9409Back | Gen3Back) -> None:
    back = planned_back(device, table)
    robot = back.robot
    assert robot is not None
    parent_from_link = Rotation.from_euler("xyz", robot.rpy).as_matrix()
    parent_from_rig = parent_from_link @ link_from_rig(robot)[:3, :3]
    np.testing.assert_allclose(parent_from_rig @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-9)
    if isinstance(table, Gen3Back):
        # Upwards is away from the vision module, which lies towards the link's y.
        np.testing.assert_allclose(parent_from_rig @ [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], atol=1e-9)
    for part in back.parts:
        assert MAKERS[type(part.plan)](part.plan).is_valid


def test_gen3_holes_and_rim_are_those_of_the_published_mesh(device: Device) -> None:
    folder = Path(os.environ.get("MIRRORCAM_KINOVA_MESHES", "none"))
    path = folder / "bracelet_no_vision_link.STL"
    if not path.is_file():
        pytest.skip("no bracelet_no_vision_link.STL of kortex_description in $MIRRORCAM_KINOVA_MESHES")
    mesh = trimesh.load_mesh(path)
    mesh.apply_scale(1000.0)
    table = Gen3Back()
    # 4 mm behind the end of the rim, in the face.
    section = trimesh.intersections.mesh_plane(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, mesh.bounds[0, 2] + 4.0))[:, :, :2]
    points = section.reshape(-1, 2)
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            middle = np.array([x, y]) * table.holes_mm
            near = np.linalg.norm(points - middle, axis=1)
            np.testing.assert_allclose(near[near < 3.0], 2.1, atol=0.03)
    face = -61.525
    assert face - mesh.bounds[0, 2] == pytest.approx(table.rim_mm[2], abs=0.01)
    rim = trimesh.intersections.mesh_plane(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, mesh.bounds[0, 2] + 2.0))[:, :, :2]
    radii = np.hypot(*rim.reshape(-1, 2).T)
    np.testing.assert_allclose((radii.min(), radii.max()), table.rim_mm[:2], atol=0.15)
    assert planned_back(device, table).parts[1].plan.corners[:, 0].max() < radii.min()


@pytest.mark.parametrize("square_mm", [75.0, 100.0])
def test_four_screws_on_the_square_end_just_beyond_their_nuts(device: Device, square_mm: float) -> None:
    back = planned_back(device, VesaBack(square_mm=square_mm))
    (part,) = back.parts
    assert MAKERS[type(part.plan)](part.plan).is_valid
    screws = [item for item in back.items if item.kind == "screw"]
    nuts = [item for item in back.items if item.kind == "nut"]
    places = np.array([item.rig_from_item[:3, 3] for item in screws])
    assert np.ptp(places, axis=0)[[0, 2]] == pytest.approx([square_mm, square_mm])
    for screw, nut in zip(screws, nuts, strict=True):
        tip = screw.rig_from_item[:3, 3] - screw.length_mm * screw.rig_from_item[:3, 2]
        far = nut.rig_from_item[:3, 3] - nut.length_mm * nut.rig_from_item[:3, 2]
        assert 0.0 <= tip[1] - far[1] <= 2.0
