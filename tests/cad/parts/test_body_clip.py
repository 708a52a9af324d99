"""The pieces of a tray: pads end at the points of the nest, and nothing overhangs in print on its slide.

Bodies in their trays: six points on the body's solid, also on round ends, and forces on all of them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
from shapely import MultiPoint

from mirrorcam.cad.assembly.catalogue import Y_UP, with_base_at
from mirrorcam.cad.assembly.components import camera_solid, tessellated
from mirrorcam.cad.checks.clashes import overlap_mm3
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.part_checks import check_overhangs, thinnest_wall_mm
from mirrorcam.cad.parts.body_clip import PAD_MM, WEIGHT_RESERVE, Tray, far_leaf, hold_body
from mirrorcam.cad.parts.camera_box import GRAVITY_N_PER_KG, Nest, body_box, min_contact_n, reactions
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.prisms import box, overlap_mm
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.cad.write.slicer import find_slicer, slice_3mf
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.camera_body import CameraBody, Lips
from mirrorcam.optics.geometry.camera_library import camera_names, read_body
from tests.nightly import a_few

BODIES = [name for name in camera_names() if read_body(name).held_by.kind == "lips"]


def hardware_of(name: str, kind: str = "insert") -> Hardware:
    return HARDWARE.replaced(camera=read_body(name), screw=HARDWARE.screw.replaced(kind=kind))


@pytest.mark.parametrize(
    ("name", "kind"), a_few(2, [("c920", "insert"), ("c920", "nut"), ("d435", "insert"), ("oak_d", "nut")])
)
def test_a_tray_prints_on_its_slide_with_nothing_to_support_it(name: str, kind: str) -> None:
    hardware = hardware_of(name, kind)
    plan = plan_clip(hardware)
    mesh = tessellated(make_clip(plan))
    assert thinnest_wall_mm(mesh, solid_of(mesh)) >= hardware.printer.wall_mm - 0.01
    mesh.apply_transform(with_base_at(Y_UP, plan.slide_y_mm))
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-6)
    failed = [
        name for name, check in check_overhangs(mesh, solid_of(mesh), hardware.printer).items() if not check.passed
    ]
    assert [name for name in failed if name != "bridged_mm2"] == []


@pytest.mark.slow
@pytest.mark.skipif(find_slicer() is None, reason="needs PrusaSlicer")
@pytest.mark.parametrize("turn_deg", [0.0, 35.0])
def test_a_slicer_puts_no_support_into_an_oblique_nut_s_pocket(turn_deg: float, tmp_path: Path) -> None:
    plan = plan_clip(hardware_of("c920", "nut"))
    # The hollow for the cable's tie is bridged, which the slicer does not see at every rotation.
    tie_z = plan.tie_mm[2]
    at_tie = [cut for cut in plan.cuts if isinstance(cut, Frustum) and abs(cut.base[:, 2].mean() - tie_z) < 1.0]
    assert len(at_tie) == 3
    write_stl(
        tmp_path / "clip.stl",
        make_clip(replace(plan, cuts=tuple(cut for cut in plan.cuts if all(cut is not each for each in at_tie)))),
    )
    mesh = trimesh.load_mesh(tmp_path / "clip.stl")
    mesh.apply_transform(with_base_at(Y_UP, plan.slide_y_mm))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(turn_deg), [0.0, 0.0, 1.0]))
    mesh.apply_translation([100.0, 100.0, 0.0])
    mesh.export(tmp_path / "clip.stl")
    sliced = slice_3mf(tmp_path / "clip.stl", HARDWARE.printer)
    assert sliced is not None and sliced.support_mm == 0.0


def test_no_part_of_a_nut_s_shoulder_is_over_the_hole_through_it() -> None:
    plan = plan_clip(hardware_of("c920", "nut"))
    assert plan.nest is not None
    for screw in plan.nest.screws:
        along = [cut for cut in plan.cuts if abs(abs(float(getattr(cut, "axis", screw.tip) @ screw.axis)) - 1.0) < 1e-9]
        (pocket,) = (cut for cut in along if isinstance(cut, Hexagon) and pointing(cut, screw.tip, screw.axis))
        (hole,) = (cut for cut in along if isinstance(cut, Bore) and pointing(cut, screw.tip, screw.axis))
        assert hole.roof_mm > pocket.ridge_mm + 0.1


def pointing(cut: Bore | Hexagon, tip: np.ndarray, axis: np.ndarray) -> bool:
    """Return whether a cut is on a screw's axis."""
    return bool(np.linalg.norm(np.cross(cut.mouth - tip, axis)) < 1e-6)


