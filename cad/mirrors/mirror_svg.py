"""A sheet of mirrors as SVG in millimetres: the DXF's layers as groups, cuts red, engraving blue, hairlines."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from mirrorcam.cad.mirrors.stock_sheets import StockSheet
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.values import FloatArray

# What drivers of laser cutters take for a line to follow, not an area to fill: 0.001 in.
HAIRLINE_MM = 0.025
NOTE_MM = 3.0


def write_svg(path: Path, sheet: StockSheet) -> None:
    """Write a sheet as SVG: the sheet's upper left corner at the origin, the notes below it.

    Engraving comes before the cuts, as it has to be done.
    """
    width, height = sheet.cutting.sheet_mm
    total = height + NOTE_MM * (1.8 * len(sheet.notes) + 1.0)
    engraved = "".join(_path(stroke, height, "") for cut in sheet.cuts for stroke in cut.strokes)
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
        f'<g id="ENGRAVE" {_layer("ENGRAVE")} {stroke} stroke="#0000ff">\n<path d="{engraved}"/>\n</g>\n'
        f'<g id="CUT" {_layer("CUT")} {stroke} stroke="#ff0000">\n{cuts}\n</g>\n</svg>\n',
    )


def _layer(name: str) -> str:
    return f'inkscape:groupmode="layer" inkscape:label="{name}"'


def _path(points: FloatArray, height: float, end: str) -> str:
    """Path data of points (n, 2) with y up; to 0.1 um."""
    down = np.column_stack([points[:, 0], height - points[:, 1]])
    return "M" + "L".join(f"{x:.4f} {y:.4f}" for x, y in down) + end
