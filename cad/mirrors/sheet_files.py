"""Stock sheets of mirrors as DXF and SVG in millimetres, with layers CUT and ENGRAVE, and what a cutter has to know.

The DXF has one group per mirror. The SVG has the layers as groups of hairlines: red cuts and blue engraving. Both hold
only what is cut or engraved, since services cut every line of a file. A scale bar has files of its own, and the notes
are a text, `cutting.md`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from ezdxf import options  # type: ignore[attr-defined]  # public, but ezdxf does not declare what it exports
from ezdxf.document import Drawing
from ezdxf.filemanagement import new

from mirrorcam.cad.mirrors.stock_sheets import TEST, StockSheet, plan_sheets
from mirrorcam.cad.mirrors.strips import strip_plan
from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm, is_rectangular, is_sold_in_size, size_mm
from mirrorcam.core.disk.files import atomic, write_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

DXF_MM = 4
LAYERS = (("CUT", 1), ("ENGRAVE", 5))
BAR_MM, TICK_MM = 100.0, 5.0
"""Length of the scale bar, and of the ticks at each 10 mm."""


def write_sheets(folder: Path, layout: Layout, cutting: Cutting) -> tuple[StockSheet, ...]:
    """Nest the mirrors on sheets and write each as DXF and SVG, with a scale bar and the notes for the cutter."""
    sheets = plan_sheets(layout, cutting)
    for sheet in sheets:
        write_dxf(folder / f"{sheet.stem}.dxf", sheet)
        write_svg(folder / f"{sheet.stem}.svg", sheet)
    _write_drawing(folder / "scale_bar.dxf", draw_scale_bar)
    write_text(folder / "scale_bar.svg", _svg(BAR_MM, 2.0 * TICK_MM, "Scale bar, 100 mm", _bar_group()))
    write_text(folder / "cutting.md", cutting_text(layout, sheets))
    return sheets


def cutting_text(layout: Layout, sheets: Sequence[StockSheet]) -> str:
    """What a cutter has to know, as Markdown: the notes of each sheet and, for rectangles, a list and a strip plan."""
    sold = is_sold_in_size(layout)
    lines = ["# Mirrors to buy" if sold else "# Mirrors to cut", ""]
    if not sold:
        for sheet in sheets:
            lines += [f"## {sheet.stem}", "", *(f"- {note}" for note in sheet.notes), ""]
        lines += [
            "`scale_bar.dxf` and `.svg` hold a bar of 100 mm: if it measures 100 mm in a program, the sheets are true "
            "too.",
            "",
        ]
    if not is_rectangular(layout):
        return "\n".join(lines)
    sizes = {name: size_mm(mirror) for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)}
    counts = Counter(sizes.values())
    lines += ["## Rectangles", "", "| size, mm | pieces | mirrors |", "|---|---:|---|"]
    for size in sorted(counts, reverse=True):
        names = ", ".join(name for name in sizes if sizes[name] == size)
        lines.append(f"| {size[0]:g} x {size[1]:g} | {counts[size]} | {names} |")
    if sold:
        lines += ["", "Buy these sizes, and a spare one of the smallest as the coupon's test mirror: nothing is cut."]
        return "\n".join([*lines, ""])
    sizes[TEST] = coupon_mirror_mm(layout)
    width, height = sheets[0].cutting.sheet_mm
    lines += [
        "",
        f"Strip plan for sheets of {width:g} x {height:g} mm: cut the strips off along the longer side of the sheet, "
        "then the mirrors off the strips. Every cut is straight and runs from edge to edge.",
        "",
        "| sheet | strip | width, mm | mirrors and their lengths, mm |",
        "|---:|---:|---:|---|",
    ]
    for number, strip in enumerate(strip_plan(sizes, sheets[0].cutting.sheet_mm), start=1):
        pieces = ", ".join(f"{name}: {length:g}" for name, length in strip.pieces)
        lines.append(f"| {strip.sheet} | {number} | {strip.width_mm:g} | {pieces} |")
    return "\n".join([*lines, ""])


def write_dxf(path: Path, sheet: StockSheet) -> None:
    """Write a sheet as DXF atomically."""
    _write_drawing(path, lambda: draw_sheet(sheet))


def _write_drawing(path: Path, draw: Callable[[], Drawing]) -> None:
    with atomic(path) as temporary, _fixed_metadata():
        draw().saveas(temporary)


def draw_sheet(sheet: StockSheet) -> Drawing:
    """The DXF drawing of a sheet, with its lower left corner at the origin.

    Every mirror is a group `mirror_ROW-COLUMN`, the test mirror `mirror_test`, of a closed line on CUT and strokes on
    ENGRAVE.
    """
    drawing = _new_drawing()
    model = drawing.modelspace()
    for cut in sheet.cuts:
        lines = [model.add_lwpolyline(cut.outline.tolist(), close=True, dxfattribs={"layer": "CUT"})]
        lines += [model.add_lwpolyline(stroke.tolist(), dxfattribs={"layer": "ENGRAVE"}) for stroke in cut.strokes]
        drawing.groups.new(f"mirror_{cut.name}").extend(lines)
    return _with_classes(drawing)


def draw_scale_bar() -> Drawing:
    """The DXF drawing of the scale bar, on ENGRAVE."""
    drawing = _new_drawing()
    for line in _bar_lines():
        drawing.modelspace().add_lwpolyline(line.tolist(), dxfattribs={"layer": "ENGRAVE"})
    return _with_classes(drawing)


def _bar_lines() -> list[FloatArray]:
    """A bar of 100 mm, and its ticks, as lines (2, 2)."""
    ticks = [np.array([(x, 0.0), (x, TICK_MM)]) for x in np.linspace(0.0, BAR_MM, 11)]
    return [np.array([(0.0, 0.0), (BAR_MM, 0.0)]), *ticks]


def _new_drawing() -> Drawing:
    drawing = new("R2010")
    drawing.header["$INSUNITS"] = DXF_MM
    drawing.header["$MEASUREMENT"] = 1
    for name, colour in LAYERS:
        drawing.layers.add(name, color=colour)
    return drawing


def _with_classes(drawing: Drawing) -> Drawing:
    """Add classes in sorted order, since ezdxf would add them in a set's order, which differs between processes."""
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
    """Write a sheet as SVG, with the sheet's upper left corner at the origin.

    Engraving is before the cuts, since it has to be done first.
    """
    width, height = sheet.cutting.sheet_mm
    engraving = "".join(_path(stroke, height, "") for cut in sheet.cuts for stroke in cut.strokes)
    cuts = "\n".join(f'<path id="mirror_{cut.name}" d="{_path(cut.outline, height, "Z")}"/>' for cut in sheet.cuts)
    groups = _engrave_group(engraving) + f'<g id="CUT" {_layer("CUT")} {STROKE} stroke="#ff0000">\n{cuts}\n</g>\n'
    write_text(path, _svg(width, height, sheet.notes[0], groups))


STROKE = f'fill="none" stroke-width="{HAIRLINE_MM}"'


def _engrave_group(data: str) -> str:
    return f'<g id="ENGRAVE" {_layer("ENGRAVE")} {STROKE} stroke="#0000ff">\n<path d="{data}"/>\n</g>\n'


def _bar_group() -> str:
    return _engrave_group("".join(_path(line, 2.0 * TICK_MM, "") for line in _bar_lines()))


def _svg(width: float, height: float, title: str, groups: str) -> str:
    """An SVG file in mm with groups of lines."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
        f'width="{width:g}mm" height="{height:g}mm" viewBox="0 0 {width:g} {height:g}">\n'
        f"<title>{escape(title)}</title>\n{groups}</svg>\n"
    )


def _layer(name: str) -> str:
    return f'inkscape:groupmode="layer" inkscape:label="{name}"'


def _path(points: FloatArray, height: float, end: str) -> str:
    """Path data of points (n, 2) with y up, rounded to 0.1 um."""
    down = np.column_stack([points[:, 0], height - points[:, 1]])
    return "M" + "L".join(f"{x:.4f} {y:.4f}" for x, y in down) + end
