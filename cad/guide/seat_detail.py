"""The detail of a mirror's seat in a drawing: a section through a pad and a rim, enlarged, and its cutting-plane line.

It shows the areas that are cut, not what is behind them (a removed section, ISO 128-3).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from build123d import Face, Part, Plane
from shapely import LineString, MultiLineString, Point, Polygon, get_parts

from mirrorcam.cad.guide.annotation import draw_aligned
from mirrorcam.cad.guide.dimension_lines import TEXT_MM
from mirrorcam.cad.guide.drawing_sheet import DrawingSheet, overlaps, ratio
from mirrorcam.cad.guide.part_views import PartView, PlacedView
from mirrorcam.cad.guide.sections import HATCH_LINE_MM, LETTER_MM, areas_of, hatch
from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.plan.dimension import Length, length
from mirrorcam.cad.plan.seats import Frustum, newell_normal
from mirrorcam.core.values import FloatArray

DETAIL_SCALES = (10.0, 5.0)
LETTER = "C"
VISIBLE_MM, MARK_MM = 0.35, 0.5
# Margins of the detail beside pad and rim, below the seat and above the rim.
SIDE_MM, BELOW_MM, ABOVE_MM = 2.0, 2.0, 0.5
# Space round the detail for its dimensions, mm on paper, and for its label.
DIMENSIONS_MM, LABEL_MM = 16.0, 8.0
# Length of an arrow of the cutting-plane line, and candidate extensions of its ends, in the order of preference.
ARROW_MM, EXTENSIONS_MM = 5.0, (3.0, 1.0, 5.0, 7.0, 9.0)
PARALLEL = 1e-6

_Cut = tuple[float, float, Frustum, FloatArray, Frustum | None]
"""A pad's distance from a rim and the rim's width, mm, the pad, its seat's outline (n, 3), and the rim, if any."""


@dataclass(frozen=True)
class SeatDetail:
    """The cut `faces` of a seat in a window of a `view` through a pad's centre, mm, and the `lengths` in it.

    The view's axes are towards the rim, out of the seat and to the viewer.
    """

    view: PartView
    faces: tuple[Polygon, ...]
    lengths: tuple[Length, ...]

    def size_mm(self, scale: float) -> FloatArray:
        """Width and height on paper, with dimensions and label."""
        return np.asarray(np.ptp(self.view.box, axis=0) * scale + 2.0 * DIMENSIONS_MM + np.array([0.0, LABEL_MM]))


def seat_detail(plan: HolderPlan | CarrierPlan, solid: Part, pad_tolerance_mm: float) -> SeatDetail | None:
    """Cut through the pad that is nearest to a rim, normal to that rim; through any pad of seats without rims.

    None if the solid, a piece of a split holder, has no such pad.
    """
    if isinstance(plan, CarrierPlan):
        seats, back = [(plan.body.top, plan.pads)], plan.rig_from_back
    else:
        seats = [(core.top, pads) for core, pads in zip(plan.cores, plan.pads_of_mirrors, strict=True)]
        back = plan.rig_from_mount
    pads = [(pad, seat) for seat, of_seat in seats for pad in of_seat]
    rims = plan.rims[::2] if isinstance(plan, HolderPlan) else ()
    beside = [found for pad, seat in pads for rim in rims if (found := _beside(pad, seat, rim))]
    candidates = sorted(beside, key=lambda found: found[0]) or [(0.0, 0.0, *found, None) for found in pads]
    found = next((found for found in candidates if solid.is_inside(tuple(_centre(found[2])))), None)
    if found is None:
        return None
    distance, width, pad, seat, rim = found
    normal = newell_normal(pad.top)
    normal = -normal * np.sign(normal @ back[:3, 2])
    centre = pad.top.mean(axis=0)
    out = _outward(rim) if rim is not None else pad.top[0] - pad.top[1]
    out = out / np.linalg.norm(out)
    axes = np.array([out, normal, np.cross(out, normal)])
    bond = float((centre - seat[0]) @ normal)
    crest = float((rim.top[0] - centre) @ normal) if rim is not None else 0.0
    radius = float(np.abs((pad.top - centre) @ out).max())
    window = np.array(
        [(-radius - SIDE_MM, -bond - BELOW_MM), (max(distance + width, radius) + SIDE_MM, crest + ABOVE_MM)]
    )
    floor = centre - radius * out - bond * normal
    pad_height = length(floor, floor + bond * normal, "pad")
    lengths = [replace(pad_height, minus_mm=pad_tolerance_mm, plus_mm=pad_tolerance_mm)]
    if rim is not None:
        inner = centre + distance * out
        halfway = inner + crest / 2.0 * normal
        lengths += [
            length(inner, inner + crest * normal),
            length(halfway, halfway + width * out, "rim"),
        ]
    return _cut(solid, axes, centre, window, tuple(lengths))


def _centre(pad: Frustum) -> FloatArray:
    return np.vstack([pad.base, pad.top]).mean(axis=0)


def _outward(rim: Frustum) -> FloatArray:
    return np.asarray(rim.top[3] - rim.top[0])


