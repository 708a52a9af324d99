"""The drawing of the holder: a table of its seats.

Dimensions of plans for their drawings: pieces have those of the uncut part, holders their holes, others none.

Drawings: their text, no overlaps, the same bytes, real files.
"""

from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from build123d import Box, GeomType, Pos
from shapely import LineString, Polygon

from benchmarks.devices import DEVICES
from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.backs.back import RotatedPlan
from mirrorcam.cad.backs.blocks import BlocksPlan
from mirrorcam.cad.backs.plan_backs import make_blocks, plan_back
from mirrorcam.cad.guide.annotation import pad_zone_mm
from mirrorcam.cad.guide.dimension_lines import LINE_MM, number
from mirrorcam.cad.guide.drawing import (
    SMALL_MM,
    VISIBLE_MM,
    dimensions_in_plan,
    dimensions_of,
    draw,
    seat_names,
    write_drawing,
)
from mirrorcam.cad.guide.drawing_sheet import (
    A3_MM,
    BLOCK_MM,
    BORDER_MM,
    GAUGE_TOLERANCE,
    GENERAL_TOLERANCE,
    MATERIAL_MM,
    MODEL,
    DrawingSheet,
)
from mirrorcam.cad.guide.hole_callouts import PRESS_TOLERANCE
from mirrorcam.cad.guide.sections import CUTTING_LINE_MM, HATCH_LINE_MM
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.parts.body_clip import FILLET_MM, ROOT_MM
from mirrorcam.cad.parts.camera_box import LEAF_TOLERANCE_MM
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.plan.back_table import BACKS, back_of
from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import Bore, Countersink, Hexagon
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera_library import camera_names, read_body
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.optics.geometry.transforms import rigid
from tests.cad.guide.test_annotation import Dimensions
from tests.hostile_names import ACCEPTED
from tests.nightly import a_few


def overlaps(sheet: DrawingSheet) -> list[tuple[str, str]]:
    """Pairs of texts that overlap."""
    boxes = [(box.text, Polygon(box.corners).buffer(-0.05)) for box in sheet.text_boxes]
    return [(a, b) for (a, first), (b, second) in combinations(boxes, 2) if first.intersects(second)]


CLEAR_MM = 3.0


def outside(sheet: DrawingSheet) -> list[str]:
    """Texts and lines that come near the frame or the title block, which has its own texts and lines."""
    border = np.array([(BORDER_MM, BORDER_MM), np.array(A3_MM) - BORDER_MM])
    field = border + CLEAR_MM * np.array([[1.0], [-1.0]]) + np.array([(0.0, BLOCK_MM), (0.0, 0.0)])
    drawn = [(box.text, box.corners) for box in sheet.text_boxes]
    drawn += [(f"line from {line[0].round(1)}", np.asarray(line)) for line, _ in sheet.drawn_lines]
    return [
        name
        for name, points in drawn
        if not ((points >= field[0]) & (points <= field[1])).all()
        and not ((points >= border[0]) & (points <= (border[1, 0], BORDER_MM + BLOCK_MM))).all()
        and not (np.ptp(points, axis=0) == np.ptp(border, axis=0)).all()
    ]


def doubled(sheet: DrawingSheet) -> list[str]:
    """Dimension lines (straight, with an arrow along them) that another dimension or extension line runs along."""
    heads = [LineString([tip - 0.2 * axis, tip - 1.2 * axis]) for tip, axis in sheet.arrows]
    lines = [LineString(line) for line, width in sheet.drawn_lines if width == LINE_MM and len(line) == 2]
    with_arrow = [line for line in lines if any(line.buffer(1e-3).contains(head) for head in heads)]
    pairs = ((a, b) for a in with_arrow for b in lines if a is not b and a.distance(b) < 1e-3)
    return [str(a) for a, b in pairs if a.intersection(b.buffer(1e-3)).length > 0.3]


