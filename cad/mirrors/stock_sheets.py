"""Mirrors on stock sheets: the face that is up, the cut lines, and the marks engraved on the backs.

Drawings show the *back* of the stock sheet, the side that is glued to the seat. Since the sheet is cut with its back
up, nothing has to be mirrored. Mirrors are rotated on the sheet, never flipped. The back is:

- first-surface: the bare side. The coating is on the table under its film, and the laser reaches it last.
- second-surface: the paint on the coating. Engraving would burn both, and the mark would be visible in the views.
  Therefore, paper tape on the paint is engraved instead.

Glass is neither cut nor marked by a laser: it is cut by a water jet, or scored and broken, and marked by pen. A mark is
an arrow that points up and the mirror's id, in single strokes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from shapely import (
    LineString,
    Polygon,
    STRtree,
    box,
    get_parts,
    maximum_inscribed_circle,
    minimum_rotated_rectangle,
    unary_union,
)
from shapely.geometry.polygon import orient

from mirrorcam.cad.mirrors.nesting import fits, nest
from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm
from mirrorcam.cad.plan.stroke_font import STROKES
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_stock import GLASS_INDEX, Material, narrow_mirror, width_mm

Surface = Literal["first", "second"]
SURFACES: tuple[Surface, ...] = ("first", "second")


@dataclass(frozen=True)
class Facing:
    """How one kind of stock lies on the table, as text for the notes of a sheet and the guide.

    `up` is the face towards the laser; `up_face` and `down_face` describe it and the face on the table. `marked` is the
    layer that the laser engraves; `before` and `after` are instructions for before and after the engraving.
    """

    up: Literal["back", "front"]
    up_face: str
    down_face: str
    marked: str
    before: str
    after: str

    def laser_view(self, outline_in_plane_mm: FloatArray) -> FloatArray:
        """An outline (n, 2) in a mirror's frame as the laser sees it: x along the rig's x, y up seen from the back."""
        return outline_in_plane_mm * ((1.0, -1.0) if self.up == "back" else (1.0, 1.0))

    @property
    def note(self) -> str:
        """How the sheet lies on the table, for the notes of its drawing."""
        return f"{self.up.upper()} up ({self.up_face}), on the table {self.down_face}"


def facing_of(surface: Surface, material: Material) -> Facing:
    """How stock of a surface and material lies on the table."""
    return FACINGS[material, surface]


FACINGS: dict[tuple[Material, Surface], Facing] = {
    ("acrylic", "first"): Facing(
        up="back",
        up_face="the side without the coating",
        down_face="the coated side under its film",
        marked="the bare back, lightly",
        before="leave the film on the coated side, and lay a clean sheet of card under it",
        after="",
    ),
    ("acrylic", "second"): Facing(
        up="back",
        up_face="the painted side",
        down_face="the clear side under its film",
        marked="paper tape on the paint, not the paint",
        before="cover the paint with paper tape, and find on an offcut the power at which the laser marks only the "
        "tape: a laser through the paint would burn the coating, and the mark would show in the picture",
        after="Leave the tape on until the mirror is glued in: it carries the mirror's name.",
    ),
    ("glass", "first"): Facing(
        up="back",
        up_face="the side without the coating",
        down_face="the coated side, on clean lint-free paper",
        marked="the bare back, with a paint marker",
        before="score the bare back, never the coating",
        after="",
    ),
    ("glass", "second"): Facing(
        up="back",
        up_face="the painted side",
        down_face="the clear side",
        marked="the paint, with a paint marker",
        before="to score it by hand, flip sheet and drawing together and score the clear side, since paint and coating "
        "would chip",
        after="",
    ),
}


LINE_GAP_MM = 0.5
"""Minimum distance between a laser's lines: closer lines merge."""

# Spacing of glyphs, in units of half their height: normal, and for small glyphs.
GAPS = (0.6, 1.0)
ARROW = (((0, 0), (0, 2)), ((-0.5, 1.4), (0, 2), (0.5, 1.4)))


