"""Border and title block of a drawing: title, number, revision, date, scale, and the one general tolerance."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from mirrorcam.cad.guide.drawing_sheet import SOFT, DrawingSheet, fitted_text, text_width_mm
from mirrorcam.cad.plan.part_plan import LICENCE
from mirrorcam.core.values import FloatArray, InputError

A3_MM = (420.0, 297.0)
BORDER_MM = 10.0
BLOCK_MM = 26.0
FRAME_MM, OUTLINE_MM, AXIS_MM = 0.5, 0.35, 0.13
AXIS_COLOUR = "#5d6778"
VALUE_MM, MODEL_TEXT_MM = 2.8, 2.5
MATERIAL_MM, TOLERANCE_MM = 56.0, 98.0
"""Widths of the fields of the material and of the general tolerance."""

GENERAL_TOLERANCE = "± 0.2; angles ± 0.5° (ISO 8015)"
"""Of every dimension in mm and degrees that has no tolerance of its own; stated nowhere else on a drawing."""

GAUGE_TOLERANCE = "none: gauges, used as printed"
PARTS_TOLERANCE = "on the drawings of the parts"
MODEL = "Not dimensioned: as the model (ISO 16792)"
MODEL_MM = 62.0
"""Width of the field of the model."""

UNDATED = "undated"
EPOCH = "SOURCE_DATE_EPOCH"


@dataclass(frozen=True)
class Title:
    """What a title block says; `revision` is the identity of the numbers that the drawing was made of.

    `model` is the file with the shape of what the drawing does not dimension.
    """

    title: str
    number: str
    material: str
    scale: float | None
    revision: str
    model: str
    tolerance: str = GENERAL_TOLERANCE


def issue_date() -> str:
    """The date that drawings bear, as in ISO 8601: that of SOURCE_DATE_EPOCH, or none, so that bytes stay the same.

    Raises InputError where that variable is no whole number of seconds.
    """
    seconds = os.environ.get(EPOCH)
    if seconds is None:
        return UNDATED
    try:
        return datetime.fromtimestamp(int(seconds), UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):
        raise InputError(f"{EPOCH} is {seconds[:40]!r}, expected whole seconds since 1970") from None


def printed_of(plastic: str) -> str:
    """The material of a printed part, the name of the plastic cut to its field."""
    printed = ", printed"
    return fitted_text(plastic, MATERIAL_MM - 4.0 - text_width_mm(printed, VALUE_MM), VALUE_MM) + printed


def draw_title_block(sheet: DrawingSheet, said: Title) -> None:
    """Draw the border and the title block of an A3 sheet."""
    right, top = A3_MM[0] - BORDER_MM, A3_MM[1] - BORDER_MM
    sheet.rectangle((BORDER_MM, BORDER_MM), (right, top), FRAME_MM)
    head = BORDER_MM + BLOCK_MM
    sheet.lines([np.array([(BORDER_MM, head), (right, head)])], FRAME_MM)
    columns: tuple[tuple[float, tuple[tuple[str, str, bool], ...]], ...] = (
        (90.0, (("Title", said.title, True), ("Project", "MirrorCam", False))),
        (40.0, (("Drawing number", said.number, True), ("Sheet", "1 / 1, A3", False))),
        (MATERIAL_MM, (("Material", said.material, False), ("Licence", LICENCE, False))),
        (52.0, (("Scale (views)", ratio(said.scale), True), ("Date", issue_date(), False))),
        (TOLERANCE_MM, (("General tolerance, mm", said.tolerance, False), ("Revision", said.revision, False))),
    )
    x = BORDER_MM
    for width, fields in columns:
        for row, (label, value, bold) in enumerate(fields):
            y = head - 13.0 * row
            sheet.text((x + 2.0, y - 4.0), label, 1.8, colour=SOFT)
            sheet.text((x + 2.0, y - 10.0), value, 3.5 if bold else VALUE_MM, bold=bold)
        x += width
        sheet.lines([np.array([(x, BORDER_MM), (x, head)])], 0.25)
    sheet.lines([np.array([(BORDER_MM, head - 13.0), (x, head - 13.0)])], 0.25)
    x_model = BORDER_MM + 90.0 - MODEL_MM
    sheet.lines([np.array([(x_model, BORDER_MM), (x_model, head - 13.0)])], 0.25)
    sheet.text((x_model + 2.0, head - 17.0), MODEL, 1.8, colour=SOFT)
    sheet.text((x_model + 2.0, head - 23.0), fitted_text(said.model, MODEL_MM - 4.0, MODEL_TEXT_MM), MODEL_TEXT_MM)
    sheet.text((x + 2.0, head - 4.0), "Projection: third angle", 1.8, colour=SOFT)
    _third_angle(sheet, np.array([(x + right) / 2.0, BORDER_MM + 10.0]))


def ratio(scale: float | None) -> str:
    """A scale as ISO 5455 writes it; one that is of no standard is not to be measured."""
    if scale is None:
        return "not to scale"
    return f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"


def _third_angle(sheet: DrawingSheet, middle: FloatArray) -> None:
    """The symbol of third-angle projection: the circles of a cone on the left, its side on the right."""
    turn = np.linspace(0.0, 2.0 * np.pi, 65)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    left, side = middle + np.array([[-11.0, 0.0], [9.0, 0.0]])
    cone = np.array([(-6.0, 2.2), (6.0, 4.4), (6.0, -4.4), (-6.0, -2.2), (-6.0, 2.2)])
    sheet.lines([left + 4.4 * circle, left + 2.2 * circle, side + cone], OUTLINE_MM)
    axis = np.array([(-18.0, 0.0), (18.0, 0.0)])
    dashes = (2.4, 0.5, 0.5, 0.5)
    sheet.lines([middle + axis, left + np.array([(0.0, -5.8), (0.0, 5.8)])], AXIS_MM, AXIS_COLOUR, dashes)
