"""Where holes are: those called out as one in one view, numbered ones in a table, and oblique ones in true length."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from mirrorcam.cad.guide.dimension_lines import LINE_MM, TEXT_MM, LinearDimension, number
from mirrorcam.cad.guide.drawing_sheet import INK, Align, DrawingSheet
from mirrorcam.cad.guide.hole_callouts import DEPTH
from mirrorcam.cad.guide.part_views import PartView, PlacedView
from mirrorcam.cad.plan.dimension import DrawingTable, Hole, Length
from mirrorcam.core.values import FloatArray

MOST_PLACES = 4
"""Of more places along x or y than these there is a table: no tiers of dimensions have room for them."""

PARALLEL = 1e-4
AXIS_MM = 0.13
CENTRE_DASHES_MM = (2.0, 0.6, 0.5, 0.6)
VIEWS = ("view from above", "front view", "view from the right")
NUMBER_MM = 2.0
ARC_MM = 9.0
"""Radius of the arc of an angle."""

Groups = dict[tuple[int, str], list[Hole]]


def hole_groups(views: Sequence[PartView], dimensions: Iterable[Length | Hole]) -> Groups:
    """The holes by the index of the view that looks along their axes most, and by their callout in it."""
    groups: Groups = defaultdict(list)
    for hole in dimensions:
        if isinstance(hole, Hole):
            axis = _unit(hole.axis_in_rig)
            facing = [abs(float(view.axes_in_rig[2] @ axis)) for view in views]
            index = int(np.argmax(np.round(facing, 6)))
            groups[index, callout(hole, float(axis @ views[index].axes_in_rig[2]))].append(hole)
    return groups


def callout(hole: Hole, away: float) -> str:
    """The words at a hole, whose axis points `away` from the viewer by this cosine."""
    size = f"Ø{number(hole.diameter_mm)}"
    if hole.travel_mm:
        size = f"slot {number(hole.diameter_mm)} x {number(hole.diameter_mm + hole.travel_mm)}"
    words = {"hexagon": f"hex {size[1:]} A/F", "countersink": f"countersink {size}"}.get(hole.form, size)
    words = f"{words} {hole.text}"
    blind = hole.cut_mm is not None and (DEPTH in hole.text or hole.form == "countersink")
    return f"{words.strip()} (far side)" if blind and away > 0.5 else words.strip()


def in_table(holes: Sequence[Hole], view: PartView) -> bool:
    """Whether holes of one callout are at too many places for dimensions, in a view that is square to their axis."""
    if abs(float(view.axes_in_rig[2] @ _unit(holes[0].axis_in_rig))) < 1.0 - PARALLEL:
        return False
    flat = np.array([hole.centre_in_rig for hole in holes]) @ view.axes_in_rig[:2].T
    return any(len(np.unique(np.round(flat[:, axis], 3))) > MOST_PLACES for axis in (0, 1))


def numbered(holes: Sequence[Hole], view: PartView) -> list[Hole]:
    """Holes in the order of their numbers, 1 on: from above downwards in the view, and from left to right."""
    flat = np.array([hole.centre_in_rig for hole in holes]) @ view.axes_in_rig[:2].T
    return [holes[place] for place in np.lexsort((np.round(flat[:, 0], 3), -np.round(flat[:, 1], 3)))]


def hole_tables(groups: Groups, views: Sequence[PartView]) -> tuple[DrawingTable, ...]:
    """A table of places for every callout that has too many for dimensions."""
    tables = []
    for (index, words), holes in groups.items():
        view = views[index]
        if not in_table(holes, view):
            continue
        origin, named = view.box[0], "the lower left corner of that view"
        if (datum := holes[0].datum) is not None:
            origin, named = view.axes_in_rig[:2] @ datum.at_in_rig, datum.name
        rows = []
        for place, hole in enumerate(numbered(holes, view), start=1):
            x, y = view.axes_in_rig[:2] @ hole.centre_in_rig - origin
            rows.append((str(place), f"{x:.2f}", f"{y:.2f}"))
        title = f"Holes {words.split()[0]}"
        tables.append(DrawingTable(title, ("no.", "x", "y"), tuple(rows), (f"{VIEWS[index]}, mm from", named)))
    return tuple(tables)


def draw_numbers(sheet: DrawingSheet, placed: PlacedView, holes: Sequence[Hole]) -> None:
    """The number of each hole of a table, at its lower right: leaders come from above."""
    for place, hole in enumerate(numbered(holes, placed.view), start=1):
        off = hole.diameter_mm / 2.0 * placed.scale * 0.71 + 0.8
        at = placed.paper(hole.centre_in_rig) + np.array([off, -off - NUMBER_MM])
        sheet.text((float(at[0]), float(at[1])), str(place), NUMBER_MM, over_lines=True)


def oblique_holes(groups: Groups, views: Sequence[PartView], lengths: Iterable[Length]) -> list[tuple[int, Hole]]:
    """Holes that no view looks along and no length leads to, with the view that has their axes in its plane.

    Of those whose axes are one line in that view the one that is entered from outside: a blind one, where there is one.
    """
    ends = np.vstack([np.zeros((0, 3)), *(each.points_in_rig for each in lengths)])
    found: dict[tuple[float, ...], tuple[int, Hole]] = {}
    for hole in (hole for holes in groups.values() for hole in holes):
        axis = _unit(hole.axis_in_rig)
        facing = np.abs([float(view.axes_in_rig[2] @ axis) for view in views])
        if facing.max() > 1.0 - PARALLEL or facing.min() > PARALLEL:
            continue
        index = int(facing.argmin())
        flat = views[index].axes_in_rig[:2]
        across = np.array([-(flat[1] @ axis), flat[0] @ axis])
        level = float(across @ flat @ hole.centre_in_rig)
        if (np.abs(ends @ flat.T @ across - level) < 1e-2).any():
            continue
        line = (index, *np.round([*np.abs(across), level], 2).tolist())
        if line not in found or DEPTH in hole.text:
            found[line] = (index, hole)
    return list(found.values())


def oblique_lengths(placed: PlacedView, hole: Hole) -> tuple[LinearDimension, LinearDimension]:
    """How far the middle of an oblique hole's mouth is from the left edge of a view, and from the lower one."""
    at, low = placed.paper(hole.centre_in_rig), placed.box[0]
    across, up = (
        LinearDimension(
            np.array([low[k], at[k]]), np.array([low[1 - k], at[1 - k]]), number(float(at[k] - low[k]) / placed.scale)
        )
        for k in (0, 1)
    )
    return across, up


