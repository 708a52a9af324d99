"""Boards on posts: every screw in its post, the board clear of the wall, and no slope outside the slide.

The clip: common properties, the slide, the groove, and the slots for the cable's tie.
"""

from __future__ import annotations

import numpy as np
import pytest
from build123d import Box, Location

from mirrorcam.cad.assembly.catalogue import Y_UP, with_base_at
from mirrorcam.cad.assembly.components import camera_solid, tessellated
from mirrorcam.cad.checks.clashes import overlap_mm3
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.part_checks import overhangs
from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import REST_DEG, REST_TO_MM, ClipPlan, plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.parts.ties import TIE_THICK_MM
from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.cad.plan.fasteners import Bore, head_space_mm
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.prisms import box, corners_of, overlap_mm
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.camera_library import camera_names, read_body
from tests.nightly import a_few

BOARDS = [name for name in camera_names() if read_body(name).held_by.kind == "board"]


@pytest.mark.parametrize("name", a_few(3, BOARDS))
@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_a_board_rests_on_its_posts_and_its_clip_prints_on_its_slide(name: str, kind: str) -> None:
    hardware = HARDWARE.replaced(camera=read_body(name), screw=HARDWARE.screw.replaced(kind=kind))
    plan = plan_clip(hardware)
    mesh, camera = tessellated(make_clip(plan)), solid_of(tessellated(camera_solid(hardware.camera)))
    clip = solid_of(mesh)
    assert overlap_mm3(clip, camera) == 0.0
    assert clip.min_gap(camera, 1.0) < 1e-4
    mesh.apply_transform(with_base_at(Y_UP, plan.slide_y_mm))
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-6)
    hanging, _, longest = overhangs(mesh, solid_of(mesh), hardware.printer)
    assert (hanging, longest <= hardware.printer.bridge_mm) == (0.0, True)


def test_every_hole_of_the_board_has_its_own_in_a_post() -> None:
    hardware = HARDWARE.replaced(camera=read_body("board_38"))
    plan, body = plan_clip(hardware), body_box(hardware.camera)
    assert hardware.camera.held_by.kind == "board"
    pilots = [cut for cut in plan.cuts if isinstance(cut, Bore) and cut.radius_mm == pytest.approx(0.8)]
    np.testing.assert_allclose([cut.mouth[:2] for cut in pilots], hardware.camera.held_by.holes_mm)
    np.testing.assert_allclose([screw.head[2] for screw in plan.screws], body.high[2])
    assert plan.nest is None


def test_a_heavy_lens_rests_on_two_faces_that_its_tie_draws_it_onto() -> None:
    """Both faces are half the play of the board's holes off the barrel, and clear of the board and its screws."""
    hardware = HARDWARE.replaced(camera=read_body("pi_hq_cs"))
    body, plan = hardware.camera, plan_clip(hardware)
    assert body.held_by.kind == "board"
    assert body.rest_mm is not None
    assert len(plan.pieces) == len(plan_clip(without_rest()).pieces) + 2
    left, right = plan.pieces[-2:]
    for piece, side in ((left, -1.0), (right, 1.0)):
        normals, offsets = piece.half_spaces
        towards = np.array([-side * np.sin(np.deg2rad(REST_DEG)), np.cos(np.deg2rad(REST_DEG)), 0.0])
        (face,) = np.flatnonzero(normals @ towards > 1.0 - 1e-9)
        assert -offsets[face] == pytest.approx(body.lens_ring_mm / 2.0 + body.held_by.play_mm / 2.0)
        corners = np.vstack([piece.base, piece.top])
        assert corners[:, 2].min() - body.pupil_behind_front_mm == pytest.approx(body.rest_mm[0])
        assert corners[:, 2].max() == pytest.approx(plan.top_mm)
        heads = np.array(body.held_by.holes_mm) - [side * REST_TO_MM, 0.0]
        assert np.abs(heads[:, 0]).min() > 0.95 * body.held_by.screw_mm


