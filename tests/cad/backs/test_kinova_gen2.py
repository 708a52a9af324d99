"""The clamp: closed forms, and its position on the wrist."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
from build123d import GeomType

from mirrorcam.cad.assembly.components import tessellated
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.kinova_gen2 import JOINT_RING_MM, ROUND_TO_MM, SHELL_MM, plan_clamp
from mirrorcam.cad.backs.plan_backs import make_adapter, make_ring, plan_back
from mirrorcam.cad.checks.clashes import check_clashes
from mirrorcam.cad.checks.device_checks import supports_of
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.parts.part_solids import make_clip, make_mount
from mirrorcam.cad.plan.back_table import CAP_EAR_MM, Gen2Back
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.write.robot_link import link_from_rig
from mirrorcam.core.errors import InputError

WRIST = Gen2Back()


def segment_area(radius: float, distance: float) -> float:
    """Area of the segment of a disc outside a chord at a distance from its centre."""
    return float(radius**2 * np.arccos(distance / radius) - distance * np.sqrt(radius**2 - distance**2))


def test_the_cap_is_half_a_ring_with_two_drilled_ears(device: Device) -> None:
    plan = plan_clamp(WRIST, device.mount.foot, HARDWARE)
    cap, wrist, screw = plan.cap, WRIST, HARDWARE.screw
    r, outer, gap = cap.radius_mm, cap.radius_mm + cap.ring_mm, wrist.gap_mm / 2.0
    ring = segment_area(outer, gap) - segment_area(r, gap)
    # Only the part of an ear outside the ring's outer circle adds volume.
    low, high = -gap - CAP_EAR_MM, -gap
    ear_end = float(max(piece.top[:, 0].max() for piece in cap.pieces))
    levels = np.linspace(low, high, 20001)
    ear = float(np.trapezoid(ear_end - np.sqrt(outer**2 - levels**2), levels))
    hole_r, steep = screw.clearance_hole_mm / 2.0, np.deg2rad(42.0)
    hole = np.pi * hole_r**2 + hole_r**2 / np.tan(steep) - (np.pi / 2.0 - steep) * hole_r**2
    expected = wrist.band_mm * (ring + 2.0 * ear) - 2.0 * CAP_EAR_MM * hole
    assert make_ring(cap).volume == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_both_halves_are_one_valid_solid_on_the_wrists_axis(device: Device, kind: str) -> None:
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    plan = plan_clamp(WRIST, device.mount.foot, hardware)
    for ring in (plan.saddle, plan.cap):
        part = make_ring(ring)
        assert part.is_valid
        radius = pytest.approx(WRIST.diameter_mm / 2.0)
        bores = [face for face in part.faces().filter_by(GeomType.CYLINDER) if face.radius == radius]
        assert bores
        for face in bores:
            axis = face.axis_of_rotation
            assert axis is not None
            assert abs(axis.direction.Y) == pytest.approx(1.0)
            np.testing.assert_allclose([axis.position.X, axis.position.Z], [0.0, ring.axis_z_mm], atol=1e-9)
        bounds = part.bounding_box()
        assert pytest.approx(ring.band_mm[1]) == bounds.max.Y
        # The gap between the halves remains.
        face_z = bounds.min.Z if ring.above else bounds.max.Z
        side = 1.0 if ring.above else -1.0
        assert face_z == pytest.approx(ring.axis_z_mm + side * WRIST.gap_mm / 2.0)


def test_the_saddle_reaches_up_to_the_mounts_foot_and_clears_the_clip(device: Device) -> None:
    clip = device.clip
    plan = plan_clamp(WRIST, device.mount.foot, HARDWARE)
    top = make_ring(plan.saddle).bounding_box().max.Z
    assert top == pytest.approx(device.mount.foot.z_mm)
    # The clip at its lowest is over the foot's plane.
    lowest = corners_of(clip.pieces) - [0.0, 0.0, clip.travel_mm]
    assert top < float((lowest @ device.mount.foot.up_in_rig).min())


def test_a_different_wrist_gives_a_different_clamp(device: Device) -> None:
    plan = plan_clamp(WRIST.replaced(diameter_mm=75.0, band_mm=11.0), device.mount.foot, HARDWARE)
    part = make_ring(plan.saddle)
    assert part.is_valid
    assert plan.saddle.radius_mm == 37.5
    assert np.ptp(plan.saddle.band_mm) == pytest.approx(11.0)


def test_a_riser_too_thin_for_its_screws_is_refused(device: Device) -> None:
    with pytest.raises(InputError, match=r"adapter's plate is 4\.0 mm thick, expected 5\.5 mm"):
        plan_clamp(WRIST.replaced(riser_mm=10.0), device.mount.foot, HARDWARE)


def test_the_clamp_sits_where_the_shell_is_round_and_clear_of_the_joints_ring() -> None:
    """By the radii measured in the published meshes; in a former position, the clamp cut the ring."""
    radius, ring_end = WRIST.diameter_mm / 2.0, JOINT_RING_MM[1]
    start, end = WRIST.along_mm - WRIST.band_mm / 2.0, WRIST.along_mm + WRIST.band_mm / 2.0
    assert start >= ring_end
    assert end <= ROUND_TO_MM
    along, least, most = SHELL_MM.T
    band = (along >= start) & (along <= end)
    assert band.sum() >= 4
    assert np.abs(np.concatenate([least[band], most[band]]) - radius).max() < 0.15
    assert JOINT_RING_MM[0] - radius > 2.0


@pytest.mark.parametrize(("along_mm", "fits"), [(14.0, True), (0.0, False), (30.0, False)])
def test_the_clash_check_finds_a_clamp_on_the_ring_or_on_the_hand(along_mm: float, fits: bool, device: Device) -> None:
    on = replace(
        device, back=plan_back(device.clip, device.mount, device.hardware.replaced(back=Gen2Back(along_mm=along_mm)))
    )
    solids = {part.name: solid_of(tessellated(make_adapter(part.plan))) for part in on.back.parts}
    checks = check_clashes(solids | supports_of(on), on.hardware.fit.press_mm)
    assert checks["wrist.clash_mm3"].passed == fits
    assert on.back.robot is not None
    assert on.back.robot.xyz_mm == (0.0, 0.0, -along_mm)


def meshes() -> dict[str, trimesh.Trimesh]:
    """The published meshes of Kinova, in mm."""
    folder = os.environ.get("MIRRORCAM_KINOVA_MESHES")
    names = ("hand_2finger", "hand_3finger", "ring_small")
    paths = [Path(folder or ".") / f"{name}.STL" for name in names]
    if not folder or not all(path.is_file() for path in paths):
        pytest.skip("no hand_2finger.STL, … of kinova_description/meshes in $MIRRORCAM_KINOVA_MESHES")
    found = {}
    for name, path in zip(names, paths, strict=True):
        mesh = trimesh.load_mesh(path)
        mesh.apply_scale(1000.0)
        found[name] = mesh
    return found


def radii_mm(mesh: trimesh.Trimesh, along_mm: float) -> tuple[float, float]:
    """Smallest and largest outer radius of a mesh about z, over 36 sectors of its section at z = -along."""
    section = trimesh.intersections.mesh_plane(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, -along_mm))
    points = (section[:, :1] + np.linspace(0.0, 1.0, 5)[None, :, None] * (section[:, 1:] - section[:, :1])).reshape(
        -1, 3
    )
    sector = np.floor((np.degrees(np.arctan2(points[:, 1], points[:, 0])) + 180.0) / 10.0).astype(int) % 36
    radius = np.hypot(points[:, 0], points[:, 1])
    outer = [radius[sector == number].max() for number in range(36)]
    return float(min(outer)), float(max(outer))


def test_the_table_of_radii_is_that_of_the_published_meshes() -> None:
    found = meshes()
    for along, least, most in SHELL_MM[1:]:
        np.testing.assert_allclose(radii_mm(found["hand_2finger"], float(along)), (least, most), atol=0.03)
    ring = found["ring_small"].bounds
    assert pytest.approx((radii_mm(found["ring_small"], 5.0)[1], -ring[0, 2]), abs=0.03) == JOINT_RING_MM
    # Three fingers: at the end of the band the shell is 2.5 mm too wide for the clamp.
    assert radii_mm(found["hand_3finger"], WRIST.along_mm + WRIST.band_mm / 2.0)[1] > WRIST.diameter_mm / 2.0 + 2.0


def test_the_clamp_and_all_on_it_clear_the_published_hand(device: Device) -> None:
    """The meshes in the pose of the robot description: they fill the clamp and overlap no part."""
    found = meshes()
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=WRIST))
    link = back.robot
    assert link is not None
    rig_from_link = np.linalg.inv(link_from_rig(link))
    parent_from_link = trimesh.transformations.euler_matrix(*link.rpy, "sxyz")
    parent_from_link[:3, 3] = link.xyz_mm
    rig_from_parent = rig_from_link @ np.linalg.inv(parent_from_link)
    parts = [tessellated(make_adapter(part.plan)) for part in back.parts]
    parts += [tessellated(make_mount(device.mount)), tessellated(make_clip(device.clip))]
    for name in ("hand_2finger", "ring_small"):
        points = found[name].copy()
        points.apply_transform(rig_from_parent)
        inside = [solid_of(part) for part in parts]
        for solid in inside:
            # Points of the mesh deeper in a part than the deviation of the shell from the clamp's bore.
            deep = [point for point in np.asarray(points.vertices) if _in_mm(solid, point) > 0.15]
            assert deep == []


def _in_mm(solid: manifold3d.Manifold, point: np.ndarray) -> float:
    """Depth of a point (3,) in a solid, by the largest tested cube about it that is inside; 0 outside."""
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    if (point < low).any() or (point > high).any():
        return 0.0
    cube = manifold3d.Manifold.cube((0.3, 0.3, 0.3), center=True).translate(tuple(float(x) for x in point))
    return 0.16 if (cube - solid).is_empty() else 0.0
