"""The complete device: the joints of its parts, and InputError for devices that cannot be made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from build123d import Box, Location, RigidJoint
from manifold3d import Manifold

from benchmarks.devices import CAMERA_700
from mirrorcam.cad.assembly.device_plan import Device, connections, lens_barrels, plan_device
from mirrorcam.cad.backs.back import Back, Support
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.stray_light import MAX_STRAY_LIGHT, stray_light
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import BACKS, back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.prisms import box, overlap_mm
from mirrorcam.cad.plan.seats import Frustum, keep_outs, mirror_prism
from mirrorcam.core.errors import InputError
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout


@pytest.mark.parametrize("kind", list(BACKS))
def test_parts_are_joined_where_they_already_stand(kind: str, device: Device) -> None:
    """The frames of a joint come from the plans of both parts: joining by build123d moves nothing."""
    on = device.hardware.replaced(back=back_of(kind))
    joined = connections(replace(device, back=(back := plan_back(device.clip, device.mount, on))))
    assert {joint.parent for joint in joined} | {joint.child for joint in joined} == {
        "mirror_holder",
        "mount",
        "camera_clip",
        *(part.name for part in back.parts),
    }
    for joint in joined:
        np.testing.assert_allclose(joint.rig_from_parent_joint, joint.rig_from_child_joint, atol=1e-9)
        assert np.linalg.det(joint.rig_from_child_joint[:3, :3]) == pytest.approx(1.0)
        parent, child = Box(1.0, 2.0, 3.0), Box(3.0, 2.0, 1.0)
        frames = [location(joint.rig_from_parent_joint), location(joint.rig_from_child_joint)]
        RigidJoint("a", parent, frames[0]).connect_to(RigidJoint("b", child, frames[1]))
        assert child.location.position.length < 1e-9
        assert np.abs(np.array(tuple(child.location.orientation))).max() < 1e-9


def location(frame: np.ndarray) -> Location:
    from build123d import Plane

    return Plane(origin=tuple(frame[:3, 3]), x_dir=tuple(frame[:3, 0]), z_dir=tuple(frame[:3, 2])).location


def test_the_clip_slides_along_the_lens_axis(device: Device) -> None:
    (slide,) = [joint for joint in connections(device) if joint.slides_mm]
    np.testing.assert_allclose(slide.rig_from_child_joint[:3, 0], [0.0, 0.0, 1.0])
    assert slide.slides_mm == HARDWARE.clip.travel_mm


def test_a_camera_that_stands_in_the_light_is_refused(default_layout: Layout) -> None:
    camera = HARDWARE.camera.replaced(pupil_behind_front_mm=45.0)
    with pytest.raises(InputError, match=r"light of mirror \d-\d enters the camera by \d+\.\d mm"):
        plan_device(default_layout, HARDWARE.replaced(camera=camera))


def test_a_lens_that_stands_in_the_light_is_refused_until_the_layout_is_designed_for_it(
    default_layout: Layout,
) -> None:
    hardware = HARDWARE.replaced(camera=CAMERA_700.body)
    with pytest.raises(InputError, match=r"enters the camera's lens by 8\.\d mm.*: design for this camera"):
        plan_device(default_layout, hardware)
    layout = design(DesignSpec(camera=CAMERA_700.camera))
    (barrel,) = lens_barrels(hardware)
    beams = [volumes[2] for volumes in keep_outs(layout, hardware)]
    assert -5.0 < max(overlap_mm(barrel, beam) for beam in beams) < 0.0


def test_the_baffle_stands_farther_outside_where_the_camera_would_see_past_it() -> None:
    layout = design(DesignSpec(rows=1, cols=2))
    mirrors = [Manifold.hull_points(np.vstack([solid.base, solid.top])) for solid in map(mirror_prism, layout.mirrors)]

    def seen_past(holder: HolderPlan) -> float:
        return stray_light(layout, body_of(PlanarCsg(), holder), mirrors)

    assert seen_past(plan_holder(layout, HARDWARE)) > MAX_STRAY_LIGHT
    assert seen_past(plan_device(layout, HARDWARE).holder) <= MAX_STRAY_LIGHT


def test_a_clip_that_would_slide_into_the_light_is_refused(default_layout: Layout) -> None:
    hardware = HARDWARE.replaced(clip=HARDWARE.clip.replaced(travel_mm=40.0))
    with pytest.raises(InputError, match=r"enters the camera clip by \d+\.\d mm"):
        plan_device(default_layout, hardware)


@pytest.mark.slow
def test_the_clip_knows_no_layout(device: Device, make_parabola: Callable[..., Layout]) -> None:
    from mirrorcam.cad.assembly.catalogue import parts_of

    other = plan_device(make_parabola(2, 2, scale_mm=60.0), HARDWARE)
    same = {"camera_clip"}
    first, second = ({part.name: part.identity for part in parts_of(d)} for d in (device, other))
    assert {name for name in first if first[name] == second[name]} == same


def test_a_mirror_narrower_than_its_sheet_is_refused(make_flat_pair: Callable[..., Layout]) -> None:
    with pytest.raises(
        InputError, match=r"mirror 0-0 is 2\.50 mm across, expected at least 4 times its thickness, 12 mm"
    ):
        plan_device(make_flat_pair(gap_mm=5.0, height_mm=2.5, thickness_mm=3.0), HARDWARE)


@pytest.mark.slow
def test_a_support_in_the_light_is_refused(default_layout: Layout, monkeypatch: pytest.MonkeyPatch) -> None:
    def on_a_wall(clip: ClipPlan, mount: MountPlan, hardware: Hardware, light: tuple[Frustum, ...]) -> Back:
        wall = Support("wall", (box((-50.0, 60.0, -200.0), (50.0, 70.0, 100.0)),))
        return replace(plan_back(clip, mount, hardware, light), supports=(wall,))

    monkeypatch.setattr("mirrorcam.cad.assembly.device_plan.plan_back", on_a_wall)
    with pytest.raises(InputError, match=r"light of mirror \d-\d enters the wall by \d+\.\d mm"):
        plan_device(default_layout, HARDWARE)


@pytest.mark.slow
def test_a_cover_is_planned_on_request_unless_the_camera_leaves_no_way_off(
    default_layout: Layout, device: Device
) -> None:
    """Over a high hood it would collide with the camera when removed."""
    assert device.cover is None
    for hood_mm in (0.0, 25.0):
        holder = HARDWARE.holder.replaced(dust_cover=True, hood_mm=hood_mm)
        planned = plan_device(default_layout, HARDWARE.replaced(holder=holder))
        assert (planned.cover is None) == (hood_mm > 0.0)


@pytest.mark.slow
def test_a_cover_that_would_be_drawn_into_a_lens_barrel_is_left_out(default_layout: Layout, device: Device) -> None:
    """The barrel is between the mirrors and the camera's body, past which the cover slides off."""
    body = device.hardware.camera
    covered = HARDWARE.replaced(holder=HARDWARE.holder.replaced(dust_cover=True))
    assert plan_device(default_layout, covered.replaced(camera=body.replaced(lens_protrusion_mm=0.0))).cover
    slender = body.replaced(lens_ring_mm=10.0, lens_protrusion_mm=body.pupil_behind_front_mm + 25.0)
    assert plan_device(default_layout, covered.replaced(camera=slender)).cover is None
    assert lens_barrels(HARDWARE.replaced(camera=body.replaced(lens_protrusion_mm=0.0))) == ()


def test_screws_of_an_unknown_thread_are_refused_with_those_that_are_known(default_layout: Layout) -> None:
    board = read_body("board_38")
    assert isinstance(board.held_by, BoardHoles)
    odd = board.replaced(held_by=board.held_by.replaced(screw_mm=1.8))
    with pytest.raises(InputError, match=r"held_by\.screw_mm is 1\.8, expected one of 1\.6, 2, 2\.5, 3"):
        plan_device(default_layout, HARDWARE.replaced(camera=odd))