def test_the_holder_has_its_seats_in_a_table(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0)
    device = plan_device(layout, HARDWARE)
    part = next(part for part in parts_of(device) if part.name == "mirror_holder")
    sheet = draw(part.make(part.plan), part, HARDWARE.printer)
    texts = [box.text for box in sheet.text_boxes]
    require_clear(sheet)
    # A in both frames of the seats, at the back and at the trace of the section; B in the frames and at the holes.
    assert (texts.count("A"), texts.count("B")) == (5, 3)
    assert "4x Ø4 ±0.1 ↧6.7 for M3 insert (far side)" in texts
    # The section through a pad and a rim.
    pad = pad_zone_mm(device.holder, Tolerances()) / 2.0
    assert f"{HARDWARE.holder.bond_mm:g} ±{pad:g} pad" in texts
    assert f"{HARDWARE.holder.rim_mm:g} rim" in texts
    assert number(HARDWARE.holder.rim_height_of_sheet * layout.mirrors[0].thickness_mm) in texts
    assert f"{HARDWARE.holder.shade_mm:g} wall" in texts
    assert texts.count("C") == 2
    # The tilt of a seat in the table is the angle of its mirror's normal to the back's.
    back = part.print_from_rig[2, :3]
    for index, mirror in enumerate(layout.mirrors):
        tilt = np.degrees(np.arccos(mirror.normal_in_rig @ back))
        assert f"{tilt:.3f}" in texts
        assert texts.count(f"{index // 2}-{index % 2}") == 2


@pytest.mark.slow
def test_a_carrier_says_where_its_seat_is(make_parabola: Callable[..., Layout]) -> None:
    """The seat's plane through the pads, relative to the back: without it, no angle of the wedge is stated."""
    layout = make_parabola(2, 2, scale_mm=90.0, gap_mm=2.0)
    hardware = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="screws"))
    device = plan_device(layout, hardware)
    part = next(part for part in parts_of(device) if part.name == "carrier_0-1")
    sheet = draw(part.make(part.plan), part, hardware.printer)
    texts = [box.text for box in sheet.text_boxes]
    mirror = layout.mirrors[1]
    back = part.print_from_rig[2, :3]
    assert f"{np.degrees(np.arccos(mirror.normal_in_rig @ back)):.3f}" in texts
    assert "0-1" in texts
    head = next(box for box in sheet.text_boxes if box.text == "z")
    cell = next(
        box
        for box in sheet.text_boxes
        if box.text.replace(".", "").isdigit()
        and box.corners[0, 0] > 0.0
        and abs(box.corners[1, 0] - head.corners[1, 0]) < 0.1
        and box.corners[1, 1] < head.corners[1, 1]
    )
    carrier = device.mirror_carriers[1]
    # One thickness behind the mirror; the middle of the seat is the mean of its corners.
    middle = carrier.body.top.mean(axis=0)
    behind = mirror.outline_in_rig_mm[0] - mirror.thickness_mm * mirror.normal_in_rig
    on_pads = middle + ((behind - middle) @ mirror.normal_in_rig) * mirror.normal_in_rig
    height = (on_pads - carrier.rig_from_back[:3, 3]) @ back
    assert abs(float(cell.text) - height) < 0.01


@pytest.mark.slow
def test_the_holes_of_carriers_screws_are_in_a_table(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(2, 2, scale_mm=90.0, gap_mm=2.0)
    hardware = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="screws"))
    device = plan_device(layout, hardware)
    part = next(part for part in parts_of(device) if part.name == "mirror_holder")
    sheet = draw(part.make(part.plan), part, hardware.printer)
    texts = [box.text for box in sheet.text_boxes]
    assert isinstance(device.holder, ScrewedHolderPlan)
    holes = device.holder.screws_in_mount_mm
    for x, y in holes * [1.0, -1.0]:
        assert f"{x:.2f}" in texts
        assert f"{y:.2f}" in texts
    assert {str(number) for number in range(1, len(holes) + 1)} <= set(texts)
    (callout,) = [text for text in texts if text.startswith(f"{len(holes)}x Ø3.4")]
    assert (
        f"counterbore Ø{device.holder.adjuster.recess_wide_mm:.3g} ↧{device.holder.adjuster.recess_mm:.3g}" in callout
    )
    assert overlaps(sheet) == []
    assert outside(sheet) == []


@pytest.mark.slow
def test_seats_have_the_names_of_their_mirrors(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0)
    ring = layout.replaced(rows=1, cols=4, pattern=Pattern.ring(4))
    for device in (plan_device(layout, HARDWARE), plan_device(ring, HARDWARE)):
        assert tuple(name for name, _ in seat_names(device.holder)) == device.layout.mirror_names


