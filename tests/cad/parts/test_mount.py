"""Long profiles on a small bed.

The mount: flush with the holder, round the light, stiff enough, and InputError if it cannot be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from build123d import Box, GeomType, Location
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.mount import (
    THINNER_MM,
    MountPlan,
    Placement,
    beam_tilt_deg,
    bending,
    fits,
    halves,
    joint_blocks,
    place_on_bed,
    plan_mount,
    prints,
    profiles,
    thinned,
)
from mirrorcam.cad.parts.part_solids import make_mount
from mirrorcam.cad.parts.truss import FOOT_DEPTH_MM
from mirrorcam.cad.plan.dimension import GENERAL_MM
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import overlap_mm, shifted, volume_mm3
from mirrorcam.cad.plan.seats import keep_outs
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

BED = np.array(HARDWARE.printer.bed_mm[:2])


def straight(length_mm: float, depth_mm: float = 30.0) -> tuple[FloatArray, FloatArray]:
    """A post in four pieces, its outer side to the left."""
    z = np.array([0.0, 0.1, 0.9, 1.0]) * length_mm
    return np.column_stack([np.zeros(4), z]), np.column_stack([np.full(4, -depth_mm), z])


def straight_laid(length_mm: float) -> Placement:
    found = place_on_bed(*straight(length_mm), HARDWARE)
    assert found is not None
    return found


def test_a_profile_that_fits_is_not_rotated() -> None:
    assert straight_laid(200.0).rotation_deg == 0.0


def test_a_profile_longer_than_the_bed_is_rotated() -> None:
    inner, outer = straight(250.0)
    placement = straight_laid(250.0)
    assert placement.cut_mm is None
    assert 0.0 < placement.rotation_deg < 90.0
    band = Polygon([*inner, *outer[::-1]])
    assert fits(band, placement.rotation_deg, BED)
    assert not fits(band, 0.0, BED)
    # Longer than the bed's diagonal minus the depth, it never fits.
    assert straight_laid(300.0).cut_mm is not None


def test_a_profile_that_never_fits_is_cut_where_both_halves_fit() -> None:
    inner, outer = straight(400.0)
    placement = straight_laid(400.0)
    assert placement.cut_mm is not None
    assert placement.cut_mm == pytest.approx(200.0)
    band = Polygon([*inner, *outer[::-1]])
    parts = halves(band, placement.rotation_deg, placement.cut_mm)
    assert [part.area for part in parts] == pytest.approx([200.0 * 30.0] * 2)
    assert all(fits(part, placement.rotation_deg, BED) for part in parts)


def test_a_profile_too_large_for_two_pieces_has_no_placement() -> None:
    assert place_on_bed(*straight(600.0), HARDWARE) is None


def test_a_cut_has_blocks_on_both_sides_at_both_ends() -> None:
    placement = straight_laid(400.0)
    blocks = joint_blocks(placement, 2.4, 50.0, HARDWARE)
    assert len(blocks) == 6
    corners = np.vstack([np.vstack([block.base, block.top]) for block in blocks])
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((-50.0, 50.0))
    assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((-30.0, 0.0))
    # Pins extend by half their length into both pieces.
    assert (200.0 - corners[:, 2].min(), corners[:, 2].max() - 200.0) > (HARDWARE.holder.pin_mm[1] / 2.0,) * 2
    assert all(volume_mm3(block) > 0.0 for block in blocks)
    assert joint_blocks(straight_laid(200.0), 2.4, 50.0, HARDWARE) == []


def test_blocks_stay_on_the_straight_of_a_profile_that_leans() -> None:
    """A level cut meets the far side of a deep profile at its bend, where a block formerly protruded from the skin."""
    lean, depth = np.deg2rad(25.0), 60.0
    along = np.array([-np.sin(lean), np.cos(lean)])
    starts = np.array([(0.0, 0.0), (-depth, -depth * np.tan(lean / 2.0))])
    inner, outer = (
        np.array([(start[0], -60.0), start, start + 90.0 * along, start + 140.0 * along]) for start in starts
    )
    small = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(150.0, 150.0, 220.0)))
    placement = place_on_bed(inner, outer, small)
    assert placement is not None
    corners = np.vstack(
        [np.vstack([block.base, block.top])[:, 1:] for block in joint_blocks(placement, 1.6, 50.0, small)]
    )
    reach = (corners - starts[1]) @ along
    assert reach.min() >= -1e-9
    assert reach.max() <= 90.0 + depth


Planned = tuple[Layout, HolderPlan, ClipPlan, MountPlan]


@pytest.fixture(scope="module")
def planned(default_layout: Layout, device: Device) -> Planned:
    holder, clip = device.holder, plan_clip(HARDWARE)
    return default_layout, holder, clip, plan_mount(default_layout, holder, clip, HARDWARE)


def beside(holder: HolderPlan, mount: MountPlan) -> float:
    """Largest overlap of any piece of the mount with any of the holder's convex solids."""
    solids = (holder.slab, holder.flange, *holder.cores, *holder.fillers, *holder.rims)
    return max(overlap_mm(piece, solid) for piece in mount.pieces for solid in solids)