def mark(text: str, outline: FloatArray, height_mm: float) -> tuple[FloatArray, ...]:
    """Strokes (n, 2) of an up arrow, its shaft first, and of a text inside a convex outline (n, 2), mm, y up.

    Glyphs are in a row or a column, `LINE_GAP_MM` from the outline, and `height_mm` high or as high as fits. Small
    glyphs have wider spaces, for the line gap between strokes. If no arrangement has that gap, strokes are as far apart
    as possible.
    """
    polygon = Polygon(outline)
    circle = maximum_inscribed_circle(polygon, tolerance=0.01)
    centres = np.array([polygon.centroid.coords[0], circle.coords[0]])
    best: tuple[tuple[float, float], tuple[FloatArray, ...]] | None = None
    for gap, axis, centre in product(GAPS, (0, 1), centres):
        strokes = _arrangement(text, gap, axis)
        scale = min(height_mm / 2.0, _max_scale(np.vstack(strokes), outline - centre))
        # Strokes of a glyph are 1 apart.
        gap_mm = min(LINE_GAP_MM, scale * min(gap, 1.0))
        if best is None or (gap_mm, scale) > best[0]:
            best = ((gap_mm, scale), tuple(stroke * scale + centre for stroke in strokes))
    assert best is not None
    return best[1]


def _arrangement(text: str, gap: float, axis: int) -> list[FloatArray]:
    """Strokes of arrow and glyphs, two high, in a row (axis 0) or down a column (axis 1), centred on the origin."""
    placed: list[FloatArray] = []
    end = 0.0
    for glyph in (ARROW, *(STROKES[letter] for letter in text)):
        strokes = [np.array(stroke, dtype=np.float64) for stroke in glyph]
        corners = np.vstack(strokes)
        low, high = corners.min(axis=0), corners.max(axis=0)
        shift = np.array([end - low[0], 0.0]) if axis == 0 else np.array([-(low + high)[0] / 2.0, end - high[1]])
        placed += [stroke + shift for stroke in strokes]
        end += (high - low)[0] + gap if axis == 0 else -(high - low)[1] - gap
    corners = np.vstack(placed)
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    return [stroke - centre for stroke in placed]


def _max_scale(corners: FloatArray, outline: FloatArray) -> float:
    """Largest scale about the origin at which points (n, 2) keep the line gap inside a convex outline (m, 2)."""
    loop = np.array(orient(Polygon(outline)).exterior.coords)
    edges = np.diff(loop, axis=0)
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    free_mm = (outward * loop[:-1]).sum(axis=1) - LINE_GAP_MM
    return float((free_mm / (outward @ corners.T).max(axis=1)).min())


TEST = "test"
"""Name of the test mirror for the coupon's seat, on the sheet of the thickest mirrors."""


@dataclass(frozen=True)
class CutMirror:
    """One mirror on a stock sheet: the laser's closed path (n, 2), half a kerf outside the edge, and engraved strokes.

    `name` is from `Layout.mirror_names`, or `TEST`. Coordinates are in mm from the sheet's lower left corner, y up.
    """

    name: str
    outline: FloatArray
    strokes: tuple[FloatArray, ...]


