"""The plan of a complete device: the plans of all its parts, and the joints between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold

from mirrorcam.cad.backs.back import Back
from mirrorcam.cad.backs.own_back import require_own
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan, plan_screwed_holder
from mirrorcam.cad.holder.stray_light import MAX_STRAY_LIGHT, stray_light
from mirrorcam.cad.mirrors.stock_sheets import require_cuttable
from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.coupon import CouponPlan, plan_coupon, spacer_mm
from mirrorcam.cad.parts.dust_cover import CoverPlan, plan_cover
from mirrorcam.cad.parts.mount import MountPlan, plan_mount
from mirrorcam.cad.plan.back_table import FileBack
from mirrorcam.cad.plan.device_names import CLIP, HOLDER, MOUNT
from mirrorcam.cad.plan.fasteners import with_holes_for_screws
from mirrorcam.cad.plan.hardware import Hardware, require_same_camera
from mirrorcam.cad.plan.part_plan import Connection
from mirrorcam.cad.plan.prisms import box, overlap_mm, prism_along_z, require_clear_of_light, shifted
from mirrorcam.cad.plan.seats import Frustum, keep_outs, mirror_prism
from mirrorcam.cad.plan.threads import THREADS
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

# Number of steps of each move of the dust cover at which clashes with the camera are tested.
COVER_STEPS = 8
# How far the baffle may stand outside its place in the table, in the order in which they are tried.
BAFFLE_SHIFTS_MM = (0.0, 0.8, 1.8, 3.3)
# Number of sides of the prism around a round lens.
BARREL_SIDES = 24
# What to do where a camera stands in the light of a layout.
OTHER_LAYOUT = (
    "design for this camera, which keeps its body and lens clear (mirrorcam design --camera NAME|FILE), with mirrors "
    "farther from it (--scale-mm) if that does not suffice"
)


@dataclass(frozen=True, eq=False)
class Device:
    """The plans of all printed parts of a layout, in the rig frame, mm.

    Made by `plan_device`; compared by identity, so that it can be a key of caches.
    """

    layout: Layout
    hardware: Hardware
    holder: HolderPlan
    mount: MountPlan
    clip: ClipPlan
    back: Back
    coupon: CouponPlan
    cover: CoverPlan | None

    @property
    def level_from_rig(self) -> FloatArray:
        """The rotation (3, 3) from the rig frame to right, down and forward as the device stands."""
        right, forward, up = self.back.rig_from_stand.T
        return np.array([right, -up, forward])

    @property
    def mirror_carriers(self) -> tuple[CarrierPlan, ...]:
        """The carriers of the mirrors, in the layout's order; none if mirrors are glued to the holder."""
        return self.holder.carriers if isinstance(self.holder, ScrewedHolderPlan) else ()


def plan_device(layout: Layout, hardware: Hardware) -> Device:
    """Plan every part of a device.

    Parameters
    ----------
    layout : Layout
        Camera and mirrors.
    hardware : Hardware
        All dimensions that do not follow from the layout.

    Returns
    -------
    Device
        The plans of all parts; no solid is made yet.

    Raises
    ------
    InputError
        If the device cannot be made: a part would block light, a part cannot be printed, or a mirror cannot be cut. The
        message gives the dimension.
    """
    hardware = with_holes_for_screws(hardware)
    require_same_camera(layout.camera, hardware.camera)
    _require_known_screws(hardware)
    require_cuttable(layout, hardware.cutting)
    if isinstance(hardware.back, FileBack):
        require_own(hardware.back)
    clip = plan_clip(hardware)
    light = keep_outs(layout, hardware)
    # The camera's cones end in the pupil, inside the camera.
    beams = [[pocket, beam] for pocket, _, beam in light]
    require_clear_of_light("camera", camera_boxes(hardware), layout, beams, OTHER_LAYOUT)
    require_clear_of_light("camera's lens", lens_barrels(hardware), layout, beams, OTHER_LAYOUT)
    require_clear_of_light("camera clip", over_travel(clip.pieces, clip.travel_mm), layout, light, OTHER_LAYOUT)
    # The holder is planned last among these, since it takes longest: a minute for large layouts.
    holder = _plan_dark_holder(layout, hardware)
    mount = plan_mount(layout, holder, clip, hardware)
    back = plan_back(clip, mount, hardware, tuple(volume for volumes in light for volume in volumes))
    for part in back.parts:
        require_clear_of_light(part.title.lower(), part.plan.hulls, layout, light)
    for support in back.supports:
        require_clear_of_light(support.name, support.solids, layout, light)
    strip_mm = holder.adjuster.gap_mm if isinstance(holder, ScrewedHolderPlan) else spacer_mm(layout, hardware)
    return Device(
        layout=layout,
        hardware=hardware,
        holder=holder,
        mount=mount,
        clip=clip,
        back=back,
        coupon=plan_coupon(layout, hardware, strip_mm),
        cover=_cover(layout, holder, mount, (*camera_boxes(hardware), *clip.pieces), hardware),
    )


