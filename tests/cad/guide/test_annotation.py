"""Annotations: an oblique length has an aligned dimension.

Geometrical tolerances: the holder's zones from the figures as built, frames, datums.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.annotation import (
    GeometricalTolerance,
    draw_datum,
    draw_frames,
    holder_tolerances,
    tolerance_notes,
)
from mirrorcam.cad.guide.drawing import draw
from mirrorcam.cad.guide.drawing_sheet import DrawingSheet
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.optics.geometry.tolerances import Tolerances


@dataclass(frozen=True)
class Dimensions:
    """A plan with nothing but dimensions."""

    dimensions: tuple[Length | Hole, ...]


def test_an_oblique_length_has_its_dimension_line_parallel_to_it_off_the_part(block: Callable[..., PartPlan]) -> None:
    part = block()
    ends = np.array([(-30.0, -15.0, 5.0), (10.0, 15.0, 5.0)])
    askew, level = Length(ends, "askew"), Length(ends, "across", np.array([1.0, 0.0, 0.0]))
    plan = Dimensions((askew, level))
    sheet = draw(part.make(part.plan), replace(part, plan=plan), HARDWARE.printer)
    texts = {box.text: box.corners for box in sheet.text_boxes}
    assert {"50 askew", "40 across"} <= set(texts)
    base = texts["50 askew"][1] - texts["50 askew"][0]
    assert np.degrees(np.arctan2(base[1], base[0])) == pytest.approx(np.degrees(np.arctan2(30.0, 40.0)), abs=0.1)
    assert texts["40 across"][1, 1] == pytest.approx(texts["40 across"][0, 1])


def test_the_zones_of_the_seats_keep_the_mirrors_as_built(device: Device) -> None:
    built = Tolerances(tilt_deg=0.5, offset_mm=0.2)
    back, angle, place = holder_tolerances(device.holder, built)
    # A mirror on pads at the limits of the zone is tilted by at most its tolerance, the worst one by almost as much.
    tilts = []
    for mirror, pads in zip(device.layout.mirrors, device.holder.pads_of_mirrors, strict=True):
        for signs in product((-0.5, 0.5), repeat=3):
            points = [
                pad.top.mean(axis=0) + sign * angle.zone_mm * mirror.normal_in_rig
                for pad, sign in zip(pads, signs, strict=True)
            ]
            normal = np.cross(points[1] - points[0], points[2] - points[0])
            sine = np.linalg.norm(np.cross(normal, mirror.normal_in_rig)) / np.linalg.norm(normal)
            tilts.append(float(np.degrees(np.arcsin(sine))))
    assert 0.8 * 0.5 < max(tilts) <= 0.5
    assert (angle.characteristic, angle.datums) == ("angularity", ("A", "B"))
    assert (place.characteristic, place.zone_mm, place.datums) == ("profile", 0.4, ("A", "B"))
    assert (back.characteristic, back.zone_mm, back.datums) == ("flatness", angle.zone_mm, ())
    assert angle.features == f"{len(device.layout.mirrors)}x seat"


def test_what_frames_tolerate_is_theoretically_exact() -> None:
    """Otherwise the positions and tilts of seats would also have the general tolerance, which is wider."""
    assert any("theoretically exact" in note for note in tolerance_notes(Tolerances()))


def test_frames_say_symbol_zone_and_datums_and_end_where_they_say() -> None:
    sheet = DrawingSheet(200.0, 100.0)
    tolerances = (
        GeometricalTolerance("3x seat", "profile", 0.6, ("A", "B")),
        GeometricalTolerance("a", "flatness", 0.1),
    )
    end = draw_frames(sheet, 10.0, 90.0, tolerances, ("a note",))
    assert [box.text for box in sheet.text_boxes[1:]] == ["3x seat", "0.6", "A", "B", "a", "0.1", "a note"]
    assert min(float(box.corners[:, 1].min()) for box in sheet.text_boxes) > end
    # A box per cell and a symbol per frame.
    assert len(sheet.drawn_lines) == 4 + 1 + 2 + 1


def test_a_datum_stands_on_its_line_with_its_letter_off_it() -> None:
    for way in (1.0, -1.0):
        sheet = DrawingSheet(100.0, 100.0)
        draw_datum(sheet, np.array([50.0, 50.0]), way, "A")
        (box,) = sheet.text_boxes
        assert box.text == "A"
        assert np.sign(box.corners[:, 1] - 50.0).tolist() == [way] * 4