def test_a_piece_offers_the_dimensions_of_the_whole(block: Callable[..., PartPlan]) -> None:
    part = block()
    piece = PiecePlan(
        part.plan, part.make, np.eye(4), (0.0, 0.0, 0.0), (9.0, 9.0, 9.0), np.zeros((0, 4, 4)), (3.0, 8.0), 1.2
    )
    assert len(dimensions_in_plan(piece)) == len(dimensions_in_plan(part.plan)) == 3
    assert dimensions_in_plan("a plan without dimensions") == ()


def test_a_holder_offers_its_four_holes_on_the_back(device: Device) -> None:
    holes = [dimension for dimension in dimensions_in_plan(device.holder) if isinstance(dimension, Hole)]
    assert len(holes) == 4
    away, origin = device.holder.rig_from_mount[:3, 2], device.holder.rig_from_mount[:3, 3]
    for hole in holes:
        assert abs((hole.centre_in_rig - origin) @ away) < 0.1
        assert abs(hole.axis_in_rig @ away) > 1.0 - 1e-9


ROOT = Path(__file__).parents[3]


SVG = "{http://www.w3.org/2000/svg}"


def crossed(sheet: DrawingSheet) -> list[str]:
    """Texts crossed by an edge of the part."""
    edges = [LineString(line) for line, width in sheet.drawn_lines if width in (VISIBLE_MM, SMALL_MM)]
    return [
        box.text
        for box in sheet.text_boxes
        if not box.over_lines and any(Polygon(box.corners).buffer(-0.1).intersects(edge) for edge in edges)
    ]


def struck(sheet: DrawingSheet) -> list[str]:
    """Texts crossed by a dimension, extension or leader line, or by the trace of a section."""
    lines = [LineString(line) for line, width in sheet.drawn_lines if width in (LINE_MM, CUTTING_LINE_MM)]
    return [
        box.text
        for box in sheet.text_boxes
        if not box.over_lines and any(Polygon(box.corners).buffer(-0.2).intersects(line) for line in lines)
    ]


def require_clear(sheet: DrawingSheet) -> None:
    for check in (overlaps, outside, crossed, struck, doubled):
        assert check(sheet) == [], check.__name__


def test_a_block_says_its_size_holes_and_places(block: Callable[..., PartPlan]) -> None:
    part = block()
    sheet = draw(part.make(part.plan), part, HARDWARE.printer)
    texts = [box.text for box in sheet.text_boxes]
    # Length, depth and height, once each; two holes, 40 apart, 10 from the left edge and 15 from the lower one.
    for text in ("60", "30", "40", "2x Ø6 through", "MC-99", "Block", part.identity, "CERN-OHL-W-2.0", "2 : 1"):
        assert texts.count(text) == 1, text
    assert texts.count("10") == 2
    assert texts.count("15") == 1
    assert overlaps(sheet) == []
    assert outside(sheet) == []
    assert crossed(sheet) == []


@pytest.mark.parametrize("size_mm", [(60.0, 30.0, 1.0), (200.0, 200.0, 240.0), (47.0, 12.0, 90.0)])
def test_any_size_finds_its_scale_and_room(block: Callable[..., PartPlan], size_mm: tuple[float, float, float]) -> None:
    part = block(size_mm)
    sheet = draw(part.make(part.plan), part, HARDWARE.printer)
    assert overlaps(sheet) == []
    assert outside(sheet) == []
    assert crossed(sheet) == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", a_few(1, ACCEPTED))
def test_any_name_of_a_plastic_stays_in_its_field(name: str, block: Callable[..., PartPlan], tmp_path: Path) -> None:
    part = block()
    sheet = draw(part.make(part.plan), part, HARDWARE.printer.replaced(plastic=name))
    (field,) = (box for box in sheet.text_boxes if box.text.endswith(", printed"))
    texts = "".join(shown if shown == sent else "?" for shown, sent in zip(field.text, name, strict=False))
    assert name.startswith(texts.split("?")[0])
    assert np.ptp(field.corners[:, 0]) <= MATERIAL_MM
    assert overlaps(sheet) == []
    assert outside(sheet) == []
    sheet.write(tmp_path / "part", "MC-99 Block")
    ET.parse(tmp_path / "part.svg")


