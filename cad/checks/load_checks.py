"""Checks of load-bearing features: the clip's six contacts and leaf springs, and the adapter that carries the device.

They cover the camera's repeatability in its clip, the device's stability, the engagement of a tripod's screw, and the
stress in the adapter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import manifold3d
import numpy as np

from mirrorcam.cad.assembly.components import item_names
from mirrorcam.cad.backs.back import LOAD_FACTOR, Back, Stand, above_desk_mm
from mirrorcam.cad.backs.blocks import TRIPOD
from mirrorcam.cad.parts.camera_box import GRAVITY_N_PER_KG, body_box, min_contact_n
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.corner_clip import MIN_ENGAGED
from mirrorcam.cad.parts.reclamping import repeatability
from mirrorcam.cad.plan.device_names import CLIP
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import MassProperties, PurchasedItem
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.layout import Layout

# Upper limit of measured gaps.
MAX_GAP_MM = 5.0


def check_nest(clip: ClipPlan, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """Check that the screws press a body against all six contacts without overstraining their leaf springs.

    Parameters
    ----------
    clip : ClipPlan
        The clip; a clip for a board has neither contacts nor leaf springs.
    layout : Layout
        Camera and mirrors, for the motion of sub-images.
    hardware : Hardware
        The camera's mass, the acceleration that the nest withstands, and the plastic.

    Returns
    -------
    dict of str to Metric
        The smallest force at any contact under that acceleration after 1000 h, with all tolerances against it, the
        largest strain of a leaf spring, and the screws' forces. For bodies and boards, the standard deviations of
        re-clamping.
    """
    repeats = repeatability(clip, layout, hardware)
    figures = {
        "reclamped_mm": (repeats.shift_mm, "mm", 4),
        "reclamped_deg": (repeats.rotation_deg, "deg", 4),
        "reclamped_px": (repeats.image_px, "px", 2),
        "reclamped_between_views_px": (repeats.between_views_px, "px", 3),
    }
    reclamped = {
        f"{CLIP}.{name}": Metric(value=round(value, digits), unit=unit)
        for name, (value, unit, digits) in figures.items()
    }
    engaged = [screw.engaged_mm / thread_of(screw.size).diameter_mm for screw in clip.screws if screw.engaged_mm]
    if engaged:
        reclamped[f"{CLIP}.camera_thread"] = Metric(
            value=round(min(engaged), 2), unit="diameters", limit=MIN_ENGAGED, lower_is_better=False
        )
    if clip.tray is None:
        return reclamped
    printer, camera = hardware.printer, hardware.camera
    weight = camera.mass_g / 1000.0 * GRAVITY_N_PER_KG * hardware.clip.shaken_g
    centre = body_box(camera).centre
    min_force = min_contact_n(clip.tray, centre, weight, printer.plastic_mpa, printer.plastic_creep)
    forces = [screw.leaf.force_n(printer.plastic_mpa) for screw in clip.tray.screws]
    strain = max(screw.leaf.strain(printer.plastic_mpa) for screw in clip.tray.screws)
    return {
        f"{CLIP}.contact_n": Metric(value=round(min_force, 2), unit="N", limit=0.0, lower_is_better=False),
        f"{CLIP}.leaf_strain": Metric(value=round(strain, 5), unit="", limit=printer.plastic_strain),
        f"{CLIP}.back_screw_n": Metric(value=round(forces[0], 1), unit="N"),
        f"{CLIP}.end_screw_n": Metric(value=round(forces[1], 1), unit="N"),
        **reclamped,
    }


def check_rest(
    clip: manifold3d.Manifold | None, camera: manifold3d.Manifold | None, hardware: Hardware
) -> dict[str, Metric]:
    """Check that the play of a board's holes lets a tie pull its lens onto the clip's rest, which supports the lens.

    Parameters
    ----------
    clip, camera : Manifold or None
        The solids in the device, in the rig frame, mm; None if invalid.
    hardware : Hardware
        The camera's body; without `rest_mm` there is nothing to check.

    Returns
    -------
    dict of str to Metric
        The gap between clip and barrel above the board; `MAX_GAP_MM` if a solid is invalid.
    """
    body = hardware.camera
    if body.rest_mm is None or not isinstance(body.held_by, BoardHoles):
        return {}
    # Posts and board end below this height.
    height = body.pupil_behind_front_mm + body.rest_mm[0] / 2.0
    gap = MAX_GAP_MM
    if clip is not None and camera is not None:
        above = [solid.trim_by_plane((0.0, 0.0, 1.0), height) for solid in (clip, camera)]
        gap = min(float(above[0].min_gap(above[1], MAX_GAP_MM)), MAX_GAP_MM)
    return {f"{CLIP}.rest_gap_mm": Metric(value=round(gap, 3), unit="mm", limit=round(body.held_by.play_mm, 3))}


STANDARD_GRAVITY = 9.80665
# Stress that a print bears across its layers for years: a sixth of the short-term strength, about 30 MPa for PLA
# (Kuznetsov et al., Strength of PLA components fabricated with fused deposition technology, Polymers 10, 2018).
STRESS_MPA = 5.0
# Minimum engagement of a tripod's screw in its nut, in turns.
MIN_TURNS = 3.0


def check_back(
    back: Back, items: Sequence[PurchasedItem], solids: Mapping[str, manifold3d.Manifold], total: MassProperties
) -> dict[str, Metric]:
    """Check the adapter that carries a device.

    Parameters
    ----------
    back : Back
        Its plan.
    items : sequence of PurchasedItem
        All purchased items of the device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in the rig frame, mm.
    total : MassProperties
        Mass properties of the assembled device.

    Returns
    -------
    dict of str to Metric
        The largest stress in the adapter's critical sections, if it has any, under a multiple of the device's weight in
        any direction;
        for a free-standing device, the tilt at which it falls over; for an adapter with a tripod's nut, the turns of
        engagement.
    """
    checks = {}
    if back.critical_sections:
        force = LOAD_FACTOR * total.mass_g / 1000.0 * STANDARD_GRAVITY
        stress = max(section.stress_mpa(force, total.centre_in_rig_mm) for section in back.critical_sections)
        checks["device.back_stress_mpa"] = Metric(value=round(stress, 3), unit="MPa", limit=STRESS_MPA)
    if back.stand is not None:
        angle = tipping_angle_deg(back.stand, total.centre_in_rig_mm @ back.rig_from_stand)
        limit = back.stand.tip_deg
        checks["device.tips_at_deg"] = Metric(value=round(angle, 2), unit="deg", limit=limit, lower_is_better=False)
    for name, item in zip(item_names(items), items, strict=True):
        if item.kind == "nut" and item.size == TRIPOD:
            nut, part = solids.get(name), solids.get(item.joins[0])
            turns = tripod_turns(back.table.nut.screw_mm, nut, part, back.rig_from_stand[:, 2])
            checks["device.tripod_turns"] = Metric(
                value=round(turns, 2), unit="", limit=MIN_TURNS, lower_is_better=False
            )
    return checks


def check_aim(back: Back, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """Check that the middle ray of a device on a desk reaches every depth of the design before it meets the desk.

    Parameters
    ----------
    back : Back
        The plan of the adapter; only a free-standing device has a desk.
    layout : Layout
        Camera and mirrors.
    hardware : Hardware
        The depth of a layout without a spec.

    Returns
    -------
    dict of str to Metric
        The angle of the views above the horizon, or above the axis of an arm's flange; for a free-standing device, the
        smallest height of the middle ray above the desk at the depths of the design.
    """
    checks = {"device.look_deg": Metric(value=round(back.look_deg, 2), unit="deg")}
    height = above_desk_mm(back, layout, hardware)
    if height is not None:
        checks["device.above_desk_mm"] = Metric(value=round(height, 1), unit="mm", limit=0.0, lower_is_better=False)
    return checks


def tipping_angle_deg(stand: Stand, centre_mm: FloatArray) -> float:
    """The smallest tilt in deg, over any side of its base, at which a device falls over; negative if it cannot stand.

    The centre of mass (3,), in the stand frame, is above the side at a tilt of atan(d / h), with d its horizontal
    distance from the side and h its height.
    """
    starts, ends = stand.corners, np.roll(stand.corners, -1, axis=0)
    directions = (ends - starts) / np.linalg.norm(ends - starts, axis=1)[:, None]
    inward = np.column_stack([-directions[:, 1], directions[:, 0]])
    centre = stand.corners.mean(axis=0)
    inward *= np.sign(((centre - starts) * inward).sum(axis=1))[:, None]
    distance = float(((centre_mm[:2] - starts) * inward).sum(axis=1).min())
    return float(np.degrees(np.arctan2(distance, centre_mm[2] - stand.z_mm)))


def tripod_turns(
    screw_mm: float, nut: manifold3d.Manifold | None, part: manifold3d.Manifold | None, up: FloatArray
) -> float:
    """Turns of a tripod's screw, `screw_mm` long, in the nut above a part's lower face; 0 if nut or part is missing.

    The screw points along the unit vector `up` (3,).
    """
    if nut is None or part is None:
        return 0.0
    nut_low, part_low = (float((solid.to_mesh64().vert_properties[:, :3] @ up).min()) for solid in (nut, part))
    thread_start = nut_low - part_low
    thread = thread_of(TRIPOD)
    return max(0.0, min(screw_mm - thread_start, thread.nut_height_mm)) / thread.pitch_mm
