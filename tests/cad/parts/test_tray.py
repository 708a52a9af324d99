"""The pieces of a tray: pads end at the points of the nest, and nothing hangs over when it lies on its slide."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.catalogue import Y_UP, standing
from mirrorcam.cad.assembly.pieces import tessellated
from mirrorcam.cad.checks.clashes import common_mm3
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.overhangs import check_overhangs
from mirrorcam.cad.checks.wall_thickness import thinnest_wall_mm
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.parts.tray import PAD_MM, Tray, far_leaf
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.cad.write.slicer import find_slicer, slice_3mf
from mirrorcam.optics.geometry.camera_body import Lips
from mirrorcam.optics.geometry.camera_library import camera_names, read_body

BODIES = [name for name in camera_names() if read_body(name).held_by.kind == "lips"]


def hardware_of(name: str, kind: str = "insert") -> Hardware:
    return HARDWARE.replaced(camera=read_body(name), screw=HARDWARE.screw.replaced(kind=kind))


@pytest.mark.parametrize(("name", "kind"), [("c920", "insert"), ("c920", "nut"), ("d435", "insert"), ("oak_d", "nut")])
def test_a_tray_prints_on_its_slide_with_nothing_to_support_it(name: str, kind: str) -> None:
    hardware = hardware_of(name, kind)
    plan = plan_clip(hardware)
    mesh = tessellated(make_clip(plan))
    assert thinnest_wall_mm(mesh, solid_of(mesh)) >= hardware.printer.wall_mm - 0.01
    mesh.apply_transform(standing(Y_UP, plan.slide_y_mm))
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-6)
    failed = [
        name for name, check in check_overhangs(mesh, solid_of(mesh), hardware.printer).items() if not check.passed
    ]
    assert [name for name in failed if name != "bridged_mm2"] == []


@pytest.mark.skipif(find_slicer() is None, reason="needs PrusaSlicer")
@pytest.mark.parametrize("turn_deg", [0.0, 35.0])
def test_a_slicer_puts_no_support_into_an_oblique_nut_s_pocket(turn_deg: float, tmp_path: Path) -> None:
    plan = plan_clip(hardware_of("c920", "nut"))
    write_stl(tmp_path / "clip.stl", make_clip(plan))
    mesh = trimesh.load_mesh(tmp_path / "clip.stl")
    mesh.apply_transform(standing(Y_UP, plan.slide_y_mm))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(turn_deg), [0.0, 0.0, 1.0]))
    mesh.apply_translation([100.0, 100.0, 0.0])
    mesh.export(tmp_path / "clip.stl")
    sliced = slice_3mf(tmp_path / "clip.stl", HARDWARE.printer)
    assert sliced is not None and sliced.support_mm == 0.0


def test_nothing_of_a_nut_s_shoulder_is_over_the_hole_through_it() -> None:
    plan = plan_clip(hardware_of("c920", "nut"))
    assert plan.nest is not None
    for screw in plan.nest.screws:
        along = [cut for cut in plan.cuts if abs(abs(float(getattr(cut, "axis", screw.tip) @ screw.axis)) - 1.0) < 1e-9]
        (pocket,) = (cut for cut in along if isinstance(cut, Hexagon) and pointing(cut, screw.tip, screw.axis))
        (hole,) = (cut for cut in along if isinstance(cut, Bore) and pointing(cut, screw.tip, screw.axis))
        assert hole.roof_mm > pocket.ridge_mm + 0.1


def pointing(cut: Bore | Hexagon, tip: np.ndarray, axis: np.ndarray) -> bool:
    """Whether a cut lies on a screw's axis."""
    return bool(np.linalg.norm(np.cross(cut.mouth - tip, axis)) < 1e-6)


@pytest.mark.parametrize("name", ["c920", "oak_d", "iphone_13"])
def test_each_point_of_the_nest_is_on_the_face_of_a_piece_and_on_no_other(name: str) -> None:
    """Pads stand off everything else by their height: only they touch the body."""
    plan = plan_clip(hardware_of(name))
    assert plan.nest is not None
    for point, normal in zip(plan.nest.points, plan.nest.normals, strict=True):
        assert sum(depth(piece, point) > -1e-6 for piece in plan.pieces) == 1
        assert max(depth(piece, point - 0.1 * normal) for piece in plan.pieces) > 0.05
        assert sum(depth(piece, point + 0.5 * PAD_MM * normal) > 0.0 for piece in plan.pieces) == 0


def depth(solid: Frustum, point: np.ndarray) -> float:
    normals, offsets = solid.half_spaces
    return float((offsets - normals @ point).min())


@pytest.mark.parametrize("name", BODIES)
def test_nothing_of_the_far_leaf_stands_before_the_mouth_of_its_screw(name: str) -> None:
    """Where the iron comes from; a heavy camera's leaf is thicker than its boss is long."""
    hardware = hardware_of(name)
    nest, camera = plan_clip(hardware).nest, hardware.camera
    assert nest is not None
    assert isinstance(camera.held_by, Lips)
    far = nest.screws[1]
    around = hardware.screw.insert_hole_mm / 2.0 + hardware.screw.insert_wall_mm
    mouth = far.tip - far.mouth_mm * far.axis
    for piece in far_leaf(Tray.of(camera, camera.held_by), far, around):
        assert ((np.vstack([piece.base, piece.top]) - mouth) @ far.axis).min() > -1e-9


def test_a_mirrored_tray_is_the_mirror_image() -> None:
    """Seen from the stop on, the D435 and its mirror image are one tray."""
    camera = read_body("d435")
    assert isinstance(camera.held_by, Lips)
    other = camera.replaced(lens_x_mm=-camera.lens_x_mm)
    first, second = Tray.of(camera, camera.held_by), Tray.of(other, camera.held_by)
    assert (first.side, second.side) == (-1.0, 1.0)
    np.testing.assert_allclose(first.low, second.low)
    np.testing.assert_allclose(first.high, second.high)
    np.testing.assert_allclose(first.rig((3.0, 1.0, 2.0)), (-3.0, 1.0, 2.0))


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_both_screws_have_a_hole_right_through_their_bosses(kind: str) -> None:
    """From the mouth to beyond the tip; the insert's or nut's space lies along it."""
    plan = plan_clip(hardware_of("c920", kind))
    assert plan.nest is not None
    for screw in plan.nest.screws:
        holes = [
            cut
            for cut in plan.cuts
            if isinstance(cut, Bore | Hexagon) and abs(abs(float(cut.axis @ screw.axis)) - 1.0) < 1e-9
        ]
        along = [cut for cut in holes if np.linalg.norm(np.cross(cut.mouth - screw.tip, screw.axis)) < 1e-6]
        through = max(cut.depth_mm for cut in along if isinstance(cut, Bore))
        assert len(along) == 2
        assert through > screw.mouth_mm + 3.0


@pytest.mark.parametrize("kind", ["insert", "nut"])
@pytest.mark.parametrize("name", ["c920", "oak_d"])
def test_the_sprung_screws_stand_in_nothing_but_their_threads(name: str, kind: str) -> None:
    """Also at a square corner, where the tip is beside the leaf."""
    plan = plan_clip(hardware_of(name, kind))
    clip = solid_of(tessellated(make_clip(plan)))
    assert plan.nest is not None
    for screw in plan.nest.screws:
        rod = manifold3d.Manifold.cylinder(screw.length_mm, 1.5, circular_segments=48)
        frame = np.column_stack([trimesh.geometry.align_vectors([0.0, 0.0, 1.0], screw.axis)[:3, :3], screw.head])
        assert common_mm3(clip, rod.transform(frame)) == 0.0