def test_the_checks_above_see_what_is_wrong(block: Callable[..., PartPlan]) -> None:
    part = block()
    sheet = draw(part.make(part.plan), part, HARDWARE.printer)
    there = sheet.text_boxes[0].corners.mean(axis=0)
    sheet.text(there, "over it", 2.5)
    sheet.text((415.0, 100.0), "beyond", 2.5)
    edge = next(line for line, width in sheet.drawn_lines if width == VISIBLE_MM)
    sheet.text(edge[0], "on an edge", 2.5)
    assert len(overlaps(sheet)) > 0
    assert "beyond" in outside(sheet)
    sheet.text((100.0, BORDER_MM + BLOCK_MM + 1.0), "on the block", 2.5)
    assert "on the block" in outside(sheet)
    line = next(line for line, width in sheet.drawn_lines if width == LINE_MM and len(line) == 2)
    assert doubled(sheet) == []
    sheet.lines([line, line], LINE_MM)
    sheet.arrow_head(line[0], line[0] - line[1])
    assert len(doubled(sheet)) > 0
    assert "on an edge" in crossed(sheet)


def test_a_piece_keeps_the_dimensions_that_lie_on_it(block: Callable[..., PartPlan]) -> None:
    part = block()
    half = part.make(part.plan) & (Pos(-30, 0, 0) * Box(60, 60, 60))
    low, high = (-30.0, -15.0, -5.0), (0.0, 15.0, 5.0)
    piece = PiecePlan(part.plan, part.make, np.eye(4), low, high, np.zeros((0, 4, 4)), (3.0, 8.0), 1.2)
    texts = [box.text for box in draw(half, replace(part, plan=piece), HARDWARE.printer).text_boxes]
    assert "Ø6 through" in texts
    assert "2x Ø6 through" not in texts
    assert "40" not in texts


BACK_PARTS = {
    "none": ("adapter_desk",),
    "tripod": ("adapter_tripod",),
    "arca": ("adapter_arca",),
    "iso9409": ("adapter_flange", "adapter_centring"),
    "gen3": ("adapter_flange", "adapter_spacer"),
    "gen2": ("adapter_saddle", "adapter_cap"),
    "profile20": ("adapter_profile",),
    "vesa": ("adapter_vesa",),
    "monitor": ("adapter_hook", "adapter_jaw"),
}
OF_BACKS = tuple(f"{kind} {name}" for kind, names in BACK_PARTS.items() for name in names)
NAMES = ("mount", "camera_clip", "fit_coupon", *OF_BACKS)
ALL = (*NAMES, "dust_cover")


@pytest.fixture(scope="module")
def device(covered_device: Device) -> Device:
    return covered_device


@cache
def parts_with(device: Device, kind: str) -> dict[str, PartPlan]:
    """The parts of the default device with a back, by their names."""
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=back_of(kind)))
    return {part.name: part for part in parts_of(replace(device, back=back))}


def part_of(device: Device, name: str) -> PartPlan:
    """A part of the default device; one of a back has the back's kind before its name."""
    kind, _, part = name.rpartition(" ")
    return parts_with(device, kind or "none")[part]


def test_the_parts_of_all_backs_are_drawn(device: Device) -> None:
    assert tuple(BACK_PARTS) == tuple(BACKS)
    for kind, names in BACK_PARTS.items():
        assert {name for name in parts_with(device, kind) if name.startswith("adapter_")} == set(names)


@cache
def drawn(device: Device, name: str) -> DrawingSheet:
    """The drawing of a part of the default device."""
    part = part_of(device, name)
    return draw(part.make(part.plan), part, HARDWARE.printer)


@pytest.mark.parametrize("name", a_few(2, ALL))
def test_nothing_lies_over_anything_in_the_drawings_of_the_default(device: Device, name: str) -> None:
    require_clear(drawn(device, name))