@pytest.mark.parametrize("name", ["c920", "oak_d", "iphone_13"])
def test_each_point_of_the_nest_is_on_the_face_of_a_piece_and_on_no_other(name: str) -> None:
    """Pads protrude from everything else by their height: only they touch the body."""
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
def test_the_far_leaf_does_not_obstruct_the_mouth_of_its_screw(name: str) -> None:
    """The soldering iron comes from there; a heavy camera's leaf is thicker than its boss is long."""
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
    """The D435 and its mirror image have the same tray in coordinates from the stop."""
    camera = read_body("d435")
    assert isinstance(camera.held_by, Lips)
    other = camera.replaced(lens_x_mm=-camera.lens_x_mm)
    first, second = Tray.of(camera, camera.held_by), Tray.of(other, camera.held_by)
    assert (first.side, second.side) == (-1.0, 1.0)
    np.testing.assert_allclose(first.low, second.low)
    np.testing.assert_allclose(first.high, second.high)
    np.testing.assert_allclose(first.in_rig((3.0, 1.0, 2.0)), (-3.0, 1.0, 2.0))


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_both_screws_have_a_hole_right_through_their_bosses(kind: str) -> None:
    """From the mouth to past the tip; the space of the insert or nut is along it."""
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


@pytest.mark.parametrize("kind", a_few(2, ["insert", "nut"]))
@pytest.mark.parametrize("name", ["c920", "oak_d"])
def test_the_sprung_screws_touch_nothing_but_their_threads(name: str, kind: str) -> None:
    """Also at a square corner, where the tip is next to the leaf."""
    plan = plan_clip(hardware_of(name, kind))
    clip = solid_of(tessellated(make_clip(plan)))
    assert plan.nest is not None
    for screw in plan.nest.screws:
        rod = manifold3d.Manifold.cylinder(screw.length_mm, 1.5, circular_segments=48)
        frame = np.column_stack([trimesh.geometry.align_vectors([0.0, 0.0, 1.0], screw.axis)[:3, :3], screw.head])
        assert overlap_mm3(clip, rod.transform(frame)) == 0.0


ON_MM = 0.06  # a body is a mesh here


def connected_to_camera(name: str) -> Hardware:
    return HARDWARE.replaced(camera=read_body(name))


def nest_of(hardware: Hardware) -> Nest:
    nest = plan_clip(hardware).nest
    assert nest is not None
    return nest


@pytest.mark.parametrize("name", BODIES)
def test_six_points_and_both_tips_are_on_the_body_and_point_into_it(name: str) -> None:
    """Also on round ends, where points on the bounding box would touch nothing."""
    hardware = connected_to_camera(name)
    nest, body = nest_of(hardware), solid_of(tessellated(camera_solid(hardware.camera)))
    speck = manifold3d.Manifold.cube((2e-3, 2e-3, 2e-3), center=True)
    places = np.vstack([nest.points, [screw.tip for screw in nest.screws]])
    inwards = np.vstack([nest.normals, [screw.axis for screw in nest.screws]])
    for place, inward in zip(places, inwards, strict=True):
        assert body.min_gap(speck.translate(tuple(place - 0.5 * inward)), 1.0) == pytest.approx(0.5, abs=ON_MM)
        assert not (body ^ speck.translate(tuple(place + ON_MM * 2.0 * inward))).is_empty()