@dataclass(frozen=True)
class StockSheet:
    """One stock sheet, `number` of `count`, with mirrors of one kind; `stem` is its file name without extension."""

    number: int
    count: int
    surface: Surface
    thickness_mm: float
    layout_identity: str
    cutting: Cutting
    cuts: tuple[CutMirror, ...]

    @property
    def stem(self) -> str:
        return "mirrors" if self.count == 1 else f"mirrors_{self.number}"

    @property
    def kind(self) -> str:
        return self.cutting.stock(self.surface, self.thickness_mm)

    def _line_notes(self, facing: Facing) -> tuple[str, str]:
        """The meaning of the lines on both layers."""
        if self.cutting.material == "glass":
            return (
                "CUT (red): the finished edge, before its bevel; no kerf is included. Glass is not cut by a laser",
                f"ENGRAVE (blue): name of the mirror and an arrow that points up in the device, on {facing.marked}",
            )
        cutting = self.cutting
        return (
            f"CUT (red): kerf {cutting.kerf_mm:g} included, lines are {cutting.allowance_mm:g} outside the "
            "finished edge",
            f"ENGRAVE (blue): name of the mirror and an arrow that points up in the device, into {facing.marked}; "
            "engrave first",
        )

    @property
    def use(self) -> float:
        """Fraction of the sheet that becomes mirrors."""
        width, height = self.cutting.sheet_mm
        return float(sum(Polygon(cut.outline).area for cut in self.cuts)) / (width * height)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the person who cuts the sheet."""
        width, height = self.cutting.sheet_mm
        facing = facing_of(self.surface, self.cutting.material)
        return (
            f"MirrorCam mirrors, sheet {self.number} of {self.count}, layout {self.layout_identity}; lengths in mm",
            f"Sheet: {self.kind}, {width:g} x {height:g}",
            f"Lay the sheet down with its {facing.note}",
            f"Seen from the {facing.up} of the mirrors: do not mirror the drawing",
            *self._line_notes(facing),
        )


def outline_from_back(mirror: Mirror, cutting: Cutting) -> FloatArray:
    """The outline (n, 2) seen from the back, which is up: x along the rig's x, y up."""
    return facing_of(mirror.surface, cutting.material).laser_view(mirror.outline_in_plane_mm)


def offset_outline(outline: FloatArray, distance_mm: float) -> FloatArray:
    """A convex outline (n, 2) offset outwards with mitred corners: the same number of corners, counter-clockwise.

    A corner between edges with outward normals a and b moves by d (a + b) / (1 + a.b), to where the offset edges meet.
    """
    corners = np.array(orient(Polygon(outline)).exterior.coords)[:-1]
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    previous = np.roll(normals, 1, axis=0)
    return np.asarray(corners + distance_mm * (previous + normals) / (1.0 + (previous * normals).sum(axis=1))[:, None])


def require_cuttable(layout: Layout, cutting: Cutting) -> None:
    """Raise InputError if a mirror is larger than a sheet, too narrow for its thickness, or not designed for glass."""
    for index, (name, mirror) in enumerate(zip(layout.mirror_names, layout.mirrors, strict=True)):
        outline = outline_from_back(mirror, cutting)
        width, ratio = width_mm(outline), cutting.min_width_to_thickness
        if width < ratio * mirror.thickness_mm:
            raise InputError(narrow_mirror(layout, index, width, ratio, cutting.material))
        if cutting.material == "glass" and mirror.is_second_surface and mirror.refractive_index < GLASS_INDEX:
            raise InputError(
                f"mirror {name} was designed with a refractive index of {mirror.refractive_index:g}, expected glass, "
                f"at least {GLASS_INDEX:g}: design again, or cut it from acrylic"
            )
        _require_fit(name, outline, cutting)
    _require_fit(TEST, _test_outline(layout), cutting)


def _require_fit(name: str, outline: FloatArray, cutting: Cutting) -> None:
    path = offset_outline(outline, cutting.allowance_mm)
    if not fits(path, cutting.sheet_mm, cutting.gap_mm):
        width, height = _box_mm(path)
        usable = (length - 2.0 * cutting.gap_mm for length in cutting.sheet_mm)
        raise InputError(
            f"mirror {name} is {width:.1f} x {height:.1f} mm as cut, expected at most "
            f"{' x '.join(f'{length:g}' for length in usable)} mm (sheet without its margins)"
        )


def _test_outline(layout: Layout) -> FloatArray:
    return np.array(box(0.0, 0.0, *coupon_mirror_mm(layout)).exterior.coords)[:-1]


