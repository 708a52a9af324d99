"""The complete device: the files of a build pass, and fail if a piece is out of place."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
from trimesh.exchange.gltf import export_glb

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.components import mass_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks import check_device
from mirrorcam.cad.checks.cut_outlines import fits
from mirrorcam.cad.checks.device_checks import (
    ASSEMBLY,
    DROP_HEIGHT_RATIO,
    assembly_mass,
    check_drop,
    check_mass,
    read_glb,
    supports_of,
)
from mirrorcam.cad.checks.exported_mesh import read_3mf, solid_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart, MassProperties, PartPlan
from mirrorcam.cad.printed_volume import printed_mm3
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout

Built = tuple[Layout, Path, dict[str, Metric]]
Drop = Callable[[manifold3d.Manifold], dict[str, float]]


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def built_part(plan: PartPlan, folder: Path) -> BuiltPart:
    printer, printed = HARDWARE.printer, solid_of(read_3mf(folder / f"{plan.name}.3mf"))
    density = printer.plastic_g_per_cm3 * printed_mm3(printed, printer.wall_mm) / printed.volume()
    return BuiltPart.of(plan, folder, mass_of(trimesh.load_mesh(folder / f"{plan.name}.stl"), density), {})


@pytest.fixture
def copied(built_default: Built, tmp_path: Path) -> Path:
    """A copy of the checked files of the default build, to be altered."""
    _, folder, _ = built_default
    for name in ("parts", "mirrors"):
        shutil.copytree(folder / name, tmp_path / name)
    shutil.copy(folder / ASSEMBLY, tmp_path / ASSEMBLY)
    return tmp_path


def checked(device: Device, folder: Path) -> dict[str, Metric]:
    return check_device(device, [built_part(plan, folder / "parts") for plan in parts_of(device)], folder)


def test_the_default_device_passes_and_the_assembly_is_what_its_parts_are(
    device: Device, copied: Path, built_default: Built
) -> None:
    checks = checked(device, copied)
    assert failed(checks) == set()
    _, _, of_build = built_default
    same = {name: of_build[name].value for name in checks if name != "device.parts_sliced"}
    # The build weighs the B-rep, this test the mesh.
    again = {name: check.value for name, check in checks.items() if name != "device.parts_sliced"}
    assert again == pytest.approx(same, rel=1e-4)
    assert supports_of(device) == {}
    assert checks["device.tips_at_deg"].value >= 10.0
    assert checks["device.tripod_turns"].value >= 3.0
    assembly = read_glb(copied / ASSEMBLY)
    for plan in parts_of(device):
        if plan.name in assembly:
            mesh = trimesh.load_mesh(copied / "parts" / f"{plan.name}.stl")
            assert assembly[plan.name].volume == pytest.approx(mesh.volume, rel=1e-5)
            np.testing.assert_allclose(assembly[plan.name].bounds, mesh.bounds, atol=1e-4)


def test_a_device_whose_files_do_not_belong_together_is_found(device: Device, copied: Path) -> None:
    """The mount 3 mm in the holder, a hole in the clip's mesh, no camera in the assembly, and no sheet of mirrors."""
    mount, clip = (copied / "parts" / f"{name}.stl" for name in ("mount", "camera_clip"))
    mesh = trimesh.load_mesh(mount)
    mesh.apply_translation(-3.0 * device.holder.rig_from_mount[:3, 2])
    mesh.export(mount)
    mesh = trimesh.load_mesh(clip)
    mesh.update_faces(np.arange(len(mesh.faces)) != 11)
    mesh.export(clip)
    scene = trimesh.load_scene(copied / ASSEMBLY)
    scene.delete_geometry([scene.graph.get("camera")[1]])
    (copied / ASSEMBLY).write_bytes(export_glb(scene))
    for sheet in (copied / "mirrors").glob("*.dxf"):
        sheet.unlink()
    expected = {
        *("device.clash_mm3", "mount.clash_mm3", "mirror_holder.clash_mm3", "device.pieces_amiss"),
        *("device.meshes_broken", "mirrors.outlines_missing"),
    }
    assert expected <= failed(checked(device, copied))


