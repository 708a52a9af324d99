"""A drawing sheet in mm from its lower left corner: lines, arrows, text, border and title block, as SVG and PDF.

The title block has title, number, revision, date, scale and the general tolerance.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.patches import Circle, Polygon
from matplotlib.textpath import TextPath

from mirrorcam.cad.plan.dimension import GENERAL_MM
from mirrorcam.cad.plan.part_plan import LICENCE
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import drawable, fitted
from mirrorcam.core.values import FloatArray

MM_PER_INCH = 25.4
POINTS_PER_MM = 72.0 / MM_PER_INCH
FONT = FontProperties(family="DejaVu Sans")
BOLD = FontProperties(family="DejaVu Sans", weight="bold")
# Ratio of the height of capitals to the font size.
CAP_HEIGHT = 0.73
INK = "#10151f"
SOFT = "#8b94a5"
ARROW_MM = (2.6, 0.42)
Align = Literal["left", "center", "right"]


@dataclass(frozen=True)
class TextBox:
    """A label on the sheet, and the corners (4, 2), mm, of its area; `over_lines`: it hides the lines under it."""

    text: str
    corners: FloatArray
    over_lines: bool = False


def text_width_mm(text: str, height_mm: float, *, bold: bool = False) -> float:
    """Width of text whose capitals are about `height_mm` high."""
    return _width_of_size_1(text, bold) * height_mm / CAP_HEIGHT


def fitted_text(text: str, width_mm: float, height_mm: float) -> str:
    """Text truncated to a width, with placeholders for characters that the font lacks."""
    printable = drawable(text, get_font(findfont(FONT)).get_charmap())
    return fitted(printable, width_mm, lambda part: text_width_mm(part, height_mm))


@cache
def _width_of_size_1(text: str, bold: bool) -> float:
    if not text.strip():
        return 0.0  # matplotlib makes no path without a glyph
    corners = TextPath((0.0, 0.0), text.replace("$", r"\$"), size=100.0, prop=BOLD if bold else FONT).vertices
    return float(np.ptp(corners[:, 0])) / 100.0


class DrawingSheet:
    """A drawing sheet of `width_mm` x `height_mm`.

    It records its labels, its lines with their widths, and the tips and directions (2, 2) of its arrows.
    """

    def __init__(self, width_mm: float, height_mm: float) -> None:
        self.size_mm = (width_mm, height_mm)
        self.text_boxes: list[TextBox] = []
        self.drawn_lines: list[tuple[FloatArray, float]] = []
        self.arrows: list[FloatArray] = []
        self._figure = Figure(figsize=(width_mm / MM_PER_INCH, height_mm / MM_PER_INCH))
        self._axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self._axes.set(xlim=(0.0, width_mm), ylim=(0.0, height_mm))
        self._axes.axis("off")

    def lines(
        self, lines: Sequence[FloatArray], width_mm: float, colour: str = INK, dashes_mm: Sequence[float] = ()
    ) -> None:
        """Draw polylines (n, 2); `dashes_mm` are alternately lengths of dashes and gaps."""
        self.drawn_lines += [(line, width_mm) for line in lines]
        width = width_mm * POINTS_PER_MM
        style: Any = (0.0, [dash / width_mm for dash in dashes_mm]) if dashes_mm else "solid"
        collection = LineCollection(
            [np.asarray(line) for line in lines],
            linewidths=width,
            colors=colour,
            linestyles=[style],
            capstyle="butt" if dashes_mm else "round",
            joinstyle="round",
        )
        self._axes.add_collection(collection, autolim=False)

    def rectangle(self, low: tuple[float, float], high: tuple[float, float], width_mm: float) -> None:
        """Draw a rectangle parallel to the sheet's edges, between two corners."""
        (x0, y0), (x1, y1) = low, high
        self.lines([np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])], width_mm)

    def arrow_head(self, tip: FloatArray, direction: FloatArray) -> None:
        """Draw a filled arrow head that points along `direction` (2,), with its tip at `tip` (2,)."""
        axis = direction / np.linalg.norm(direction)
        self.arrows.append(np.array([tip, axis]))
        normal = np.array([-axis[1], axis[0]])
        length, half = ARROW_MM
        corners = [tip, tip - length * axis + half * normal, tip - length * axis - half * normal]
        self._axes.add_patch(Polygon(corners, closed=True, facecolor=INK, edgecolor="none"))

    def dot(self, centre: FloatArray, radius: float) -> None:
        """Draw a filled dot at `centre` (2,), the end of a leader within an outline."""
        self._axes.add_patch(Circle((float(centre[0]), float(centre[1])), radius, facecolor=INK, edgecolor="none"))

    def text(
        self,
        start: FloatArray | tuple[float, float],
        text: str,
        height_mm: float,
        *,
        align: Align = "left",
        bold: bool = False,
        colour: str = INK,
        rotation_deg: float = 0.0,
        over_lines: bool = False,
    ) -> None:
        """Draw a line of text with its baseline at `start` (2,), rotated about it; 90 deg reads from the right.

        `over_lines` clears the paper behind it.
        """
        width = text_width_mm(text, height_mm, bold=bold)
        self._axes.text(
            float(start[0]),
            float(start[1]),
            text,
            parse_math=False,
            fontproperties=BOLD if bold else FONT,
            fontsize=height_mm / CAP_HEIGHT * POINTS_PER_MM,
            ha=align,
            va="baseline",
            rotation=rotation_deg,
            rotation_mode="anchor",
            color=colour,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0} if over_lines else None,
        )
        left = {"left": 0.0, "center": -width / 2.0, "right": -width}[align]
        low, high = -0.25 * height_mm, 1.05 * height_mm
        corners = np.array([(left, low), (left + width, low), (left + width, high), (left, high)])
        cosine, sine = np.cos(np.deg2rad(rotation_deg)), np.sin(np.deg2rad(rotation_deg))
        corners = corners @ np.array([(cosine, sine), (-sine, cosine)])
        self.text_boxes.append(TextBox(text, corners + np.asarray(start), over_lines))

    def occupied(self) -> tuple[shapely.STRtree, shapely.STRtree]:
        """The areas of all labels, and all lines, mm, to search."""
        texts = [shapely.Polygon(box.corners) for box in self.text_boxes]
        return shapely.STRtree(texts), shapely.STRtree([shapely.LineString(line) for line, _ in self.drawn_lines])

    def write(self, stem: Path, title: str) -> tuple[Path, Path]:
        """Write STEM.svg and STEM.pdf, and return their paths; the same sheet gives the same bytes."""
        metadata_by_format: dict[str, dict[str, Any]] = {
            "svg": {"Date": None, "Creator": "MirrorCam", "Title": title},
            "pdf": {"CreationDate": None, "Creator": "MirrorCam", "Producer": None, "Title": title},
        }
        settings: dict[Any, Any] = {"svg.hashsalt": "mirrorcam", "svg.fonttype": "path", "pdf.fonttype": 42}
        svg, pdf = (stem.with_suffix(f".{kind}") for kind in metadata_by_format)
        with mpl.rc_context(settings):
            for path, (kind, metadata) in zip((svg, pdf), metadata_by_format.items(), strict=True):
                with atomic(path) as temporary:
                    self._figure.savefig(temporary, format=kind, metadata=metadata)
        return svg, pdf