def plan_sheets(layout: Layout, cutting: Cutting) -> tuple[StockSheet, ...]:
    """All mirrors nested on sheets, with separate sheets for every kind of mirror; raises as `require_cuttable`."""
    require_cuttable(layout, cutting)
    kinds = sorted({(mirror.surface, mirror.thickness_mm) for mirror in layout.mirrors})
    thickest = max(kinds, key=lambda kind: kind[1])
    planned: list[tuple[Surface, float, list[CutMirror]]] = []
    for surface, thickness_mm in kinds:
        mirrors_of_kind = [
            (name, outline_from_back(mirror, cutting))
            for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)
            if (mirror.surface, mirror.thickness_mm) == (surface, thickness_mm)
        ]
        if (surface, thickness_mm) == thickest:
            mirrors_of_kind.append((TEST, _test_outline(layout)))
        planned += [(surface, thickness_mm, cuts) for cuts in _nested(mirrors_of_kind, cutting)]
    return tuple(
        StockSheet(number, len(planned), surface, thickness_mm, layout.identity, cutting, tuple(cuts))
        for number, (surface, thickness_mm, cuts) in enumerate(planned, start=1)
    )


def _nested(mirrors: list[tuple[str, FloatArray]], cutting: Cutting) -> list[list[CutMirror]]:
    """Nested mirrors of one kind, given by names and outlines, sheet by sheet."""
    paths = [offset_outline(outline, cutting.allowance_mm) for _, outline in mirrors]
    placed = nest(paths, cutting.sheet_mm, cutting.gap_mm)
    sheets: list[list[CutMirror]] = [[] for _ in range(1 + max(nested.sheet for nested in placed))]
    for (name, outline), path, nested in zip(mirrors, paths, placed, strict=True):
        text = "" if name == TEST else name
        strokes = tuple(nested.apply(stroke) for stroke in mark(text, outline, cutting.mark_mm))
        sheets[nested.sheet].append(CutMirror(name, nested.apply(path), strokes))
    return sheets


def _box_mm(outline: FloatArray) -> tuple[float, float]:
    """Length and width of the smallest rectangle around an outline (n, 2)."""
    loop = np.array(minimum_rotated_rectangle(Polygon(outline)).exterior.coords)
    short, long = sorted(np.linalg.norm(np.diff(loop[:3], axis=0), axis=1))
    return float(long), float(short)


def sheet_metrics(sheets: tuple[StockSheet, ...]) -> dict[str, Metric]:
    """Checks of the stock sheets: smallest feature, smallest gap between lines, and use of the sheets."""
    features = [
        width_mm(offset_outline(cut.outline, -sheet.cutting.allowance_mm)) / sheet.thickness_mm
        for sheet in sheets
        for cut in sheet.cuts
        if cut.name != TEST
    ]
    return {
        "sheets": Metric(value=len(sheets), unit=""),
        "sheet_use": Metric(value=float(np.mean([sheet.use for sheet in sheets])), unit=""),
        "feature_of_thickness": Metric(
            value=min(features),
            unit="",
            limit=max(sheet.cutting.min_width_to_thickness for sheet in sheets),
            lower_is_better=False,
        ),
        "line_gap_mm": Metric(
            value=round(min(line_gap_mm(sheet) for sheet in sheets), 3),
            unit="mm",
            limit=LINE_GAP_MM,
            lower_is_better=False,
        ),
    }


def line_gap_mm(sheet: StockSheet) -> float:
    """Smallest distance between lines that do not touch: cuts, arrows and glyphs."""
    closed = [LineString([*cut.outline, cut.outline[0]]) for cut in sheet.cuts]
    strokes = [LineString(stroke) for cut in sheet.cuts for stroke in cut.strokes]
    # Strokes that touch form one glyph.
    figures = [*closed, *(part for part in get_parts(unary_union([stroke.buffer(1e-6) for stroke in strokes])))]
    tree = STRtree(figures)
    _, distances = tree.query_nearest(figures, exclusive=True, return_distance=True)
    return float(distances.min())