@pytest.mark.parametrize("name", BODIES)
def test_the_screws_press_on_all_six_points_however_the_robot_shakes_the_camera(name: str) -> None:
    hardware = connected_to_camera(name)
    nest, camera = nest_of(hardware), hardware.camera
    weight = WEIGHT_RESERVE * camera.mass_g / 1000.0 * GRAVITY_N_PER_KG * hardware.clip.shaken_g
    printer = hardware.printer
    assert min_contact_n(nest, body_box(camera).centre, weight, printer.plastic_mpa, printer.plastic_creep) >= 0.0
    assert max(screw.leaf.strain(printer.plastic_mpa) for screw in nest.screws) <= printer.plastic_strain
    # Each screw alone presses on its points, and lifts the body off none.
    tips, axes = np.array([s.tip for s in nest.screws]), np.array([s.axis for s in nest.screws])
    pressed = reactions(nest, tips, axes)
    assert (pressed[:3, 0] > 0.1).all()
    assert (pressed[3:, 1] > 0.1).all()


def test_three_points_fix_the_front_and_none_of_them_is_on_the_lens() -> None:
    for name in BODIES:
        camera, nest = read_body(name), nest_of(connected_to_camera(name))
        np.testing.assert_allclose(nest.normals[:3], np.tile([0.0, 0.0, -1.0], (3, 1)))
        np.testing.assert_allclose(nest.points[:3, 2], camera.pupil_behind_front_mm)
        assert np.linalg.norm(nest.points[:3, :2], axis=1).min() > camera.lens_ring_mm / 2.0 + 1.0


def test_round_ends_rest_on_a_v_and_flat_ones_on_a_pad() -> None:
    c920, oak = nest_of(connected_to_camera("c920")), nest_of(connected_to_camera("oak_d"))
    np.testing.assert_allclose(np.abs(c920.normals[3:5, :2]), np.sqrt(0.5))
    np.testing.assert_allclose(oak.normals[5], [1.0, 0.0, 0.0])


def test_a_lens_near_one_end_has_the_stop_at_the_other() -> None:
    """The corner over the front would cover the lens: the D435's colour camera is near the low end of x."""
    assert nest_of(connected_to_camera("d435")).points[0, 0] > 0.0
    assert nest_of(connected_to_camera("c920")).points[0, 0] < 0.0


@pytest.mark.parametrize("name", BODIES)
def test_the_body_goes_in_from_the_scene(name: str) -> None:
    """A body with flat ends enters straight, one with round ends one end first, until the other is lowered."""
    hardware = connected_to_camera(name)
    plan, camera, nest = plan_clip(hardware), hardware.camera, nest_of(hardware)
    body = body_box(camera)
    outline = rounded(camera)
    corner = nest.points[0]
    side = 1.0 if corner[0] < body.centre[0] else -1.0
    pivot = body.centre[:2] - [side * (camera.width_mm / 2.0 - camera.end_radius_mm), 0.0]
    is_v = abs(nest.normals[4, 0]) > 0.1
    slices = [
        np.vstack([piece.base, piece.top])[:, :2]
        for piece in plan.pieces
        if np.vstack([piece.base, piece.top])[:, 2].min() < body.high[2] - 0.01
        and np.vstack([piece.base, piece.top])[:, 2].max() > body.low[2] + 0.01
    ]
    for step in np.linspace(0.0, 1.0, 40):
        if is_v:
            turn = side * step * np.deg2rad(40.0)
            matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            # When it is tilted, a round end with a small flat moves off the V.
            placed = (outline - pivot) @ matrix.T + pivot + [side * 0.5 * np.sin(abs(turn)), 0.0]
        else:
            placed = outline + np.array([0.0, 80.0 * step])
        assert not any(cross(placed, points) for points in slices)


def rounded(camera: CameraBody) -> np.ndarray:
    """The outline of a body as points (n, 2) in x and y, slightly reduced."""
    body, r = body_box(camera), camera.end_radius_mm
    half = np.array([camera.width_mm, camera.height_mm]) / 2.0 - r
    angles = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.asarray(body.centre[:2] + np.sign(circle.round(9)) * half + (r - 0.02) * circle)