def test_the_mount_lies_on_the_back_and_enters_nothing(planned: Planned) -> None:
    layout, holder, clip, mount = planned
    assert beside(holder, mount) == pytest.approx(0.0, abs=1e-6)
    for volumes in keep_outs(layout, HARDWARE):
        assert max(overlap_mm(piece, volume) for piece in mount.pieces for volume in volumes) < 0.0
    # The clip's wall touches the slide over its travel; its groove has space for the rib, the last piece but the webs.
    rib = [piece for piece in mount.pieces if len(piece.base) == 3]
    assert len(rib) == 1
    for by in (-clip.travel_mm, 0.0, clip.travel_mm):
        wall = shifted(clip.pieces[0], np.array([0.0, 0.0, by]))
        others = [overlap_mm(piece, wall) for piece in mount.pieces if piece is not rib[0]]
        assert max(others) == pytest.approx(0.0, abs=1e-9)


def test_the_mount_is_wide_enough_for_screws_that_are_off_its_middle(planned: Planned) -> None:
    layout, holder, clip, _ = planned
    aside = holder.rig_from_mount.copy()
    aside[0, 3] += 20.0
    mount = plan_mount(layout, replace(holder, rig_from_mount=aside), clip, HARDWARE)
    outermost = float(np.abs(20.0 + holder.holes_in_mount_mm[:, 0]).max())
    assert mount.half_width_mm >= outermost + HARDWARE.screw.head_mm / 2.0 + HARDWARE.screw.insert_wall_mm


def test_the_made_mount_has_its_face_on_the_holders_back(planned: Planned) -> None:
    _, holder, _, mount = planned
    part = make_mount(mount)
    assert part.is_valid
    assert len(part.solids()) == 1
    away, origin = holder.rig_from_mount[:3, 2], holder.rig_from_mount[:3, 3]
    faces = [
        face
        for face in part.faces().filter_by(GeomType.PLANE)
        if np.array(tuple(face.normal_at())) @ away < -1.0 + 1e-9
        and abs((np.array(tuple(face.center())) - origin) @ away) < 1e-6
    ]
    assert len(faces) == 1
    assert len(faces[0].inner_wires()) == 4
    bounds = part.bounding_box()
    assert pytest.approx(mount.section.width_mm) == bounds.size.X


def test_the_skin_is_thick_round_the_slides_screws_wherever_the_clip_is(planned: Planned) -> None:
    """A ring as wide as a washer round each screw is plastic, as deep as the screw's grip, except in the slot."""
    *_, clip, mount = planned
    part, grip = make_mount(mount), clip.slide.grip_mm
    assert grip == HARDWARE.mount.slide_skin_mm > HARDWARE.mount.skin_mm
    for x, y, z in clip.slide_points:
        for by in (-clip.travel_mm, clip.travel_mm):
            # Between the slot and the washer's edge, on the side away from the roof of the driver's hole.
            probe = Location((x - 3.0, y - grip / 2.0, z + by)) * Box(0.5, grip - 0.1, 0.5)
            assert sum(solid.volume for solid in part.intersect(probe) or []) == pytest.approx(0.25 * (grip - 0.1))


def test_its_screws_meet_the_holders_holes(planned: Planned) -> None:
    _, holder, _, mount = planned
    holes = np.column_stack([holder.holes_in_mount_mm, np.zeros(4), np.ones(4)]) @ holder.rig_from_mount.T
    heads = np.column_stack([mount.holes_in_head_mm, np.zeros(4), np.ones(4)]) @ mount.rig_from_head.T
    np.testing.assert_allclose(heads, holes, atol=1e-9)
    bores = [cut for cut in mount.cuts if isinstance(cut, Bore)]
    for hole in holes[:, :3]:
        on_axis = [
            bore
            for bore in bores
            if np.linalg.norm(np.cross(hole - bore.mouth, bore.axis)) < 1e-9 and bore.travel_mm == 0.0
        ]
        assert sorted(2.0 * bore.radius_mm for bore in on_axis) == pytest.approx([3.4, 7.6])
    assert mount.head.engaged_mm >= HARDWARE.screw.engaged_mm


@pytest.mark.slow
def test_a_stricter_limit_gives_a_stiffer_mount(planned: Planned) -> None:
    layout, holder, clip, mount = planned
    assert 0.0 < mount.tilt_deg <= HARDWARE.mount.tilt_deg
    strict = HARDWARE.replaced(mount=HARDWARE.mount.replaced(tilt_deg=0.7 * mount.tilt_deg))
    stiffer = plan_mount(layout, holder, clip, strict)
    assert stiffer.tilt_deg <= 0.7 * mount.tilt_deg
    assert stiffer.section.depth_mm * stiffer.section.width_mm > mount.section.depth_mm * mount.section.width_mm
    assert beside(holder, stiffer) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_thinner_skins_and_webs_within_their_tolerance_are_stiff_enough(planned: Planned) -> None:
    _, holder, clip, mount = planned
    minus = {wall.minus_mm for wall in mount.walls if wall.text in ("skins", "webs")}
    (thinner,) = minus
    profile = next(each for each in profiles(holder, clip, 30.0, HARDWARE) if each.section == mount.section)

    def tilt_deg(mm: float) -> float:
        section = replace(mount.section, skin_mm=mount.section.skin_mm - mm, web_mm=mount.section.web_mm - mm)
        bent = replace(profile, section=section)
        return bending(bent, holder, clip, mount.load_g, mount.load_at, HARDWARE)[0]

    assert 0.0 < thinner < GENERAL_MM
    assert tilt_deg(thinner) <= HARDWARE.mount.tilt_deg < tilt_deg(thinner + 0.03)