def test_a_wrist_in_the_light_and_in_the_mirrors_is_found_and_a_room_seen_where_the_holder_is_missing(
    device: Device, copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    holder = copied / "parts" / "mirror_holder.stl"
    mesh = trimesh.load_mesh(holder)
    mesh.apply_translation((0.0, 0.0, -1000.0))
    mesh.export(holder)
    middle = np.mean([mirror.outline_in_rig_mm.mean(axis=0) for mirror in device.layout.mirrors], axis=0)
    wrist = manifold3d.Manifold.cylinder(17.0, 31.5, center=True).translate(tuple(middle))
    monkeypatch.setattr("mirrorcam.cad.checks.device_checks.supports_of", lambda *_: {"wrist": wrist})
    checks = checked(device, copied)
    expected = {"device.rays_blocked", "wrist.light_gap_mm", "device.clash_mm3", "wrist.clash_mm3"}
    assert expected <= failed(checks)
    assert checks["device.stray_light"].value > 0.003
    assert checks["wrist.light_gap_mm"].value == 0.0


def test_mass_and_centre_are_those_of_the_pieces(built_block: BuiltPart) -> None:
    """8 g of plastic at x = 0, a camera of 160 g at x = 100, and 1 cm3 of glass at x = 50."""

    def box(volume_mm3: float, x: float) -> trimesh.Trimesh:
        side = volume_mm3 ** (1.0 / 3.0)
        mesh = trimesh.creation.box((side, side, side))
        mesh.apply_translation((x, 0.0, 0.0))
        return mesh

    pieces = {"mount": box(10_000.0, 0.0), "camera": box(500.0, 100.0), "mirror_0-0": box(1000.0, 50.0)}
    mass = MassProperties(volume_mm3=1e4, mass_g=8.0, centre_in_rig_mm=np.zeros(3), inertia_g_mm2=np.eye(3))
    checks = check_mass(assembly_mass(HARDWARE, pieces, [built_block.replaced(name="mount", mass=mass)]))
    plastic, camera, glass = 8.0, HARDWARE.camera.mass_g, 2.5
    assert checks["device.mass_g"].value == pytest.approx(plastic + camera + glass, abs=0.01)
    expected = (100.0 * camera + 50.0 * glass) / (plastic + camera + glass)
    assert checks["device.centre_x_mm"].value == pytest.approx(expected, abs=0.01)


@pytest.fixture
def drop(make_flat_pair: Callable[..., Layout]) -> Drop:
    """Volumes that a body, in a frame on the mirror's back, shares with the path of a mirror of 30 x 20 x 2 mm."""
    layout = make_flat_pair(gap_mm=40.0, width_mm=30.0, height_mm=20.0, thickness_mm=2.0)
    mirror = layout.mirrors[0]
    back = mirror.outline_in_plane_mm * (1.0, -1.0)
    laid = {"0-0": min(fits(back, back), key=lambda fit: fit.error_mm)}
    frame = mirror.rig_from_plane.copy()
    frame[:3, 3] += mirror.back_mm * mirror.normal_in_rig

    def check(body: manifold3d.Manifold) -> dict[str, float]:
        checks = check_drop(laid, layout, [body.transform(frame[:3])], HARDWARE.fit.free_mm)
        assert all(check.passed == (check.value == 0.0) for check in checks.values() if check.limit is not None)
        return {name: check.value for name, check in checks.items()}

    return check


def test_a_mirror_drops_into_its_pocket(drop: Drop) -> None:
    """Walls of 1 mm on a floor, at the stated clearance or 0.1 mm nearer, and a lip over the mirror."""

    def pocket(clearance: float) -> manifold3d.Manifold:
        floor = manifold3d.Manifold.cube((50.0, 40.0, 6.0)).translate((-25.0, -20.0, -5.0))
        return floor - manifold3d.Manifold.cube((30.0 + 2 * clearance, 20.0 + 2 * clearance, 5.0)).translate(
            (-15.0 - clearance, -10.0 - clearance, 0.0)
        )

    fit = HARDWARE.fit.free_mm
    sound = drop(pocket(fit))
    assert sound["drop_clash_mm3"] == sound["room_clash_mm3"] == 0.0
    narrow = drop(pocket(fit - 0.1))
    assert narrow["drop_clash_mm3"] == 0.0
    # The missing clearance all round, minus the rounding at the corners, over a height of 1 mm.
    assert narrow["room_clash_mm3"] == pytest.approx((2 * (30 + 20) + 4 * 2 * fit) * 0.1, rel=0.03)
    lip = manifold3d.Manifold.cube((4.0, 40.0, 1.0)).translate((11.0, -20.0, 5.0))
    over = drop(pocket(fit) + lip)
    assert over["drop_clash_mm3"] == pytest.approx(4.0 * 20.0 * 1.0, rel=1e-3)
    beyond = lip.translate((0.0, 0.0, DROP_HEIGHT_RATIO * 2.0))
    assert drop(pocket(fit) + beyond)["drop_clash_mm3"] == 0.0