def _beside(pad: Frustum, seat: FloatArray, rim: Frustum) -> _Cut | None:
    """Distance of a rim from a pad's centre, and its width, if the plane through the pad normal to the rim cuts it."""
    if abs(newell_normal(rim.top) @ newell_normal(pad.top)) < 1.0 - PARALLEL:
        return None
    out, along = _outward(rim), rim.top[1] - rim.top[0]
    width, extent = float(np.linalg.norm(out)), float(np.linalg.norm(along))
    to_pad = pad.top.mean(axis=0) - rim.top[0]
    distance, position = -float(to_pad @ out) / width, float(to_pad @ along) / extent
    return (distance, width, pad, seat, rim) if distance > 0.0 and 0.0 < position < extent else None


def _cut(
    solid: Part, axes: FloatArray, centre: FloatArray, window: FloatArray, lengths: tuple[Length, ...]
) -> SeatDetail:
    """The faces of a cut in the plane of the first two axes (rows) within a window (2, 2) about a centre (3,)."""
    middle = centre + window.mean(axis=0) @ axes[:2]
    plane = Plane(origin=tuple(middle), x_dir=tuple(axes[0]), z_dir=tuple(axes[2]))
    width, height = np.ptp(window, axis=0).tolist()
    shape = Face.make_rect(width, height, plane).intersect(solid)
    areas = areas_of(shape.faces() if shape else (), axes)
    low, high = window + axes[:2] @ centre
    border = LineString([(low[0], high[1]), low, (high[0], low[1]), high]).buffer(1e-3)
    outlines = MultiLineString([line for area in areas for line in _rings(area)]).difference(border)
    visible = tuple(np.array(line.coords) for line in get_parts(outlines))
    return SeatDetail(PartView(axes, visible, ()), areas, lengths)


def _rings(area: Polygon) -> Iterable[LineString]:
    return (LineString(ring.coords) for ring in (area.exterior, *area.interiors))


def draw_detail(sheet: DrawingSheet, detail: SeatDetail, scale: float, centre: FloatArray, top: PlacedView) -> None:
    """Draw a detail about a point (2,) of the sheet, with its label, and its cutting-plane line in the view `top`."""
    faces = np.array([face.bounds for face in detail.faces])
    low, high = faces[:, :2].min(axis=0), faces[:, 2:].max(axis=0)
    placed = PlacedView(detail.view, scale, centre - (0.0, LABEL_MM / 2.0) - (low + high) / 2.0 * scale)
    hatch(sheet, detail.faces, scale, placed.shift)
    sheet.lines([line * scale + placed.shift for line in detail.view.visible], VISIBLE_MM)
    draw_aligned(sheet, placed, detail.lengths)
    label = np.array([float(placed.box[:, 0].mean()), centre[1] + detail.size_mm(scale)[1] / 2.0 - LABEL_MM])
    sheet.text(label, f"{LETTER}-{LETTER} ({ratio(scale)})", LETTER_MM, align="center", bold=True)
    _draw_trace(sheet, detail, top)


def _draw_trace(sheet: DrawingSheet, detail: SeatDetail, top: PlacedView) -> None:
    """Draw the ends of the cutting-plane line in the view from above, with arrows and letters clear of text."""
    points = np.concatenate(detail.view.visible)
    origin = detail.lengths[0].points_in_rig[0]
    along = detail.view.axes_in_rig[0]
    offsets = np.array([points[:, 0].min(), points[:, 0].max()]) - origin @ along
    ends = top.paper(origin + offsets[:, None] * along)
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    to_viewer = top.view.axes_in_rig[:2] @ detail.view.axes_in_rig[2]
    arrow = -to_viewer / np.linalg.norm(to_viewer)
    texts, _ = sheet.occupied()

    def overlaps_of(outer: FloatArray, letter: FloatArray) -> tuple[int, ...]:
        mark = LineString([outer, outer + ARROW_MM * arrow]).union(Point(letter).buffer(0.6 * TEXT_MM)).buffer(0.5)
        return overlaps(mark, texts)

    for end, side in zip(ends, (-1.0, 1.0), strict=True):
        # The letter is behind the arrow, or else in front of it.
        places = [
            (outer, outer + distance * arrow)
            for outer in (end + side * extension * direction for extension in EXTENSIONS_MM)
            for distance in (-2.4, ARROW_MM + 2.4)
        ]
        outer, letter = min(places, key=lambda place: overlaps_of(*place))
        sheet.lines([np.array([end, outer])], MARK_MM)
        tip = outer + ARROW_MM * arrow
        sheet.lines([np.array([outer, tip])], HATCH_LINE_MM)
        sheet.arrow_head(tip, arrow)
        base = letter - np.array([0.0, TEXT_MM / 2.0])
        sheet.text(base, LETTER, TEXT_MM, align="center", bold=True, over_lines=True)


def place_detail(
    detail: SeatDetail, low: FloatArray, high: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Scale and centre (2,) of a detail in a free rectangle, and the rectangle that remains, by its corners."""
    for scale in DETAIL_SCALES:
        size = detail.size_mm(scale)
        for axis, fraction in ((1, 0.6), (0, 0.6)):
            if size[axis] <= fraction * (high - low)[axis] and size[1 - axis] <= (high - low)[1 - axis]:
                break
        else:
            continue
        break
    rest, end = low.copy(), high.copy()
    rest[axis] = end[axis] = low[axis] + size[axis]
    return scale, (low + end) / 2.0, rest, high
