"""Geometrical tolerances: the holder's zones from the figures as built, frames, datums."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.drawing_sheet import DrawingSheet
from mirrorcam.cad.guide.geometrical_tolerances import (
    GeometricalTolerance,
    draw_datum,
    draw_frames,
    holder_tolerances,
    tolerance_notes,
)
from mirrorcam.optics.geometry.tolerances import Tolerances


def test_the_zones_of_the_seats_keep_the_mirrors_as_built(device: Device) -> None:
    built = Tolerances(tilt_deg=0.5, offset_mm=0.2)
    back, angle, place = holder_tolerances(device.holder, built)
    # The smallest seat, as a square: its tilt in the zone is no more than that of a mirror.
    local = [core.top - core.top.mean(axis=0) for core in device.holder.cores]
    areas = [Polygon(corners @ np.linalg.svd(corners)[2][:2].T).area for corners in local]
    side = float(np.sqrt(min(areas)))
    assert np.degrees(np.arctan(angle.zone_mm / side)) == pytest.approx(0.5, rel=0.05)
    assert (angle.characteristic, angle.datums) == ("angularity", ("A", "B"))
    assert (place.characteristic, place.zone_mm, place.datums) == ("profile", 0.4, ("A", "B"))
    assert (back.characteristic, back.zone_mm, back.datums) == ("flatness", angle.zone_mm, ())
    assert angle.of == f"{len(device.layout.mirrors)}x seat"


def test_what_frames_tolerate_is_theoretically_exact() -> None:
    """Else the seats' places and tilts would have the general tolerance as well, which is wider."""
    assert any("theoretically exact" in note for note in tolerance_notes(Tolerances()))


def test_frames_say_symbol_zone_and_datums_and_end_where_they_say() -> None:
    sheet = DrawingSheet(200.0, 100.0)
    tolerances = (
        GeometricalTolerance("3x seat", "profile", 0.6, ("A", "B")),
        GeometricalTolerance("a", "flatness", 0.1),
    )
    end = draw_frames(sheet, 10.0, 90.0, tolerances, ("a note",))
    assert [words.text for words in sheet.words[1:]] == ["3x seat", "0.6", "A", "B", "a", "0.1", "a note"]
    assert min(float(words.corners[:, 1].min()) for words in sheet.words) > end
    # A box per cell and a symbol per frame.
    assert len(sheet.drawn) == 4 + 1 + 2 + 1


def test_a_datum_stands_on_its_line_with_its_letter_off_it() -> None:
    for way in (1.0, -1.0):
        sheet = DrawingSheet(100.0, 100.0)
        draw_datum(sheet, np.array([50.0, 50.0]), way, "A")
        (words,) = sheet.words
        assert words.text == "A"
        assert np.sign(words.corners[:, 1] - 50.0).tolist() == [way] * 4