def draw_oblique(sheet: DrawingSheet, placed: PlacedView, hole: Hole) -> None:
    """The axis of an oblique hole in a view that has it in its plane, and its angle to the nearer axis of the view."""
    at = placed.paper(hole.centre_in_rig)
    out = -(placed.view.axes_in_rig[:2] @ _unit(hole.axis_in_rig))
    turned = float(np.degrees(np.arctan2(out[1], out[0])))
    level = float(np.copysign(180.0, turned)) if out[0] < 0.0 else 0.0
    base = level if abs(turned - level) < 45.0 + PARALLEL else float(np.copysign(90.0, turned))
    reach = np.array([-hole.diameter_mm * placed.scale, ARC_MM + 2.0])
    sheet.lines([at + np.outer(reach, out)], AXIS_MM, INK, CENTRE_DASHES_MM)

    def ray(angle: float) -> FloatArray:
        return np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])

    sheet.lines([at + np.outer([1.0, ARC_MM + 2.0], ray(base))], LINE_MM)
    sheet.lines([np.array([at + ARC_MM * ray(angle) for angle in np.linspace(base, turned, 25)])], LINE_MM)
    sense = np.sign(turned - base)
    for angle, way in ((base, -sense), (turned, sense)):
        sheet.arrow_head(at + ARC_MM * ray(angle), way * np.array([-ray(angle)[1], ray(angle)[0]]))
    middle = at + (ARC_MM + 1.5) * ray((base + turned) / 2.0)
    align: Align = "left" if middle[0] >= at[0] else "right"
    sheet.text(
        (float(middle[0]), float(middle[1]) - TEXT_MM / 2.0), f"{number(abs(turned - base))}°", TEXT_MM, align=align
    )


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