def _plan_dark_holder(layout: Layout, hardware: Hardware) -> HolderPlan:
    """The holder whose baffle stands only as far outside the mirrors as it must, to hide the surroundings.

    The farther outside, the higher it can be below the light that leaves the mirrors, and the less the camera sees past
    it.
    """
    plan = plan_screwed_holder if hardware.holder.mirrors == "screws" else plan_holder
    mirrors = [Manifold.hull_points(np.vstack([solid.base, solid.top])) for solid in map(mirror_prism, layout.mirrors)]
    for shift_mm in BAFFLE_SHIFTS_MM:
        out_mm = hardware.holder.shade_out_mm + shift_mm
        holder = plan(layout, hardware.replaced(holder=hardware.holder.replaced(shade_out_mm=out_mm)))
        if stray_light(layout, body_of(PlanarCsg(), holder), mirrors) <= MAX_STRAY_LIGHT:
            break
    return holder


def _require_known_screws(hardware: Hardware) -> None:
    """Raise InputError if the thread of a camera board's screws is not in the table."""
    camera = hardware.camera
    diameters = sorted(thread.diameter_mm for thread in THREADS.values())
    if isinstance(camera.held_by, BoardHoles) and camera.held_by.screw_mm not in diameters:
        raise InputError(
            f"camera body {camera.name}: held_by.screw_mm is {camera.held_by.screw_mm:g}, expected one of "
            f"{', '.join(f'{diameter:g}' for diameter in diameters)}"
        )


def _cover(
    layout: Layout, holder: HolderPlan, mount: MountPlan, camera: tuple[Frustum, ...], hardware: Hardware
) -> CoverPlan | None:
    """The dust cover, if it is requested, fits the bed, and clears the camera in its clip (`camera`) when removed."""
    cover = plan_cover(layout, holder, mount, hardware) if hardware.holder.dust_cover else None
    if cover is None:
        return None
    fractions = np.linspace(0.0, 1.0, COVER_STEPS + 1)[:, None]
    shifts = np.vstack([fractions * cover.way_mm[0], cover.way_mm[0] + fractions * cover.way_mm[1]])
    clashes = (
        overlap_mm(shifted(cover.outer, shift), solid) > 0.0
        for shift in shifts
        for solid in (*camera, *lens_barrels(hardware))
    )
    return None if any(clashes) else cover


def camera_boxes(hardware: Hardware) -> tuple[Frustum, ...]:
    """Boxes around the camera's body and hinge."""
    camera, body = hardware.camera, body_box(hardware.camera)
    boxes = [body.solid]
    if camera.hinge_mm:
        half_width, side_y, back_z = camera.hinge_mm / 2.0, float(body.high[1]), float(body.low[2])
        boxes.append(
            box(
                (-half_width, side_y, back_z),
                (half_width, side_y + camera.hinge_from_back_mm / 2.0, back_z + camera.hinge_from_back_mm),
            )
        )
    return tuple(boxes)


def lens_barrels(hardware: Hardware) -> tuple[Frustum, ...]:
    """A prism around the camera's lens ring or barrel in front of its body; none if nothing protrudes."""
    camera = hardware.camera
    if not camera.lens_protrusion_mm:
        return ()
    angles = 2.0 * np.pi * np.arange(BARREL_SIDES) / BARREL_SIDES
    radius, front = camera.lens_ring_mm / 2.0 / np.cos(np.pi / BARREL_SIDES), camera.pupil_behind_front_mm
    circle = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return (prism_along_z(circle, front, front + camera.lens_protrusion_mm),)


def over_travel(solids: tuple[Frustum, ...], travel_mm: float) -> tuple[Frustum, ...]:
    """Solids at both ends and at mid-travel along z."""
    return tuple(
        shifted(solid, np.array([0.0, 0.0, shift])) for shift in (-travel_mm, 0.0, travel_mm) for solid in solids
    )


def connections(device: Device) -> tuple[Connection, ...]:
    """The joints between the parts, starting from the holder."""
    mount, clip, back = device.mount, device.clip, device.back
    back_frame = device.holder.rig_from_mount
    downwards = mount.foot.rig_from_stand @ np.diag([1.0, -1.0, -1.0])
    foot = rigid(downwards, mount.foot.screws_in_rig.mean(axis=0))
    back_foot = rigid(downwards, back.foot_heads.mean(axis=0) + back.foot.grip_mm * mount.foot.up_in_rig)
    # x along the slide, z towards the clip.
    slide_axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T
    slide = rigid(slide_axes, mount.slide)
    clip_slide = rigid(slide_axes, clip.slide_centre)
    return (
        Connection("back", HOLDER, MOUNT, back_frame, mount.rig_from_head @ np.diag([1.0, -1.0, -1.0, 1.0])),
        Connection("slide", MOUNT, CLIP, slide, clip_slide, clip.travel_mm),
        Connection("foot", MOUNT, back.parts[0].name, foot, back_foot),
        *back.connections,
    )
