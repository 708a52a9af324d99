"""An adapter for a monitor's upper edge: a plate with a hook in front of the screen, and a sliding jaw behind it."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import RGB, SECOND_RGB, TOP_DOWN, Back, BackPart, CriticalSection, Load, Support
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y, BlocksPlan, countersunk_slot, head_cuts
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.truss import Foot, foot_stack
from mirrorcam.cad.plan.back_table import MonitorBack
from mirrorcam.cad.plan.dimension import length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, Bore, Countersink, Hexagon, frame_along, head_space_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import Connection, PurchasedItem
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.threads import COUNTERSUNK, thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.transforms import rigid

HOOK, JAW = MonitorBack.parts
# Flush with the plate, so that a hex key reaches the screws under the clip of a wide camera.
SCREW = f"M4{COUNTERSUNK}"
# Thickness of the hook, of pad and tab between plate and monitor, and of the jaw's leg; distances from the leg's back
# to the jaw's screws, and from these to the end of the tab.
HOOK_MM, PAD_MM, LEG_MM, TO_SCREW_MM, TAB_MM = 5.0, 7.0, 8.0, 8.0, 7.0
# Distances from the mount to the jaw's screws, from these to the side of the plate, and from the load to the screen.
MOUNT_GAP_MM, SCREW_TO_SIDE_MM, LOAD_TO_SCREEN_MM = 9.0, 8.0, 12.0
# Half width and height of the part of the monitor in pictures.
MONITOR_MM = (150.0, 80.0)
HOOK_EXPLODE, JAW_EXPLODE = np.array([0.0, 0.0, -45.0]), np.array([0.0, -30.0, -95.0])
SCREW_MM, TAB_WIDTH_MM = 16.0, 15.5


def plan_monitor(table: MonitorBack, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out both parts for a monitor under the load; raises InputError if the jaw does not fit its thickness."""
    thinnest, thickest = table.range_mm
    if not thinnest <= table.thick_mm <= thickest:
        raise InputError(f"monitor is {table.thick_mm:g} mm thick, expected {thinnest:g} to {thickest:g} mm")
    foot_z, m4 = foot.z_mm, thread_of("M4")
    low_z = foot_z - table.plate_mm
    pad_z, x = low_z - PAD_MM, foot.half_width_mm + MOUNT_GAP_MM
    half = x + SCREW_TO_SIDE_MM
    heads = foot.screws - table.grip_mm * ABOVE
    # The edges of pad and plate are clear of the space below the heads of the foot's screws.
    space = head_space_mm(hardware) + hardware.printer.wall_mm
    to_back, to_front = float(heads[:, 1].min()) - space, float(heads[:, 1].max()) + space
    screen_y = _screen_y_mm(float(load.centre[1]), to_back - HOOK_MM, to_front + thinnest - 1.0)
    first, last = (screen_y - thick - LEG_MM - TO_SCREW_MM for thick in (thinnest, thickest))
    back_y = min(last - TAB_MM, foot.back_y_mm, to_back)
    front_y = max(screen_y + HOOK_MM, foot.front_y_mm, to_front)
    hook_pieces = (
        box((-half, back_y, low_z), (half, front_y, foot_z)),
        box((-half, screen_y - thinnest + 1.0, pad_z), (half, screen_y + HOOK_MM, low_z)),
        box((-half, screen_y, pad_z - table.hook_mm), (half, screen_y + HOOK_MM, low_z)),
    )
    hook_cuts: list[Bore | Countersink] = [*head_cuts(heads, table.grip_mm, None, hardware)]
    clearance = m4.clearance_mm / 2.0
    for side in (-x, x):
        top = np.array([side, (first + last) / 2.0, foot_z])
        hook_cuts += countersunk_slot(top, "M4", table.plate_mm, first - last)
    screen = np.array([-half, screen_y, pad_z])
    step = np.array([-half, screen_y - thinnest + 1.0, low_z])
    hook_lengths = (
        length(screen, screen + HOOK_MM * ALONG_Y),
        length(screen, screen - table.hook_mm * ABOVE),
        length(step, step - PAD_MM * ABOVE),
        length(step, np.array([-half, screen_y, low_z])),
        *([length(screen, np.array([-half, front_y, pad_z]), "", ALONG_Y)] if front_y > screen_y + HOOK_MM else []),
    )
    jaw_y = screen_y - table.thick_mm
    screw_y = jaw_y - LEG_MM - TO_SCREW_MM
    jaw_pieces = (
        # Two tabs, with access to the hook's screws between them.
        *(
            box((low, screw_y - TAB_MM, pad_z), (high, jaw_y, low_z))
            for low, high in ((-half, -half + TAB_WIDTH_MM), (half - TAB_WIDTH_MM, half))
        ),
        box((-half, jaw_y - LEG_MM, pad_z - table.jaw_mm), (half, jaw_y, low_z)),
    )
    jaw_top = np.array([-half, jaw_y, low_z])
    jaw_lengths = (
        length(jaw_top, jaw_top - LEG_MM * ALONG_Y),
        length(jaw_top - LEG_MM * ALONG_Y, np.array([-half, jaw_y - LEG_MM, pad_z])),
        length(np.array([-half, screw_y - TAB_MM, low_z]), np.array([TAB_WIDTH_MM - half, screw_y - TAB_MM, low_z])),
    )
    jaw_cuts: list[Bore | Hexagon] = []
    items = []
    depth = m4.nut_height_mm + NUT_FIT_MM
    for side in (-x, x):
        mouth = np.array([side, screw_y, pad_z - OUTSIDE_MM])
        jaw_cuts.append(Bore(mouth, ABOVE, clearance, PAD_MM + 2.0 * OUTSIDE_MM))
        jaw_cuts.append(Hexagon(mouth, ABOVE, None, m4.nut_flats_mm + NUT_FIT_MM, depth + OUTSIDE_MM))
        head, seat, down = (np.array([side, screw_y, foot_z]), np.array([side, screw_y, pad_z + depth]), -60.0 * ABOVE)
        items.append(
            PurchasedItem("screw", SCREW, SCREW_MM, frame_along(head, ABOVE), HOOK_EXPLODE + 30.0 * ABOVE, (HOOK, JAW))
        )
        items.append(
            PurchasedItem(
                "nut", "M4", m4.nut_height_mm, frame_along(seat, ABOVE), JAW_EXPLODE + down / 2.0, (JAW,), down[None]
            )
        )
    half_width, height = MONITOR_MM
    monitor = box((-half_width, jaw_y, pad_z - height), (half_width, screen_y, pad_z))
    slide = rigid(np.diag([1.0, -1.0, -1.0]), [0.0, screw_y, low_z])
    width = 2.0 * half
    hook = BlocksPlan(HOOK, hook_pieces, tuple(hook_cuts), hook_lengths)
    jaw = BlocksPlan(JAW, jaw_pieces, tuple(jaw_cuts), jaw_lengths)
    return Back(
        table=table,
        parts=(
            BackPart(HOOK, "Monitor hook", hook, TOP_DOWN, HOOK_EXPLODE, RGB),
            BackPart(JAW, "Monitor jaw", jaw, TOP_DOWN, JAW_EXPLODE, SECOND_RGB),
        ),
        foot=foot_stack(hardware),
        foot_heads=heads,
        items=tuple(items),
        connections=(Connection("jaw", HOOK, JAW, slide, slide),),
        supports=(Support("monitor", (monitor,)),),
        heading="hang the device on a monitor",
        fits=f"It fits monitors from {thinnest:g} to {thickest:g} mm thick at their upper edge, with a flat back "
        "behind it.",
        steps=(
            "Lay the M4 nuts into the jaw from below, hold the jaw under the hook, and turn in the M4 screws from "
            "above, loosely.",
            f"Hang the hook over the upper edge of the monitor. It reaches {table.hook_mm:g} mm down in front of the "
            "screen: felt on it and on the jaw protects the frame from scratches.",
            "Push the jaw up to the back of the monitor and tighten its screws. The device must not tilt when you "
            "tip the monitor.",
        ),
        critical_sections=(
            CriticalSection(
                "plate between screen and mount",
                np.array(
                    [0.0, float(np.clip(screen_y, foot.back_y_mm, foot.front_y_mm)), foot_z - table.plate_mm / 2.0]
                ),
                ALONG_Y,
                ALONG_X,
                (width, table.plate_mm),
            ),
            CriticalSection("jaw", np.array([0.0, jaw_y, pad_z]), ABOVE, ALONG_X, (width, LEG_MM), table.jaw_mm),
        ),
    )


def _screen_y_mm(load_y: float, behind: float, before: float) -> float:
    """y of the screen: in front of the load, so that the device hangs on the monitor's back, or near it.

    It is not between `behind` and `before`, where the hook or its pad would be below the heads of the foot's screws.
    """
    nominal = load_y + LOAD_TO_SCREEN_MM
    if nominal >= before or nominal <= behind:
        return nominal
    return min(before, behind, key=lambda y: abs(y - nominal))
