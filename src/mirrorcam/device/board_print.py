"""Printed boards: a page at true scale, as PDF or SVG, with a ruler to verify the print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import drawable, fitted
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco

MM_PER_INCH = 25.4
PAGES_MM = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
}
EDGE_MM = 8.0  # margin that printers leave white and that a board needs around itself
RULER_MM = 100.0
FOOTER_MM = 12.0  # height of ruler and text below the board
TEXT_MM = 80.0  # width of the text next to the ruler
LINE_MM = 3.0
GAP_MM = 8.0  # between ruler and text
POINTS = 7  # font size
FORMATS = (".pdf", ".svg")


def page_for(board: CalibrationBoard, page: str) -> tuple[float, float]:
    """Choose a page, portrait or landscape, that holds a board and its footer.

    Parameters
    ----------
    board
        The board.
    page
        A name in `PAGES_MM`; WIDTHxHEIGHT in mm, which is not rotated; or empty for the smallest A page.

    Returns
    -------
    tuple
        Width and height of the page in mm.

    Raises
    ------
    InputError
        If `page` is not valid, or the board does not fit on it.
    """
    needed = needed_mm(board)
    if page and page not in PAGES_MM:
        sizes = [_custom(page)]
    else:
        portraits = [PAGES_MM[page]] if page else [size for name, size in PAGES_MM.items() if name.startswith("a")]
        sizes = [size for short, long in sorted(portraits) for size in ((short, long), (long, short))]
    fitting = [size for size in sizes if size[0] >= needed[0] and size[1] >= needed[1]]
    if not fitting:
        width, height = board.size_mm
        raise InputError(
            f"board of {width:g} x {height:g} mm: does not fit on {page or 'a0'}, expected a page of "
            f"{needed[0]:g} x {needed[1]:g} mm or more"
        )
    return fitting[0]


def needed_mm(board: CalibrationBoard) -> tuple[float, float]:
    """Return the smallest width and height of a page, in mm, that hold a board and its footer."""
    width, height = board.size_mm
    return max(width, RULER_MM + TEXT_MM) + 2 * EDGE_MM, height + FOOTER_MM + 3 * EDGE_MM


def _custom(text: str) -> tuple[float, float]:
    try:
        width, height = (float(side) for side in text.split("x"))
    except ValueError:
        raise InputError(f"page {text!r}: expected {', '.join(PAGES_MM)} or WIDTHxHEIGHT in mm") from None
    if not (0.0 < width < 1e5 and 0.0 < height < 1e5):
        raise InputError(f"page {text!r}: expected a width and a height of more than 0 and less than 100000 mm")
    return width, height


def write_board(board: CalibrationBoard, path: Path, page_mm: tuple[float, float], name: str) -> None:
    """Write the page of a board atomically; the same arguments give the same bytes.

    Parameters
    ----------
    board
        The board.
    path
        The file; its suffix, one of `FORMATS`, chooses the format.
    page_mm
        Width and height of the page.
    name
        Name of the board in the footer and as the title of the document.
    """
    width, height = page_mm
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    axes.set_axis_off()
    origin = board_in_page_mm(board, page_mm)
    _fill(axes, shapely.transform(ink_in_board_mm(board), lambda points: points + origin))
    _footer(axes, board, name, left=EDGE_MM, top=height - EDGE_MM - FOOTER_MM)
    metadata: dict[str, dict[str, Any]] = {
        ".svg": {"Date": None, "Creator": "MirrorCam", "Title": _drawable(name)},
        ".pdf": {"CreationDate": None, "Creator": "MirrorCam", "Producer": None, "Title": _drawable(name)},
    }
    settings: dict[Any, Any] = {"svg.hashsalt": "mirrorcam", "svg.fonttype": "path", "path.simplify": False}
    with mpl.rc_context(settings), atomic(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:], metadata=metadata[path.suffix])


def board_in_page_mm(board: CalibrationBoard, page_mm: tuple[float, float]) -> tuple[float, float]:
    """Position of the board's top left corner on the page: centred above the footer."""
    width, height = board.size_mm
    return (page_mm[0] - width) / 2.0, (page_mm[1] - FOOTER_MM - EDGE_MM - height) / 2.0


def _fill(axes: Axes, areas: shapely.MultiPolygon) -> None:
    """Draw areas as one black path."""
    rings = [ring.coords for area in areas.geoms for ring in (area.exterior, *area.interiors)]
    codes = [[Outline.MOVETO, *[Outline.LINETO] * (len(ring) - 2), Outline.CLOSEPOLY] for ring in rings]
    outline = Outline(np.concatenate([np.array(ring) for ring in rings]), np.concatenate(codes))
    axes.add_patch(PathPatch(outline, facecolor="black", edgecolor="none", linewidth=0.0, snap=False, clip_on=False))