def without_rest() -> Hardware:
    return HARDWARE.replaced(camera=read_body("pi_hq_cs").replaced(rest_mm=None))


def test_a_barrel_that_would_be_inside_the_wall_is_refused() -> None:
    wide = read_body("pi_hq_cs").replaced(lens_ring_mm=40.0)
    with pytest.raises(InputError, match=r"rest for the lens would start \d+\.\d mm inside the clip's wall"):
        plan_clip(HARDWARE.replaced(camera=wide))


@pytest.fixture(params=["c920", "board_38", "d435"])
def hardware(request: pytest.FixtureRequest) -> Hardware:
    return HARDWARE.replaced(camera=read_body(request.param))


def deepest(plan: ClipPlan, solid: Frustum) -> float:
    return max(overlap_mm(piece, solid) for piece in plan.pieces)


@pytest.mark.parametrize("name", camera_names())
def test_no_clip_enters_its_cameras_box_further_than_round_ends_allow(name: str) -> None:
    camera = read_body(name)
    plan, body = plan_clip(HARDWARE.replaced(camera=camera)), body_box(camera)
    # Wedges of a V are in the corners next to round ends.
    assert deepest(plan, body.solid) <= 0.5 * camera.end_radius_mm + 1e-9
    assert corners_of(plan.pieces)[:, 2].max() == pytest.approx(plan.top_mm)
    assert corners_of(plan.pieces)[:, 2].min() == pytest.approx(plan.bottom_mm)


def test_the_made_clip_is_one_solid_as_wide_as_planned(hardware: Hardware) -> None:
    plan = plan_clip(hardware)
    part = make_clip(plan)
    assert part.is_valid
    assert len(part.solids()) == 1
    bounds, corners = part.bounding_box(), corners_of(plan.pieces)
    assert pytest.approx((corners[:, 0].min(), corners[:, 0].max())) == (bounds.min.X, bounds.max.X)
    assert pytest.approx(plan.slide_y_mm) == bounds.min.Y
    assert pytest.approx((plan.bottom_mm, plan.top_mm)) == (bounds.min.Z, bounds.max.Z)


def test_a_tie_passes_both_slots_behind_the_wall_and_over_the_mounts_rib(hardware: Hardware) -> None:
    """Solids of a tie, through both slots and along the outer face, above the rib; and of the cable between them."""
    plan, mount = plan_clip(hardware), hardware.mount
    part = make_clip(plan)
    left, right, z = plan.tie_mm
    wide, thick = mount.tie_mm
    over_rib = plan.slide_y_mm + plan.rib_mm
    for x in (left, right):
        leg = Location((x, plan.slide_y_mm, z)) * Box(thick, 60.0, wide)
        assert (part.intersect(leg) or []) == []
    behind = Location(((left + right) / 2.0, over_rib + TIE_THICK_MM / 2.0, z)) * Box(right - left, TIE_THICK_MM, wide)
    assert (part.intersect(behind) or []) == []
    cable = hardware.camera.cable_mm / 2.0
    assert left + thick / 2.0 <= hardware.camera.cable_x_mm - cable + 1e-9
    assert right - thick / 2.0 >= hardware.camera.cable_x_mm + cable - 1e-9
    # It pulls on plastic: the wall over the hollow supports it.
    web = Location(((left + right) / 2.0, over_rib + TIE_THICK_MM + 1.5, z)) * Box(0.5, 0.5, 0.5)
    assert sum(solid.volume for solid in part.intersect(web) or []) == pytest.approx(0.125)


@pytest.mark.parametrize("name", camera_names())
def test_the_cable_leaves_the_camera_past_the_clip(name: str) -> None:
    """Straight back for 20 mm, and from there to the tie; for a body also on its path in, from the scene."""
    hardware = HARDWARE.replaced(camera=read_body(name))
    plan, camera = plan_clip(hardware), hardware.camera
    if plan.nest is None:
        pytest.skip("the cable of a board passes a hole, which its clip's test shows")
    half, x, middle = camera.cable_mm / 2.0, camera.cable_x_mm, body_box(camera).centre[1]
    back = float(body_box(camera).low[2])
    assert deepest(plan, box((x - half, middle - half, back - 20.0), (x + half, middle + 80.0, back))) < 1e-9


