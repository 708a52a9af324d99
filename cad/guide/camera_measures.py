"""The drawing for measuring a camera: its body to scale, with a letter and the current value of every measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.guide.dimension_lines import LinearDimension, draw_tiers
from mirrorcam.cad.guide.drawing_sheet import SOFT, DrawingSheet, fitted_text, text_width_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody

A4_MM = (297.0, 210.0)
EDGE_MM, AXIS_MM, DASHED_MM = 0.35, 0.13, 0.2
HIDDEN_MM, CHAIN_MM = (1.6, 0.8), (2.4, 0.6, 0.6, 0.6)
TEXT_MM, TITLE_MM, ROW_MM = 2.5, 4.0, 6.2
DIMENSIONS_MM = 34.0
"""Free space for dimensions left of and below each view."""


@dataclass(frozen=True)
class Measurement:
    """A measurement of a camera: its letter in the drawing, its field in `CameraBody`, and how it is measured."""

    letter: str
    field: str
    description: str
    method: str


MEASUREMENTS = (
    Measurement("A", "width_mm", "width of the body, parallel to the picture's rows", "calipers"),
    Measurement("B", "height_mm", "height of the body, parallel to the picture's columns", "calipers"),
    Measurement("C", "depth_mm", "depth of the body, without lens ring and stand", "calipers"),
    Measurement("D", "end_radius_mm", "radius of the body's four edges; 0 if they are sharp", "radius gauge, or coins"),
    Measurement("E", "lens_x_mm", "lens axis to the right of the body's centre", "calipers, from both ends"),
    Measurement("F", "lens_y_mm", "lens axis below the body's centre", "calipers, from both sides"),
    Measurement("G", "lens_ring_mm", "diameter of the lens ring or barrel", "calipers"),
    Measurement("H", "lens_protrusion_mm", "lens ring or barrel in front of the body", "depth rod of the calipers"),
    Measurement(
        "J", "pupil_behind_front_mm", "entrance pupil behind the front", "two photographs of a ruler, see guide"
    ),
    Measurement("K", "cable_mm", "diameter of the cable", "calipers"),
    Measurement("L", "cable_x_mm", "cable to the right of the lens axis, at the back", "ruler"),
    Measurement("M", "hinge_mm", "width of a protrusion on a side, such as a stand; 0 for none", "calipers"),
    Measurement("N", "hinge_from_back_mm", "depth of that protrusion, from the back", "calipers"),
    Measurement("P", "mass_g", "mass without its cable, g", "kitchen scale"),
)
"""All measurements of a camera, in the order of the questions; the letters I and O are skipped."""


def draw_camera(body: CameraBody) -> DrawingSheet:
    """Draw a camera on an A4 sheet: from behind (like its pictures), from the right, and a table of its measurements.

    The views are to scale; `guessed` measurements are marked.
    """
    sheet = DrawingSheet(*A4_MM)
    width = body.width_mm + body.depth_mm + max(body.lens_protrusion_mm, 0.0)
    # The largest scale at which both views with their dimensions fit above the table.
    scale = min(
        (A4_MM[0] - 2.0 * DIMENSIONS_MM - 52.0) / width,
        (A4_MM[1] - 6.0 - DIMENSIONS_MM - _table_mm() - 20.0) / body.height_mm,
        4.0,
    )
    lower_y = _table_mm() + DIMENSIONS_MM
    _from_behind(sheet, body, scale, np.array([DIMENSIONS_MM + 6.0, lower_y]))
    _from_the_side(sheet, body, scale, np.array([2.0 * DIMENSIONS_MM + 14.0 + scale * body.width_mm, lower_y]))
    name = fitted_text(body.name, 120.0, TITLE_MM)
    sheet.text((12.0, A4_MM[1] - 16.0), f"{name}: where to measure, {scale:.2g} : 1", TITLE_MM, bold=True)
    _table(sheet, body)
    return sheet


def _from_behind(sheet: DrawingSheet, body: CameraBody, scale: float, low: FloatArray) -> None:
    """Draw the body from behind: lens on the far side, cable on the near side, lower left corner at `low` (2,)."""
    size = scale * np.array([body.width_mm, body.height_mm])
    sheet.lines([low + _rounded(size, scale * body.end_radius_mm)], EDGE_MM)
    centre = low + size / 2.0
    # y of the body is down.
    lens = centre + scale * np.array([body.lens_x_mm, -body.lens_y_mm])
    cable = np.array([lens[0] + scale * body.cable_x_mm, centre[1] - scale * body.cable_y_mm])
    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    sheet.lines([lens + scale * body.lens_ring_mm / 2.0 * circle], DASHED_MM, SOFT, HIDDEN_MM)
    sheet.lines([cable + scale * body.cable_mm / 2.0 * circle], EDGE_MM)
    for point, half_length in ((lens, scale * body.lens_ring_mm / 2.0 + 3.0), (centre, 5.0)):
        cross = [np.array([point - arm, point + arm]) for arm in half_length * np.eye(2)]
        sheet.lines(cross, AXIS_MM, SOFT, CHAIN_MM)
    bottom = np.full(2, low[1])
    below = [
        LinearDimension(np.array([low[0], low[0] + size[0]]), bottom, _label("A", body.width_mm)),
        LinearDimension(np.sort([lens[0], centre[0]]), np.array([lens[1], centre[1]]), _label("E", body.lens_x_mm)),
        LinearDimension(np.sort([lens[0], cable[0]]), np.array([lens[1], cable[1]]), _label("L", body.cable_x_mm)),
    ]
    left = [
        LinearDimension(np.array([low[1], low[1] + size[1]]), np.full(2, low[0]), _label("B", body.height_mm)),
        LinearDimension(np.sort([lens[1], centre[1]]), np.array([lens[0], centre[0]]), _label("F", body.lens_y_mm)),
    ]
    _draw(sheet, np.array([low, low + size]), below, left)
    ring_label = lens + (0.75 * scale * body.lens_ring_mm / 2.0 + 1.0) * np.ones(2)
    sheet.text(ring_label, f"Ø {_label('G', body.lens_ring_mm)}", TEXT_MM, over_lines=True)
    caption = low + size * (0.5, 1.0) + np.array([0.0, 3.0])
    sheet.text(caption, "from behind: left and right as in the picture", TEXT_MM, align="center", colour=SOFT)


def _from_the_side(sheet: DrawingSheet, body: CameraBody, scale: float, low: FloatArray) -> None:
    """Draw the body from its right side: front to the right, lower left corner at `low` (2,)."""
    size = scale * np.array([body.depth_mm, body.height_mm])
    front = low[0] + size[0]
    sheet.rectangle((low[0], low[1]), (front, low[1] + size[1]), EDGE_MM)
    axis_y = low[1] + size[1] / 2.0 - scale * body.lens_y_mm
    radius, tip = scale * body.lens_ring_mm / 2.0, front + scale * body.lens_protrusion_mm
    sheet.lines(
        [
            np.array(
                [(front, axis_y - radius), (tip, axis_y - radius), (tip, axis_y + radius), (front, axis_y + radius)]
            )
        ],
        EDGE_MM,
    )
    sheet.lines([np.array([(low[0] - 4.0, axis_y), (tip + 8.0, axis_y)])], AXIS_MM, SOFT, CHAIN_MM)
    pupil = front - scale * body.pupil_behind_front_mm
    sheet.lines([np.array([(pupil, axis_y - 3.0), (pupil, axis_y + 3.0)])], 0.6)
    bottom = np.full(2, low[1])
    below = [
        LinearDimension(np.array([low[0], front]), bottom, _label("C", body.depth_mm)),
        LinearDimension(np.sort([pupil, front]), np.array([axis_y, low[1]]), _label("J", body.pupil_behind_front_mm)),
    ]
    if body.lens_protrusion_mm > 0.0:
        text = _label("H", body.lens_protrusion_mm)
        below.append(LinearDimension(np.array([front, tip]), np.array([low[1], axis_y - radius]), text))
    if body.hinge_mm > 0.0:
        end = low[0] + scale * body.hinge_from_back_mm
        foot = [(low[0], low[1]), (low[0], low[1] - 4.0), (end, low[1] - 4.0), (end, low[1])]
        sheet.lines([np.array(foot)], DASHED_MM, SOFT, HIDDEN_MM)
        below.append(LinearDimension(np.array([low[0], end]), bottom - 4.0, _label("N", body.hinge_from_back_mm)))
    _draw(sheet, np.array([low, low + size]), below, [])
    text = "from the right; bar: pupil"
    centre_x = min(low[0] + size[0] / 2.0, A4_MM[0] - 12.0 - text_width_mm(text, TEXT_MM) / 2.0)
    sheet.text((centre_x, low[1] + size[1] + 3.0), text, TEXT_MM, align="center", colour=SOFT)


def _draw(
    sheet: DrawingSheet, extent: FloatArray, below: Sequence[LinearDimension], left: Sequence[LinearDimension]
) -> None:
    """Draw dimensions below a view and left of it; those of 0 appear only in the table."""
    draw_tiers(sheet, extent, [linear for linear in below if linear.span > 0.2], DIMENSIONS_MM, vertical=False)
    draw_tiers(sheet, extent, [linear for linear in left if linear.span > 0.2], DIMENSIONS_MM, vertical=True)


def _label(letter: str, value: float) -> str:
    return f"{letter} {value:g}"


def _rounded(size: FloatArray, radius: float) -> FloatArray:
    """The outline (n, 2) of a rectangle with rounded corners and its lower left corner at the origin."""
    radius = min(radius, float(size.min()) / 2.0)
    angles = np.linspace(0.0, np.pi / 2.0, 19)
    arc = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    corners = []
    for quarter, (x, y) in enumerate(((1, 1), (0, 1), (0, 0), (1, 0))):
        cosine, sine = np.cos(quarter * np.pi / 2.0), np.sin(quarter * np.pi / 2.0)
        centre = np.array([size[0] - radius if x else radius, size[1] - radius if y else radius])
        corners.append(centre + arc @ np.array([(cosine, sine), (-sine, cosine)]))
    outline = np.concatenate(corners)
    return np.concatenate([outline, outline[:1]])


def _table_mm() -> float:
    """Height of the table of measurements."""
    return 18.0 + ROW_MM * (len(MEASUREMENTS) / 2.0)


def _table(sheet: DrawingSheet, body: CameraBody) -> None:
    """Draw all measurements in two columns, with their values; guessed values have a question mark."""
    half = (len(MEASUREMENTS) + 1) // 2
    for index, measurement in enumerate(MEASUREMENTS):
        x = 12.0 + (A4_MM[0] - 20.0) / 2.0 * (index // half)
        y = _table_mm() - 4.0 - ROW_MM * (index % half)
        value = f"{getattr(body, measurement.field):g}{' ?' if measurement.field in body.guessed else ''}"
        sheet.text((x, y), measurement.letter, TEXT_MM, bold=True)
        sheet.text((x + 21.0, y), value, TEXT_MM, align="right")
        sheet.text((x + 25.0, y), f"{measurement.description}: {measurement.method}", 1.9, colour=SOFT)