def overlaps(area: shapely.Geometry, *drawn: shapely.STRtree) -> tuple[int, ...]:
    """For each part of a sheet, the number of its geometries that an area intersects."""
    return tuple(len(tree.query(area, predicate="intersects")) for tree in drawn)


A3_MM = (420.0, 297.0)
BORDER_MM = 10.0
BLOCK_MM = 26.0
FIELD_MM = np.array([(0.0, BLOCK_MM), A3_MM]) + np.array([[1.0], [-1.0]]) * (BORDER_MM + 4.0)
"""Lowest and highest corner (2, 2) of the drawing field, clear of the border and the title block."""

FRAME_MM, OUTLINE_MM, AXIS_MM = 0.5, 0.35, 0.13
AXIS_COLOUR = "#5d6778"
VALUE_MM, MODEL_TEXT_MM = 2.8, 2.5
MATERIAL_MM, TOLERANCE_MM = 56.0, 98.0
"""Widths of the fields of the material and of the general tolerance."""

GENERAL_TOLERANCE = f"± {GENERAL_MM:g}; angles ± 0.5° (ISO 8015)"
"""General tolerance of dimensions without their own tolerance, in the title block only."""

GAUGE_TOLERANCE = "none: gauges, used as printed"
PARTS_TOLERANCE = "on the drawings of the parts"
MODEL = "Undimensioned: see model (ISO 16792)"
MODEL_MM = 62.0
"""Width of the field of the model."""

UNDATED = "undated"
EPOCH = "SOURCE_DATE_EPOCH"


