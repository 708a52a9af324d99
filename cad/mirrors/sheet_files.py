"""Stock sheets of mirrors as DXF and SVG in millimetres, with layers CUT, ENGRAVE and NOTES.

The DXF has one group per mirror. The SVG has the layers as groups of hairlines: red cuts and blue engraving.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from ezdxf import options  # type: ignore[attr-defined]  # public, but ezdxf does not declare what it exports
from ezdxf.document import Drawing
from ezdxf.filemanagement import new

from mirrorcam.cad.mirrors.stock_sheets import StockSheet, plan_sheets
from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.core.disk.files import atomic, write_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

DXF_MM = 4
LAYERS = (("CUT", 1), ("ENGRAVE", 5), ("NOTES", 8))
NOTE_MM = 3.0


def write_sheets(folder: Path, layout: Layout, cutting: Cutting) -> tuple[StockSheet, ...]:
    """Nest the mirrors on sheets and write each as DXF and SVG."""
    sheets = plan_sheets(layout, cutting)
    for sheet in sheets:
        write_dxf(folder / f"{sheet.stem}.dxf", sheet)
        write_svg(folder / f"{sheet.stem}.svg", sheet)
    return sheets


def write_dxf(path: Path, sheet: StockSheet) -> None:
    """Write a sheet as DXF atomically."""
    with atomic(path) as temporary, _fixed_metadata():
        draw_sheet(sheet).saveas(temporary)


def draw_sheet(sheet: StockSheet) -> Drawing:
    """The DXF drawing of a sheet, with its lower left corner at the origin and the notes below it.

    Every mirror is a group `mirror_ROW-COLUMN` of a closed line on CUT and strokes on ENGRAVE.
    """
    drawing = new("R2010")
    drawing.header["$INSUNITS"] = DXF_MM
    drawing.header["$MEASUREMENT"] = 1
    for name, colour in LAYERS:
        drawing.layers.add(name, color=colour)
    model = drawing.modelspace()
    for cut in sheet.cuts:
        lines = [model.add_lwpolyline(cut.outline.tolist(), close=True, dxfattribs={"layer": "CUT"})]
        lines += [model.add_lwpolyline(stroke.tolist(), dxfattribs={"layer": "ENGRAVE"}) for stroke in cut.strokes]
        drawing.groups.new(f"mirror_{cut.name}").extend(lines)
    width, height = sheet.cutting.sheet_mm
    border = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]
    model.add_lwpolyline(border, close=True, dxfattribs={"layer": "NOTES"})
    for row, note in enumerate(sheet.notes, start=1):
        text = model.add_text(note, height=NOTE_MM, dxfattribs={"layer": "NOTES"})
        text.set_placement((0.0, -1.8 * NOTE_MM * row))
    # Sorted, since ezdxf would add them in the order of a set, which differs between processes.
    for name in sorted(drawing.entitydb.dxf_types_in_use()):
        drawing.classes.add_class(name)
    return drawing


@contextmanager
def _fixed_metadata() -> Iterator[None]:
    """Make ezdxf write fixed dates and identifiers, so that the same mirrors give the same bytes."""
    previous = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = previous


# Drivers of laser cutters cut along lines of this width, 0.001 in, and fill wider ones.
HAIRLINE_MM = 0.025


def write_svg(path: Path, sheet: StockSheet) -> None:
    """Write a sheet as SVG, with the sheet's upper left corner at the origin and the notes below it.

    Engraving is before the cuts, since it has to be done first.
    """
    width, height = sheet.cutting.sheet_mm
    total = height + NOTE_MM * (1.8 * len(sheet.notes) + 1.0)
    engraving = "".join(_path(stroke, height, "") for cut in sheet.cuts for stroke in cut.strokes)
    cuts = "\n".join(f'<path id="mirror_{cut.name}" d="{_path(cut.outline, height, "Z")}"/>' for cut in sheet.cuts)
    notes = "\n".join(
        f'<text x="0" y="{height + 1.8 * NOTE_MM * row:.2f}">{escape(note)}</text>'
        for row, note in enumerate(sheet.notes, start=1)
    )
    stroke = f'fill="none" stroke-width="{HAIRLINE_MM}"'
    write_text(
        path,
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
        f'width="{width:g}mm" height="{total:g}mm" viewBox="0 0 {width:g} {total:g}">\n'
        f"<title>{escape(sheet.notes[0])}</title>\n"
        f'<g id="NOTES" {_layer("NOTES")} fill="#808080" font-family="sans-serif" font-size="{NOTE_MM}">\n'
        f'<rect width="{width:g}" height="{height:g}" fill="none" stroke="#808080" stroke-width="{HAIRLINE_MM}"/>\n'
        f"{notes}\n</g>\n"
        f'<g id="ENGRAVE" {_layer("ENGRAVE")} {stroke} stroke="#0000ff">\n<path d="{engraving}"/>\n</g>\n'
        f'<g id="CUT" {_layer("CUT")} {stroke} stroke="#ff0000">\n{cuts}\n</g>\n</svg>\n',
    )


def _layer(name: str) -> str:
    return f'inkscape:groupmode="layer" inkscape:label="{name}"'


def _path(points: FloatArray, height: float, end: str) -> str:
    """Path data of points (n, 2) with y up, rounded to 0.1 um."""
    down = np.column_stack([points[:, 0], height - points[:, 1]])
    return "M" + "L".join(f"{x:.4f} {y:.4f}" for x, y in down) + end
