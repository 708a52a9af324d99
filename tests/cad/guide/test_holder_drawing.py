"""The drawing of the holder: a table of its seats."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from shapely import Polygon

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.guide.drawing import draw
from mirrorcam.cad.guide.drawing_sheet import DrawingSheet
from mirrorcam.cad.guide.holder_drawing import seat_names
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.layout import Layout


def overlaps(sheet: DrawingSheet) -> list[tuple[str, str]]:
    """Pairs of words that cover each other."""
    boxes = [(words.text, Polygon(words.corners).buffer(-0.05)) for words in sheet.words]
    return [(a, b) for (a, first), (b, second) in combinations(boxes, 2) if first.intersects(second)]


def outside(sheet: DrawingSheet) -> list[str]:
    width, height = sheet.size_mm
    low, high = np.array([10.0, 10.0]), np.array([width - 10.0, height - 10.0])
    return [words.text for words in sheet.words if (words.corners < low).any() or (words.corners > high).any()]


def test_the_holder_has_its_seats_in_a_table(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0)
    device = plan_device(layout, HARDWARE)
    part = next(part for part in parts_of(device) if part.name == "mirror_holder")
    sheet = draw(part.make(part.plan), part, HARDWARE.printer)
    said = [words.text for words in sheet.words]
    assert overlaps(sheet) == []
    assert outside(sheet) == []
    # A in both frames of the seats, at the back and at the trace of the section; B in the frames and at the holes.
    assert (said.count("A"), said.count("B")) == (5, 3)
    assert "4x Ø4 ±0.1 ↧6.7 for M3 insert (far side)" in said
    # The tilt of a seat in the table is the angle of its mirror's normal to the back's.
    back = part.print_from_rig[2, :3]
    for index, mirror in enumerate(layout.mirrors):
        tilt = np.degrees(np.arccos(mirror.normal_in_rig @ back))
        assert f"{tilt:.3f}" in said
        assert said.count(f"{index // 2}-{index % 2}") == 2


def test_a_carrier_says_where_its_seat_is(make_parabola: Callable[..., Layout]) -> None:
    """Of a wedge without it no angle was known: its plane from its back, through the pads."""
    layout = make_parabola(2, 2, scale_mm=90.0, gap_mm=2.0)
    hardware = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="screws"))
    device = plan_device(layout, hardware)
    part = next(part for part in parts_of(device) if part.name == "carrier_0-1")
    sheet = draw(part.make(part.plan), part, hardware.printer)
    said = [words.text for words in sheet.words]
    mirror = layout.mirrors[1]
    back = part.print_from_rig[2, :3]
    assert f"{np.degrees(np.arccos(mirror.normal_in_rig @ back)):.3f}" in said
    assert "0-1" in said
    head = next(words for words in sheet.words if words.text == "z")
    cell = next(
        words
        for words in sheet.words
        if words.text.replace(".", "").isdigit()
        and words.corners[0, 0] > 0.0
        and abs(words.corners[1, 0] - head.corners[1, 0]) < 0.1
        and words.corners[1, 1] < head.corners[1, 1]
    )
    carrier = device.mirror_carriers[1]
    # Behind the mirror by its thickness; the middle of the seat is that of its corners.
    middle = carrier.body.top.mean(axis=0)
    behind = mirror.outline_in_rig_mm[0] - mirror.thickness_mm * mirror.normal_in_rig
    on_pads = middle + ((behind - middle) @ mirror.normal_in_rig) * mirror.normal_in_rig
    height = (on_pads - carrier.rig_from_back[:3, 3]) @ back
    assert abs(float(cell.text) - height) < 0.01


def test_the_holes_of_carriers_screws_are_in_a_table(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(2, 2, scale_mm=90.0, gap_mm=2.0)
    hardware = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="screws"))
    device = plan_device(layout, hardware)
    part = next(part for part in parts_of(device) if part.name == "mirror_holder")
    sheet = draw(part.make(part.plan), part, hardware.printer)
    said = [words.text for words in sheet.words]
    assert isinstance(device.holder, ScrewedHolderPlan)
    holes = device.holder.screws_in_mount_mm
    for x, y in holes * [1.0, -1.0]:
        assert f"{x:.2f}" in said
        assert f"{y:.2f}" in said
    assert {str(number) for number in range(1, len(holes) + 1)} <= set(said)
    (callout,) = [text for text in said if text.startswith(f"{len(holes)}x Ø3.4")]
    assert (
        f"counterbore Ø{device.holder.adjuster.recess_wide_mm:.3g} ↧{device.holder.adjuster.recess_mm:.3g}" in callout
    )
    assert overlaps(sheet) == []
    assert outside(sheet) == []


def test_seats_have_the_names_of_their_mirrors(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0)
    ring = layout.replaced(rows=1, cols=4, pattern=Pattern.ring(4))
    for device in (plan_device(layout, HARDWARE), plan_device(ring, HARDWARE)):
        assert tuple(name for name, _ in seat_names(device.holder)) == device.layout.mirror_names