@dataclass(frozen=True)
class Title:
    """Entries of a title block; `revision` is the part's identity.

    `model` is the file that defines all features without dimensions.
    """

    title: str
    number: str
    material: str
    scale: float | None
    revision: str
    model: str
    tolerance: str = GENERAL_TOLERANCE


def issue_date() -> str:
    """The date of drawings in ISO 8601, from SOURCE_DATE_EPOCH; undated without it, so that bytes are reproducible.

    Raises InputError if that variable is not an integer number of seconds.
    """
    seconds = os.environ.get(EPOCH)
    if seconds is None:
        return UNDATED
    try:
        return datetime.fromtimestamp(int(seconds), UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):
        raise InputError(f"{EPOCH} is {seconds[:40]!r}, expected an integer number of seconds since 1970") from None


def printed_material(plastic: str) -> str:
    """The material of a printed part, with the plastic's name truncated to fit the field."""
    printed = ", printed"
    return fitted_text(plastic, MATERIAL_MM - 4.0 - text_width_mm(printed, VALUE_MM), VALUE_MM) + printed


def draw_title_block(sheet: DrawingSheet, title: Title) -> None:
    """Draw the border and the title block of an A3 sheet."""
    right, border_top = A3_MM[0] - BORDER_MM, A3_MM[1] - BORDER_MM
    sheet.rectangle((BORDER_MM, BORDER_MM), (right, border_top), FRAME_MM)
    top_edge = BORDER_MM + BLOCK_MM
    sheet.lines([np.array([(BORDER_MM, top_edge), (right, top_edge)])], FRAME_MM)
    columns: tuple[tuple[float, tuple[tuple[str, str, bool], ...]], ...] = (
        (90.0, (("Title", title.title, True), ("Project", "MirrorCam", False))),
        (40.0, (("Drawing number", title.number, True), ("Sheet", "1 / 1, A3", False))),
        (MATERIAL_MM, (("Material", title.material, False), ("Licence", LICENCE, False))),
        (52.0, (("Scale (views)", ratio(title.scale), True), ("Date", issue_date(), False))),
        (TOLERANCE_MM, (("General tolerance, mm", title.tolerance, False), ("Revision", title.revision, False))),
    )
    x = BORDER_MM
    for width, fields in columns:
        for row, (label, value, bold) in enumerate(fields):
            y = top_edge - 13.0 * row
            sheet.text((x + 2.0, y - 4.0), label, 1.8, colour=SOFT)
            sheet.text((x + 2.0, y - 10.0), value, 3.5 if bold else VALUE_MM, bold=bold)
        x += width
        sheet.lines([np.array([(x, BORDER_MM), (x, top_edge)])], 0.25)
    sheet.lines([np.array([(BORDER_MM, top_edge - 13.0), (x, top_edge - 13.0)])], 0.25)
    x_model = BORDER_MM + 90.0 - MODEL_MM
    sheet.lines([np.array([(x_model, BORDER_MM), (x_model, top_edge - 13.0)])], 0.25)
    sheet.text((x_model + 2.0, top_edge - 17.0), MODEL, 1.8, colour=SOFT)
    sheet.text((x_model + 2.0, top_edge - 23.0), fitted_text(title.model, MODEL_MM - 4.0, MODEL_TEXT_MM), MODEL_TEXT_MM)
    sheet.text((x + 2.0, top_edge - 4.0), "Projection: third angle", 1.8, colour=SOFT)
    _third_angle(sheet, np.array([(x + right) / 2.0, BORDER_MM + 10.0]))


def ratio(scale: float | None) -> str:
    """A scale as in ISO 5455; None is "not to scale"."""
    if scale is None:
        return "not to scale"
    return f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"


def _third_angle(sheet: DrawingSheet, centre: FloatArray) -> None:
    """Draw the symbol of third-angle projection: the circles of a cone on the left, its side on the right."""
    angles = np.linspace(0.0, 2.0 * np.pi, 65)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    left, right = centre + np.array([[-11.0, 0.0], [9.0, 0.0]])
    cone = np.array([(-6.0, 2.2), (6.0, 4.4), (6.0, -4.4), (-6.0, -2.2), (-6.0, 2.2)])
    sheet.lines([left + 4.4 * circle, left + 2.2 * circle, right + cone], OUTLINE_MM)
    axis = np.array([(-18.0, 0.0), (18.0, 0.0)])
    dashes = (2.4, 0.5, 0.5, 0.5)
    sheet.lines([centre + axis, left + np.array([(0.0, -5.8), (0.0, 5.8)])], AXIS_MM, AXIS_COLOUR, dashes)
