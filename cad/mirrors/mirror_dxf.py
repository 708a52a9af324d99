"""A stock sheet of mirrors as DXF: layers CUT, ENGRAVE and NOTES, millimetres, one group per mirror."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ezdxf import options  # type: ignore[attr-defined]  # public, but ezdxf does not declare what it exports
from ezdxf.document import Drawing
from ezdxf.filemanagement import new

from mirrorcam.cad.mirrors.stock_sheets import StockSheet
from mirrorcam.core.disk.files import atomic

DXF_MM = 4
LAYERS = (("CUT", 1), ("ENGRAVE", 5), ("NOTES", 8))
NOTE_MM = 3.0


def write_dxf(path: Path, sheet: StockSheet) -> None:
    """Write a sheet as DXF atomically."""
    with atomic(path) as temporary, _fixed_metadata():
        draw_sheet(sheet).saveas(temporary)


def draw_sheet(sheet: StockSheet) -> Drawing:
    """The DXF drawing of a sheet: its lower left corner at the origin, the notes below it.

    Every mirror is a group `mirror_ROW-COLUMN` of its closed line on CUT and its strokes on ENGRAVE.
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
    # ezdxf would add these in the order of a set, which differs from process to process.
    for name in sorted(drawing.entitydb.dxf_types_in_use()):
        drawing.classes.add_class(name)
    return drawing


@contextmanager
def _fixed_metadata() -> Iterator[None]:
    """Have ezdxf write fixed dates and identifiers, so that the same mirrors give the same bytes."""
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before