def cross(first: np.ndarray, second: np.ndarray) -> bool:
    return bool(MultiPoint(first).convex_hull.intersection(MultiPoint(second).convex_hull).area > 0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens_ring_mm": 26.0}, r"lens ring \(26 mm across\) by 1\.5 mm.*lip_mm of at most 1\.5"),
        ({"width_mm": 47.0, "lens_ring_mm": 22.0}, r"corner overlaps the lens ring by \d+\.\d mm"),
        (
            {"mass_g": 700.0},
            r"would be \d+\.\d mm thick on \d+\.\d mm and strained by .* a quarter of its length and 0\.55 %",
        ),
    ],
)
def test_a_body_that_no_tray_holds_is_held_by_ties(changes: dict[str, float], message: str) -> None:
    """The tray's refusal names the measure; the clip has a corner instead."""
    hardware = HARDWARE.replaced(camera=HARDWARE.camera.replaced(**changes))
    assert isinstance(hardware.camera.held_by, Lips)
    with pytest.raises(InputError, match=message):
        hold_body(hardware.camera, hardware.camera.held_by, 4.0, hardware)
    plan = plan_clip(hardware)
    assert plan.tray is None
    assert len(plan.straps_mm) >= 1


def test_a_lens_off_the_middle_is_held_and_a_cable_beyond_the_screws_is_not() -> None:
    aside = HARDWARE.camera.replaced(lens_x_mm=-20.0, width_mm=60.0)
    assert plan_clip(HARDWARE.replaced(camera=aside)).tray is not None
    far = HARDWARE.replaced(camera=HARDWARE.camera.replaced(cable_x_mm=17.0))
    with pytest.raises(InputError, match=r"slot for the cable's tie is \d\.\d mm beyond the screws"):
        plan_clip(far)


def test_a_screw_that_nobody_sells_is_refused() -> None:
    short = HARDWARE.replaced(screw=HARDWARE.screw.replaced(lengths_mm=(8.0, 12.0)))
    assert isinstance(short.camera.held_by, Lips)
    with pytest.raises(InputError, match=r"needs an M3 screw of 12\.1 mm, longer than any in lengths_mm"):
        hold_body(short.camera, short.camera.held_by, 4.0, short)


PHONES = [name for name in BODIES if not read_body(name).has_cable]


@pytest.mark.parametrize("name", PHONES)
def test_the_clip_of_a_phone_does_not_block_its_lens(name: str) -> None:
    """From its lens to that edge, and 2 mm around, the clip does not cover the phone."""
    hardware = connected_to_camera(name)
    camera, body = hardware.camera, body_box(hardware.camera)
    half = camera.lens_ring_mm / 2.0 + 2.0
    over = box((-half, -half, float(body.high[2])), (half, float(body.high[1]) + 50.0, float(body.high[2]) + 50.0))
    assert max(overlap_mm(piece, over) for piece in plan_clip(hardware).pieces) <= 0.0
    # Nearer to that edge and to one end than to the others: a clamp with the lens in its middle would not fit.
    assert body.high[1] < -body.low[1]
    assert abs(body.low[0] + body.high[0]) > camera.width_mm / 2.0


@pytest.mark.parametrize("name", PHONES)
def test_the_clip_of_a_phone_covers_its_port_as_the_guide_says(name: str) -> None:
    """In the middle of the end far from the lens."""
    hardware = connected_to_camera(name)
    body = body_box(hardware.camera)
    end = float(body.low[0]) if -body.low[0] > body.high[0] else float(body.high[0])
    outwards = np.sign(end)
    ends = np.sort([end + 1.0 * outwards, end + 3.0 * outwards])
    y, z = body.centre[1:]
    plug = box((float(ends[0]), float(y) - 4.0, float(z) - 1.5), (float(ends[1]), float(y) + 4.0, float(z) + 1.5))
    assert max(overlap_mm(piece, plug) for piece in plan_clip(hardware).pieces) > 0.0