@pytest.mark.parametrize("camera", a_few(1, ["brio", *camera_names()]))
def test_nothing_lies_over_anything_in_the_drawings_of_clips(device: Device, camera: str) -> None:
    hardware = HARDWARE.replaced(camera=read_body(camera))
    clip = replace(device, hardware=hardware, clip=plan_clip(hardware))
    part = next(part for part in parts_of(clip) if part.name == "camera_clip")
    require_clear(draw(part.make(part.plan), part, HARDWARE.printer))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(DEVICES))
def test_nothing_lies_over_anything_in_the_drawings_of_whole_devices(name: str) -> None:
    layout = design(DesignSpec().replaced(**DEVICES[name].spec))
    hardware = DEVICES[name].hardware(layout)
    for part in parts_of(plan_device(layout, hardware)):
        require_clear(draw(part.make(part.plan), part, hardware.printer, hardware.screw))


@pytest.mark.parametrize("name", a_few(5, NAMES))
def test_every_hole_of_a_part_is_called_out_with_its_depth(device: Device, name: str) -> None:
    """Every size, as often as in the plan, with its depth or "through"."""
    part = part_of(device, name).plan
    plan: Any = part.plan if isinstance(part, RotatedPlan) else part
    wanted: Counter[str] = Counter()
    for cut in plan.cuts:
        if isinstance(cut, Bore):
            width = number(2.0 * cut.radius_mm)
            long = number(2.0 * cut.radius_mm + cut.travel_mm)
            wanted[f"slot {width} x {long}" if cut.travel_mm else f"Ø{width}"] += 1
        elif isinstance(cut, Hexagon):
            wanted[f"hex {number(cut.flats_mm)}"] += 1
        elif isinstance(cut, Countersink):
            wanted["countersink"] += 1
    assert called_out(drawn(device, name)) == wanted


@pytest.mark.parametrize("name", a_few(2, NAMES))
def test_no_hole_is_deeper_than_its_part(device: Device, name: str) -> None:
    part = part_of(device, name)
    solid = part.make(part.plan)
    size = np.array(tuple(solid.bounding_box().size))
    for hole in dimensions_of(part, solid, HARDWARE.screw):
        if isinstance(hole, Hole) and (found := re.search(r"↧([\d.]+)", hole.text)):
            assert float(found[1]) * np.abs(hole.axis_in_rig).max() <= size[np.abs(hole.axis_in_rig).argmax()] + 0.01
    if name == "mount":
        slots = [box.text for box in drawn(device, name).text_boxes if "slot" in box.text and "↧" in box.text]
        assert slots
        for text in slots:
            assert float(re.findall(r"↧([\d.]+)", text)[0]) < device.mount.section.depth_mm


@pytest.mark.parametrize("name", a_few(4, ALL))
def test_every_part_has_a_hatched_section_that_is_traced(device: Device, name: str) -> None:
    sheet = drawn(device, name)
    texts = [box.text for box in sheet.text_boxes]
    assert texts.count("A") == 2
    assert len([text for text in texts if re.match(r"A-A( \(|$)", text)]) == 1
    assert sum(width == HATCH_LINE_MM for _, width in sheet.drawn_lines) > 10


def called_out(sheet: DrawingSheet) -> Counter[str]:
    """Counts of the holes that a drawing calls out with a depth or as through holes, by size."""
    found: Counter[str] = Counter()
    for box in sheet.text_boxes:
        if match := re.fullmatch(
            r"(?:(\d+)x )?(Ø[\d.]+|slot [\d.]+ x [\d.]+|hex [\d.]+(?= A/F)).*(?:↧[\d.]+|through).*", box.text
        ):
            found[match[2]] += int(match[1] or 1)
        elif match := re.fullmatch(r"(?:(\d+)x )?countersink (?:Ø[\d.]+|slot [\d.]+ x [\d.]+) x 84°.*", box.text):
            found["countersink"] += int(match[1] or 1)
    return found