def test_the_drawing_dimensions_every_hole() -> None:
    plan = plan_clip(HARDWARE)
    bores = [each for each in plan.dimensions if isinstance(each, Hole)]
    assert len(bores) == 4 + 2 * 2


@pytest.mark.parametrize("name", camera_names())
def test_the_slides_screws_are_in_two_rows_wherever_the_wall_is_high_enough(name: str) -> None:
    """Each with its insert within the wall, and a wall of plastic between the drivers' holes."""
    hardware = HARDWARE.replaced(camera=read_body(name))
    plan, screw = plan_clip(hardware), hardware.screw
    around = screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    apart = 2.0 * (plan.travel_mm + head_space_mm(hardware)) + hardware.printer.wall_mm
    rows = np.array(plan.slide_z_mm)
    assert plan.bottom_mm + around <= rows.min() + 1e-9
    assert rows.max() - 1e-9 <= plan.top_mm - around
    assert (np.diff(rows) >= apart - 1e-9).all()
    assert len(rows) == 2 or plan.top_mm - plan.bottom_mm - 2.0 * around < apart
    assert len(rows) == 2 or plan.nest is None
    assert plan.slide_points.shape == (2 * len(rows), 3)
    np.testing.assert_allclose(plan.slide_centre, [0.0, plan.slide_y_mm, rows.mean()], atol=1e-12)


def test_a_low_wall_has_one_row_of_screws_in_its_middle() -> None:
    low = plan_clip(HARDWARE.replaced(camera=read_body("pi_camera_3")))
    assert low.slide_z_mm == pytest.approx([(low.bottom_mm + low.top_mm) / 2.0])
    assert len(plan_clip(HARDWARE).slide_z_mm) == 2


def test_a_longer_rib_makes_the_tie_pass_deeper() -> None:
    deeper = HARDWARE.replaced(clip=HARDWARE.clip.replaced(rib_mm=3.0))
    assert plan_clip(deeper).rib_mm == 3.0
    assert tie_depth(plan_clip(deeper)) > tie_depth(plan_clip(HARDWARE))


def tie_depth(plan: ClipPlan) -> float:
    """Depth of the hollow for the tie in the wall."""
    hollow = plan.cuts[-1]
    assert isinstance(hollow, Frustum)
    return float(corners_of([hollow])[:, 1].max()) - plan.slide_y_mm


def test_the_tie_round_a_lens_has_slots_beside_its_rest_clear_of_the_slides_screws() -> None:
    hardware = HARDWARE.replaced(camera=read_body("pi_hq_cs"))
    body, plan = hardware.camera, plan_clip(hardware)
    assert body.rest_mm is not None
    left, right, hollow = plan.cuts[-3:]
    assert isinstance(left, Frustum)
    assert isinstance(right, Frustum)
    assert isinstance(hollow, Frustum)
    for slot, side in ((left, -1.0), (right, 1.0)):
        low, high = np.vstack([slot.base, slot.top]).min(axis=0), np.vstack([slot.base, slot.top]).max(axis=0)
        assert np.abs([low[0], high[0]]).min() >= REST_TO_MM + hardware.printer.wall_mm / 2.0 - 1e-9
        assert np.abs([low[0], high[0]]).max() < plan.slide_x_mm - hardware.screw.insert_hole_mm / 2.0
        assert side * low[0] > 0.0
        assert body.rest_mm[0] < (low[2] + high[2]) / 2.0 - body.pupil_behind_front_mm < body.rest_mm[1]
    assert np.ptp(np.vstack([hollow.base, hollow.top])[:, 0]) == pytest.approx(
        np.ptp(np.vstack([left.base, right.base, left.top, right.top])[:, 0])
    )