@pytest.mark.slow
def test_the_lightest_stiff_mount_is_chosen(planned: Planned) -> None:
    """It is at least as wide as its screws need; a heavy load leads to more depth before more width."""
    layout, holder, clip, mount = planned
    around = HARDWARE.screw.washer_mm / 2.0 + HARDWARE.fit.free_mm + HARDWARE.screw.insert_wall_mm
    screws = max(float(np.abs(holder.holes_in_mount_mm[:, 0]).max()), clip.slide_x_mm)
    assert mount.half_width_mm == pytest.approx(screws + around, abs=0.5)
    assert mount.section.depth_mm < FOOT_DEPTH_MM + 12.0
    strict = HARDWARE.replaced(mount=HARDWARE.mount.replaced(tilt_deg=0.7 * mount.tilt_deg))
    taken = plan_mount(layout, holder, clip, strict)
    volumes = {profile.section: profile.volume_mm3 for profile in profiles(holder, clip, 30.0, strict)}
    assert len({section.width_mm for section in volumes}) > 3
    # No lighter one is stiff enough.
    lighter = [
        profile
        for profile in profiles(holder, clip, 30.0, strict)
        if profile.volume_mm3 < volumes[taken.section] and prints(profile, holder, strict)
    ]
    limit = strict.mount.tilt_deg
    as_beams = [profile for profile in lighter if beam_tilt_deg(profile, mount.load_g, mount.load_at) <= limit]
    assert as_beams
    bent = [
        bending(thinned(profile, THINNER_MM), holder, clip, mount.load_g, mount.load_at, strict)[0]
        for profile in as_beams
    ]
    assert min(bent) > limit >= taken.tilt_deg


def test_a_mount_that_no_section_makes_stiff_is_refused_with_its_tilt(planned: Planned) -> None:
    layout, holder, clip, _ = planned
    soft = HARDWARE.replaced(printer=HARDWARE.printer.replaced(plastic_mpa=20.0))
    with pytest.raises(
        InputError, match=r"mirrors tilt by \d\.\d+ deg under their holder's \d+ g .* at most 0\.05 deg"
    ):
        plan_mount(layout, holder, clip, soft)


def test_the_back_stays_level_with_the_mount_where_mirrors_are_turned_sideways(planned: Planned) -> None:
    layout, _, clip, _ = planned
    angle = np.deg2rad(2.0)
    rotation_2d = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    turned = layout.replaced(
        mirrors=tuple(
            type(mirror)(
                virtual_centre_in_rig_mm=rotation_2d @ mirror.virtual_centre_in_rig_mm,
                outline_in_rig_mm=mirror.outline_in_rig_mm @ rotation_2d.T,
            )
            for mirror in layout.mirrors
        ),
        metrics={},
        verdict={},
    )
    holder = plan_holder(turned, HARDWARE)
    assert holder.rig_from_mount[0, 2] == 0.0
    mount = plan_mount(turned, holder, clip, HARDWARE)
    assert mount.tilt_deg <= HARDWARE.mount.tilt_deg
    assert beside(holder, mount) < 1e-6


@pytest.mark.slow
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(1, 4), st.integers(2, 4), st.floats(45.0, 110.0), st.sampled_from([1.0, 2.0, 3.0]))
def test_any_parabola_gets_a_mount_clear_of_its_light(
    make_parabola: Callable[..., Layout], rows: int, cols: int, scale_mm: float, thickness_mm: float
) -> None:
    layout = make_parabola(rows, cols, scale_mm=scale_mm, thickness_mm=thickness_mm, gap_mm=2.0)
    holder, clip = plan_holder(layout, HARDWARE), plan_clip(HARDWARE)
    mount = plan_mount(layout, holder, clip, HARDWARE)
    assert mount.tilt_deg <= HARDWARE.mount.tilt_deg
    assert mount.light == ()
    assert beside(holder, mount) < 1e-6


@pytest.mark.slow
def test_a_mount_that_no_cut_fits_to_the_bed_is_refused_with_its_size(default_layout: Layout, device: Device) -> None:
    holder, clip = device.holder, plan_clip(HARDWARE)
    small = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(90.0, 90.0, 250.0)))
    with pytest.raises(
        InputError, match=r"mount is \d+ x \d+ mm in profile .* bed of 90 x 90 mm in at most two pieces"
    ):
        plan_mount(default_layout, holder, clip, small)