def test_a_drawing_states_one_general_tolerance_its_revision_and_its_date(
    block: Callable[..., PartPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    part = block()
    texts = [box.text for box in draw(part.make(part.plan), part, HARDWARE.printer).text_boxes]
    assert [text for text in texts if "±" in text or "2768" in text] == [GENERAL_TOLERANCE]
    assert part.identity in texts
    assert "2023-11-14" in texts


@pytest.mark.slow
def test_the_mount_says_where_the_screws_of_its_head_are(device: Device) -> None:
    """From the foot's corner at the slide, as in the holder's plan, and their distance along the face."""
    part = next(part for part in parts_of(device) if part.name == "mount")
    texts = [box.text for box in draw(part.make(part.plan), part, HARDWARE.printer).text_boxes]
    holder, mount = device.holder, device.mount
    flat = np.column_stack([holder.holes_in_mount_mm, np.zeros(4), np.ones(4)])
    screws = (flat @ holder.rig_from_mount.T)[:, :3]
    corner = np.array([0.0, *mount.foot_corners[0]])
    assert mount.bed_turn_deg == 0.0
    for row in np.unique(np.abs(screws - corner)[:, 1:].round(2), axis=0):
        assert {number(value) for value in row} <= set(texts)
    apart = np.ptp(holder.holes_in_mount_mm, axis=0)
    assert f"{number(apart[1])} head screws" in texts
    assert number(apart[0]) in texts
    assert "4x Ø3.4 through for M3" in texts
    # The foot's holes are dimensioned from its edge at the slide, not from the mount's furthest point.
    for point in (*mount.foot.screws_in_rig[:2], np.array([0.0, *mount.foot_corners[1]])):
        assert {number(abs(value)) for value in (point - corner)[1:]} <= set(texts)


def test_a_drawing_names_the_model_that_its_other_shapes_are_as(device: Device) -> None:
    for name in ("mount", "camera_clip"):
        texts = [box.text for box in drawn(device, name).text_boxes]
        assert texts.count(MODEL) == 1
        assert texts.count(f"parts/{name}.step") == 1


def test_gauges_have_no_tolerance_that_their_steps_lie_within(device: Device) -> None:
    """The coupon's steps are 0.1 and 0.3 mm; holes for inserts in parts have a tolerance of half a step."""
    texts = [box.text for box in drawn(device, "fit_coupon").text_boxes]
    assert GAUGE_TOLERANCE in texts
    assert [text for text in texts if "±" in text] == []
    height = device.hardware.camera.height_mm
    for text in (f"{number(height + 0.3)} go", f"{number(height - 0.3)} no-go", "20.6 seat", "15.6 seat", "2.4 plate"):
        assert texts.count(text) == 1, text
    pressed = [box.text for box in drawn(device, "camera_clip").text_boxes if box.text.endswith("insert (far side)")]
    assert pressed
    assert all(f"Ø4 {PRESS_TOLERANCE} ↧" in text for text in pressed)


def test_walls_and_leaves_say_how_thick_they_are(device: Device) -> None:
    texts = [box.text for box in drawn(device, "camera_clip").text_boxes]
    assert device.clip.nest is not None
    for screw in device.clip.nest.screws:
        assert f"{number(screw.leaf.thickness_mm)} ±{LEAF_TOLERANCE_MM:g} leaf" in texts
        assert {number(screw.leaf.length_mm + ROOT_MM), number(screw.leaf.width_mm)} <= set(texts)
    assert texts.count(f"2x R{number(FILLET_MM)}") == 2
    wall = np.ptp(np.vstack([device.clip.pieces[0].base, device.clip.pieces[0].top])[:, 1])
    assert f"{number(float(wall))} wall" in texts
    texts = [box.text for box in drawn(device, "dust_cover").text_boxes]
    for text in ("0.9 wall", "0.9 floor", f"{number(2.0 * device.mount.half_width_mm + 2.0)} gap"):
        assert texts.count(text) == 1, text


def test_the_isometric_keeps_clear_of_a_long_callout(block: Callable[..., PartPlan]) -> None:
    part = block()
    hole = Hole(
        np.array([20.0, 0.0, 5.0]), np.array([0.0, 0.0, 1.0]), 6.0, "through, and a purpose that takes many words"
    )
    solid = part.make(part.plan)
    sheet = draw(solid, replace(part, plan=Dimensions((hole,))), HARDWARE.printer)
    assert crossed(sheet) == []
    assert outside(sheet) == []


def test_the_clip_says_where_all_six_points_are(device: Device) -> None:
    """From its left side, its face on the mount, and its lower end, each distance once."""
    texts = [box.text for box in drawn(device, "camera_clip").text_boxes]
    nest, clip = device.clip.nest, device.clip
    assert nest is not None
    left = min(float(np.vstack([piece.base, piece.top])[:, 0].min()) for piece in clip.pieces)
    for number_of, point in enumerate(nest.points - [left, clip.slide_y_mm, clip.bottom_mm]):
        for value in np.abs(point):
            kinds = ("pad", "stop") if number_of < 3 else ("stop",)
            assert any(texts.count(f"{number(value)} {kind}") == 1 for kind in kinds), (number_of, value)


@pytest.mark.parametrize("name", a_few(6, OF_BACKS))
def test_every_plane_of_a_part_of_a_back_is_dimensioned(device: Device, name: str) -> None:
    """Along each axis of the stand, planes join by lengths, sizes, depths of holes, or mirror images."""
    part = part_of(device, name)
    assert isinstance(part.plan, RotatedPlan)
    if not isinstance(part.plan.plan, BlocksPlan):
        pytest.skip("a ring's planes are not all parallel to those of the stand")
    print_from_stand = part.print_from_rig @ rigid(part.plan.rig_from_stand, np.zeros(3))
    part = replace(part, plan=part.plan.plan, make=make_blocks, print_from_rig=print_from_stand)
    solid = part.make(part.plan)
    sheet_says = dimensions_of(part, solid, HARDWARE.screw)
    box = solid.bounding_box()
    ends = np.array([tuple(box.min), tuple(box.max)])
    for axis in range(3):
        planes = {
            round(float(tuple(face.center())[axis]), 2)
            for face in solid.faces()
            if face.geom_type == GeomType.PLANE and abs(tuple(face.normal_at())[axis]) > 1.0 - 1e-6
        }
        size = ends[:, axis].round(2).tolist()
        joined, known = [], set(size)
        for each in sheet_says:
            if isinstance(each, Length):
                points = each.points_in_rig[:, axis].round(2).tolist()
                if np.abs(each.span_in_rig).argmax() == axis:
                    joined.append(points)
                    # A centred dimension locates both of its ends.
                    known |= set(points) if abs(sum(points) - sum(size)) < 0.02 else set()
            elif each.cut_mm is not None and abs(each.axis_in_rig[axis]) > 0.9:
                found = re.search(r"↧([\d.]+)", each.text)
                mouth = float(each.centre_in_rig[axis])
                deep = float(found[1]) if found else each.cut_mm
                joined.append([round(mouth, 2), round(mouth + deep * float(each.axis_in_rig[axis]), 2)])
            else:
                # The sides of slots and pockets.
                half = each.diameter_mm / 2.0
                known |= {round(float(each.centre_in_rig[axis]) + side * half, 2) for side in (-1.0, 1.0)}
        for _ in planes:
            for ends_of_one in joined:
                if any(abs(place - end) < 0.02 for place in known for end in ends_of_one):
                    known |= set(ends_of_one)
            known |= {round(sum(size) - place, 2) for place in known}
        unknown = [plane for plane in sorted(planes) if min(abs(plane - place) for place in known) > 0.02]
        assert unknown == [], "xyz"[axis]


@pytest.mark.slow
def test_files_are_real_and_the_same_in_another_process(block: Callable[..., PartPlan], tmp_path: Path) -> None:
    part = block()
    svg, pdf = write_drawing(tmp_path / "a", part.make(part.plan), part, HARDWARE.printer)
    root = ET.parse(svg).getroot()
    assert (root.get("width"), root.get("height")) == ("1190.551181pt", "841.889764pt")
    assert len(root.findall(f".//{SVG}path")) > 20
    assert pdf.read_bytes().startswith(b"%PDF-")
    assert b"/MediaBox [ 0 0 1190.5511811024 841.8897637795 ]" in pdf.read_bytes()
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path;"
        "from tests.cad.guide.conftest import block_part;"
        "from mirrorcam.cad.plan.hardware import HARDWARE; from mirrorcam.cad.guide.drawing import write_drawing;"
        "part = block_part();"
        "write_drawing(Path(sys.argv[2]), part.make(part.plan), part, HARDWARE.printer)"
    )
    subprocess.run([sys.executable, "-c", program, str(ROOT), str(tmp_path / "b")], check=True)
    for path in (svg, pdf):
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
