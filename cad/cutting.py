"""The flat mirrors as one DXF for a laser cutter: outlines on CUT, id and up arrow on ENGRAVE, the reading on NOTES.

Everything is drawn as seen from the *back* of the sheet, the side that is engraved and then glued into its seat; laid
out as in the finished holder seen from behind: row 0 on top, columns from left to right, every arrow up.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ezdxf import options  # type: ignore[attr-defined]  # public, but ezdxf does not declare what it exports
from ezdxf.document import Drawing
from ezdxf.filemanagement import new
from shapely import Polygon, maximum_inscribed_circle

from cad.hardware import Hardware
from optics.files import atomic
from optics.layout import Layout
from optics.mirror import Mirror
from optics.values import FloatArray

DXF_MM = 4
NOTE = "MirrorCam mirrors, seen from the back (engraved side up), lengths in mm, outlines without kerf allowance"

# Corners of a seven-segment digit, one wide and two high, and the strokes that draw each sign through them.
STROKES: dict[str, tuple[tuple[tuple[float, float], ...], ...]] = {
    "0": (((0, 0), (1, 0), (1, 2), (0, 2), (0, 0)),),
    "1": (((1, 0), (1, 2)),),
    "2": (((0, 2), (1, 2), (1, 1), (0, 1), (0, 0), (1, 0)),),
    "3": (((0, 2), (1, 2), (1, 0), (0, 0)), ((0, 1), (1, 1))),
    "4": (((0, 2), (0, 1), (1, 1)), ((1, 2), (1, 0))),
    "5": (((1, 2), (0, 2), (0, 1), (1, 1), (1, 0), (0, 0)),),
    "6": (((1, 2), (0, 2), (0, 0), (1, 0), (1, 1), (0, 1)),),
    "7": (((0, 2), (1, 2), (1, 0)),),
    "8": (((0, 0), (1, 0), (1, 2), (0, 2), (0, 0)), ((0, 1), (1, 1))),
    "9": (((1, 1), (0, 1), (0, 2), (1, 2), (1, 0), (0, 0)),),
    "-": (((0, 1), (1, 1)),),
}
ARROW = (((0, 0), (0, 2)), ((-0.5, 1.4), (0, 2), (0.5, 1.4)))


@dataclass(frozen=True)
class CutMirror:
    """One mirror on the sheet: closed outline (n, 2) and engraved strokes, mm, seen from the back, y up."""

    outline: FloatArray
    strokes: tuple[FloatArray, ...]


def outline_from_back(mirror: Mirror) -> FloatArray:
    """The outline (n, 2) seen from the back of the sheet: x along the rig's x, y up."""
    return mirror.outline_in_plane_mm * (1.0, -1.0)


def mark(text: str, outline: FloatArray, height_mm: float) -> tuple[FloatArray, ...]:
    """Strokes of an up arrow and a text inside an outline, `height_mm` high where there is room, else smaller."""
    strokes = [np.array(stroke, dtype=np.float64) for stroke in ARROW]
    for place, sign in enumerate(text):
        shift = np.array([1.2 + 1.6 * place, 0.0])
        strokes.extend(np.array(stroke) + shift for stroke in STROKES[sign])
    corners = np.vstack(strokes)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    circle = maximum_inscribed_circle(Polygon(outline), tolerance=0.01)
    centre, radius = np.array(circle.coords[0]), circle.length
    scale = min(height_mm / 2.0, 0.8 * radius / np.linalg.norm(corners - middle, axis=1).max())
    return tuple((stroke - middle) * scale + centre for stroke in strokes)


def place_mirrors(layout: Layout, hardware: Hardware) -> list[CutMirror]:
    """Lay all mirrors out, in the layout's order, at least `cut_gap_mm` apart."""
    outlines = [outline_from_back(mirror) for mirror in layout.mirrors]
    widths = np.array([np.ptp(outline[:, 0]) for outline in outlines]).reshape(layout.rows, layout.cols).max(axis=0)
    heights = np.array([np.ptp(outline[:, 1]) for outline in outlines]).reshape(layout.rows, layout.cols).max(axis=1)
    lefts = np.concatenate([[0.0], np.cumsum(widths + hardware.cutting.gap_mm)[:-1]])
    bottoms = np.concatenate([np.cumsum((heights + hardware.cutting.gap_mm)[::-1])[::-1][1:], [0.0]])
    placed = []
    for index, outline in enumerate(outlines):
        t, s = divmod(index, layout.cols)
        outline = outline - outline.min(axis=0) + (lefts[s], bottoms[t])
        placed.append(CutMirror(outline, mark(f"{t}-{s}", outline, hardware.cutting.mark_mm)))
    return placed


@contextmanager
def _fixed_metadata() -> Iterator[None]:
    """Have ezdxf write fixed dates and identifiers, so that the same mirrors give the same bytes."""
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def draw_mirrors(layout: Layout, hardware: Hardware) -> Drawing:
    """The DXF drawing: outlines in the layout's order."""
    drawing = new("R2010")
    drawing.header["$INSUNITS"] = DXF_MM
    drawing.header["$MEASUREMENT"] = 1
    for name, colour in (("CUT", 1), ("ENGRAVE", 5), ("NOTES", 8)):
        drawing.layers.add(name, color=colour)
    model = drawing.modelspace()
    for mirror in place_mirrors(layout, hardware):
        model.add_lwpolyline(mirror.outline.tolist(), close=True, dxfattribs={"layer": "CUT"})
        for stroke in mirror.strokes:
            model.add_lwpolyline(stroke.tolist(), dxfattribs={"layer": "ENGRAVE"})
    sheets = sorted({f"{mirror.surface}-surface {mirror.thickness_mm:g} mm" for mirror in layout.mirrors})
    note = f"{NOTE}; {', '.join(sheets)}; layout {layout.identity}"
    model.add_text(note, height=hardware.cutting.mark_mm / 2.0, dxfattribs={"layer": "NOTES"}).set_placement(
        (0.0, -2.0 * hardware.cutting.mark_mm)
    )
    # ezdxf would add these in the order of a set, which differs from process to process.
    for name in sorted(drawing.entitydb.dxf_types_in_use()):
        drawing.classes.add_class(name)
    return drawing


def write_dxf(path: Path, layout: Layout, hardware: Hardware) -> None:
    """Write the mirrors as DXF atomically."""
    with atomic(path) as temporary, _fixed_metadata():
        draw_mirrors(layout, hardware).saveas(temporary)
