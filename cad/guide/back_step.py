"""Sentences of the guide's step for what carries the device, from the adapter's parts, items and support."""

from __future__ import annotations

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import LOAD_FACTOR, Back, carried_load, in_sentence
from mirrorcam.cad.backs.blocks import TRIPOD
from mirrorcam.cad.plan.part_plan import PurchasedItem


def back_sentences(device: Device) -> list[str]:
    """The numbered sentences of the step, in Markdown."""
    back = device.back
    title = in_sentence(back.parts[0].title)
    nut = tripod_nut_of(back)
    sentences = []
    if nut is not None:
        under_mount = float(nut.exit_moves_mm[0] @ device.mount.foot.up_in_rig) > 0.0
        sentences.append(
            f"Lay the {nut.size} nut into its pocket in the {'upper face of the ' if under_mount else ''}{title}."
            + (" It stays there: the mount covers it." if under_mount else "")
            + (" It is only needed for a tripod, but cannot be put in later." if under_mount and back.stand else "")
        )
    end = f", its longer end towards the {longer_end(back)}" if back.stand else ""
    sentences += [f"Screw the {title} to the foot of the mount from below{end}.", *back.steps]
    if back.stand:
        sentences.append(
            "Stand the device on a desk. It stands by itself, and returns when you tip it by less than "
            f"{back.stand.tip_deg:g}° in any direction; let no cable pull on it."
        )
    elif nut is not None:
        load = carried_load(device.mount, device.clip, device.hardware)
        heavier = "scene" if load.centre[1] > device.mount.foot.screws[:, 1].min() else "back"
        sentences.append(
            f"{tripod_sentence(back, nut)} The device is heavier towards the {heavier}: turn a leg of the tripod that "
            "way."
        )
    if back.table.not_checked:
        load_kg = LOAD_FACTOR * carried_load(device.mount, device.clip, device.hardware).mass_g / 1000.0
        sentences.append(
            f"Not checked by the program: {back.table.not_checked}. Load the part with {load_kg:.1f} kg before you "
            "trust it with the camera."
        )
    if back.robot:
        sentences += [
            "[robot/mirrorcam.xacro](robot/mirrorcam.xacro) gives the arm's software the mass and shape of the "
            f"device and the frames of the camera and its views; it is attached to the link `{back.robot.parent}`, "
            f"{back.robot.attached}.",
            "Move the arm slowly through its range once, with a hand on the stop button, and watch the cable.",
        ]
    return sentences


def tripod_note(back: Back) -> str:
    """The paragraph about a tripod after the step; "" if the step itself is about it."""
    nut = tripod_nut_of(back)
    if nut is None:
        return "This back has no nut for a tripod. To stand the device on one, build it with `--adapter tripod`."
    return f"For a tripod, {in_sentence(tripod_sentence(back, nut))}" if back.stand else ""


def tripod_nut_of(back: Back) -> PurchasedItem | None:
    """The nut for a tripod's screw, if the adapter has one."""
    return next((item for item in back.items if (item.kind, item.size) == ("nut", TRIPOD)), None)


def tripod_sentence(back: Back, nut: PurchasedItem) -> str:
    """How a tripod's screw holds in its nut."""
    axis = nut.rig_from_item[:3, 2]
    lowest = float((back.parts[0].plan.corners @ axis).min())
    floor = float(nut.rig_from_item[:3, 3] @ axis) - nut.length_mm - lowest
    screw_mm = back.table.nut.screw_mm
    return (
        f"Screw the tripod's 1/4 in screw into the nut: {round(floor, 2):g} mm of plastic lies under the nut, so that "
        f"a screw that protrudes by {screw_mm:g} mm holds with {screw_mm - floor:.1f} mm of its thread. Tighten it by "
        "hand, with no lever."
    )


def longer_end(back: Back) -> str:
    """The direction, "scene" or "back", in which the base reaches further beyond the screws of the mount's foot."""
    assert back.stand is not None
    screws = (back.foot_heads @ back.rig_from_stand)[:, 1]
    before, behind = back.stand.corners[:, 1].max() - screws.max(), screws.min() - back.stand.corners[:, 1].min()
    return "scene" if before > behind else "back"