def _footer(axes: Axes, board: CalibrationBoard, name: str, left: float, top: float) -> None:
    """Draw a ruler of 100 mm and, next to it, the name and the dimensions of the board."""
    ticks = [
        shapely.box(
            left + mm - 0.06, top, left + mm + 0.06, top + (5.0 if mm % 10 == 0 else 4.0 if mm % 5 == 0 else 3.0)
        )
        for mm in range(int(RULER_MM) + 1)
    ]
    bar = shapely.box(left, top, left + RULER_MM, top + 0.12)
    _fill(axes, shapely.MultiPolygon([bar, *ticks]))
    for mm in (0, 50, 100):
        axes.text(left + mm, top + 8.5, f"{mm} mm" if mm else "0", fontsize=POINTS, ha="center", va="baseline")
    width, height = board.size_mm
    lines = [fitted(_drawable(name), TEXT_MM - GAP_MM, _width_mm), f"{board.name}, {board.layout_text}"]
    if isinstance(board, Charuco):
        first_marker = f" from {board.first_marker} on" if board.first_marker else ""
        pattern = ", pattern of OpenCV before 4.6" if board.legacy else ""
        polarity = ", inverted" if board.inverted else ""
        lines.append(f"markers of {board.marker_mm:g} mm, {board.dictionary}{first_marker}{pattern}{polarity}")
    if isinstance(board, AprilGrid):
        lines.append(f"gaps of {board.gap_mm:g} mm, family 36h11, tag 0 at the lower left")
    lines.append(f"printed at 100 %, its squares span {width:g} x {height:g} mm")
    for number, line in enumerate(lines):
        position = left + RULER_MM + GAP_MM, top + 2.0 + number * LINE_MM
        axes.text(*position, line, fontsize=POINTS, va="baseline", parse_math=False)


def _drawable(text: str) -> str:
    return drawable(text, get_font(findfont(FontProperties())).get_charmap())


def _width_mm(text: str) -> float:
    if not text.strip():
        return 0.0  # matplotlib cannot make a path without glyphs
    path = TextPath((0.0, 0.0), text.replace("$", r"\$"), size=POINTS)
    return float(path.get_extents().width) / 72.0 * MM_PER_INCH


def ink_in_board_mm(board: CalibrationBoard) -> shapely.MultiPolygon:
    """Black squares and markers in the board's frame, x and y in mm.

    Modules of a marker that share an edge form one polygon, so that viewers show no seams. Squares that touch at a
    corner are separate polygons.
    """
    if isinstance(board, AprilGrid):
        x, y = (board.cell_edges(n, tag=board.tag_mm, gap=board.gap_mm) for n in (board.cols, board.rows))
        return shapely.MultiPolygon([shapely.orient_polygons(polygon) for polygon in _joined(board.black, x, y)])
    side = board.square_mm
    black = board.black if isinstance(board, Charuco) else board.image(1) == 0
    if isinstance(board, Charuco) and board.inverted:
        black = np.zeros_like(black)  # all black squares hold markers
    squares = [
        shapely.box(column * side, row * side, (column + 1) * side, (row + 1) * side)
        for row, column in np.argwhere(black).tolist()
    ]
    markers = _markers(board) if isinstance(board, Charuco) else ()
    return shapely.MultiPolygon([shapely.orient_polygons(polygon) for polygon in (*squares, *markers)])


def _markers(board: Charuco) -> Iterator[shapely.Polygon]:
    """Polygons of the squares with markers at their centres, in the order of their numbers, row by row."""
    for white, (row, column) in zip(board.markers, board.marker_squares.tolist(), strict=True):
        square = np.array([column, row]) * board.square_mm
        corner = square + (board.square_mm - board.marker_mm) / 2.0
        modules = np.arange(len(white) + 1) * board.marker_mm / len(white)
        # Neighbours share identical coordinates, so that their union has no gaps.
        lines = np.column_stack([square, corner[:, None] + modules, square + board.square_mm])
        yield from _joined(np.pad(~white, 1, constant_values=board.inverted), *lines)


def _joined(black: NDArray[np.bool_], x: FloatArray, y: FloatArray) -> tuple[shapely.Polygon, ...]:
    """The black cells of a grid with lines at `x` and `y`; those that share an edge are one polygon."""
    boxes = [shapely.box(x[k], y[j], x[k + 1], y[j + 1]) for j, k in np.argwhere(black)]
    union = shapely.union_all(boxes)
    return tuple(union.geoms) if isinstance(union, shapely.MultiPolygon) else (union,)
