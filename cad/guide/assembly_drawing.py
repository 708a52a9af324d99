"""The assembly drawing: an exploded view with item numbers in balloons, the parts list, and the assembled device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.guide.device_pictures import IN_FRONT
from mirrorcam.cad.guide.drawing import draw_tables
from mirrorcam.cad.guide.drawing_sheet import (
    A3_MM,
    BLOCK_MM,
    BORDER_MM,
    PARTS_TOLERANCE,
    DrawingSheet,
    Title,
    draw_title_block,
)
from mirrorcam.cad.guide.labels import innermost_pixel, rows_near, uncrossed_order
from mirrorcam.cad.guide.picture_views import view_axes
from mirrorcam.cad.guide.shading import Rendering, Screen, ShadedBody, edges_of, merged_lines, render, visible_lines
from mirrorcam.cad.plan.dimension import DrawingTable
from mirrorcam.cad.plan.goods import standard_of
from mirrorcam.core.values import FloatArray

STEM = "assembly"
"""File name of the assembly drawing, without extension."""
NUMBER = "MC-00"
PX_PER_MM = 6.0
"""Resolution on paper of the renderings that determine hidden edges."""

EDGE_MM, PALE_MM, LEADER_MM = 0.25, 0.18, 0.13
BALLOON_MM, BALLOON_GAP_MM = 4.0, 5.0
"""Radius of a balloon, and its distance from the view."""
TEXT_MM = 2.5
PATH_COLOUR = "#5d6778"
PATH_DASHES_MM = (2.0, 0.6, 0.5, 0.6)


@dataclass(frozen=True)
class ListedItem:
    """A line of the parts list: identical components."""

    number: int
    components: tuple[Component, ...]
    description: str
    reference: str


def listed_items(components: Sequence[Component]) -> tuple[ListedItem, ...]:
    """The items of a device in the order of components: printed parts, all mirrors as one item, camera, fasteners."""
    groups: dict[str, list[Component]] = {}
    for component in components:
        groups.setdefault("mirrors" if component.kind == "mirror" else component.title, []).append(component)
    listed = []
    for number, (title, group) in enumerate(groups.items(), start=1):
        first = group[0]
        if first.kind == "mirror":
            names = (component.number.removeprefix("M") for component in (first, group[-1]))
            title, reference = f"Mirrors {' to '.join(names)}", "mirrors/*.dxf"
        else:
            reference = first.number or (standard_of(title) if first.item else "")
        listed.append(ListedItem(number, tuple(group), title, reference))
    return tuple(listed)


def draw_assembly(level_from_rig: FloatArray, components: Sequence[Component], revision: str) -> DrawingSheet:
    """Draw the assembly of a device from its components, viewed from the front; `revision` is for the title block.

    `level_from_rig` (3, 3) has the rows right, down and forward as the device stands.
    """
    listed = listed_items(components)
    sheet = DrawingSheet(*A3_MM)
    rows = tuple(
        (str(item.number), str(len(item.components)), item.description, item.reference or "purchased")
        for item in listed
    )
    table = DrawingTable("Parts list", ("item", "qty", "description", "number or standard"), rows, left_aligned=(2, 3))
    left, low = draw_tables(sheet, (table,), 60.0)
    bottom, top = BORDER_MM + BLOCK_MM, A3_MM[1] - BORDER_MM
    axes = view_axes(level_from_rig, IN_FRONT)
    exploded = [(component, component.explode_mm) for component in components]
    margin = BALLOON_GAP_MM + 2.0 * BALLOON_MM + 2.0
    area = np.array([(BORDER_MM + margin, bottom + 6.0), (left - margin, top - 6.0)])
    rendering, corner = _line_view(sheet, exploded, axes, area)
    _draw_paths(sheet, exploded, rendering, corner)
    _draw_balloons(sheet, listed, components, rendering, corner)
    assembled = np.array([(left + 8.0, bottom + 12.0), (A3_MM[0] - BORDER_MM - 6.0, low - 6.0)])
    _line_view(sheet, [(component, np.zeros(3)) for component in components], axes, assembled)
    sheet.text((float(assembled[:, 0].mean()), bottom + 5.0), "Assembled", TEXT_MM, align="center")
    title = Title("Assembly", NUMBER, "see parts list", None, revision, "assembly.step", PARTS_TOLERANCE)
    draw_title_block(sheet, title)
    return sheet


def write_assembly_drawing(
    folder: Path, level_from_rig: FloatArray, components: Sequence[Component], revision: str
) -> tuple[Path, Path]:
    """Write assembly.svg and assembly.pdf into `folder`."""
    return draw_assembly(level_from_rig, components, revision).write(folder / STEM, f"{NUMBER} Assembly")


def _line_view(
    sheet: DrawingSheet, moves: Sequence[tuple[Component, FloatArray]], axes: FloatArray, area: FloatArray
) -> tuple[Rendering, FloatArray]:
    """Draw the visible edges of components, each displaced by a move (3,), mm, in a rectangle (2, 2) of the sheet.

    Returns the rendering that determines hidden edges, with a body for each component, and the rectangle's upper left
    corner.
    """
    size = np.ptp(area, axis=0)
    bodies = [ShadedBody(np.asarray(component.mesh.triangles) + move, (1.0, 1.0, 1.0)) for component, move in moves]
    points = np.concatenate([body.triangles.reshape(-1, 3) for body in bodies])
    width, height = (round(float(side) * PX_PER_MM) for side in size)
    rendering = render(bodies, Screen.around(points, axes, (width, height), (4, 4)))
    corner = np.array([area[0, 0], area[1, 1]])
    for component, move in moves:
        lines = visible_lines(edges_of(component.mesh, axes[2]) + move, rendering)
        sheet.lines(
            merged_lines([_paper(line, corner) for line in lines]), EDGE_MM if component.kind == "part" else PALE_MM
        )
    return rendering, corner


def _paper(pixels: FloatArray, corner: FloatArray) -> FloatArray:
    """Positions (..., 2) on the sheet of pixels (..., 2) of a view."""
    return np.asarray(corner + pixels * (1.0, -1.0) / PX_PER_MM)


def _draw_paths(
    sheet: DrawingSheet, moves: Sequence[tuple[Component, FloatArray]], rendering: Rendering, corner: FloatArray
) -> None:
    """Draw chain lines from fasteners to their seats in the displaced parts that they join."""
    parts = {component.name: move for component, move in moves if component.kind == "part"}
    for component, move in moves:
        if component.item is None:
            continue
        homes = [name for name in parts if any(name.startswith(join) for join in component.item.joins)]
        for home in homes[:1]:
            centre = np.asarray(component.mesh.bounds).mean(axis=0)
            ends = np.array([[centre + move, centre + parts[home]]])
            lines = visible_lines(ends, rendering)
            sheet.lines([_paper(line, corner) for line in lines], LEADER_MM, PATH_COLOUR, PATH_DASHES_MM)


def _draw_balloons(
    sheet: DrawingSheet,
    listed: Sequence[ListedItem],
    components: Sequence[Component],
    rendering: Rendering,
    corner: FloatArray,
) -> None:
    """Draw a balloon for each item, left or right of the view, with a leader to its most visible component."""
    index_of = {component.name: number for number, component in enumerate(components)}
    tips = []
    for item in listed:
        innermost = [innermost_pixel(rendering.bodies == index_of[component.name]) for component in item.components]
        visible = [point for point in innermost if point is not None]
        if visible:
            point = max(visible, key=lambda candidate: candidate[1])[0]
            tips.append((item, _paper(point, corner)))
    rows, columns = (np.flatnonzero((rendering.bodies >= 0).any(axis=axis)) for axis in (1, 0))
    box = _paper(np.array([(columns[0], rows[-1]), (columns[-1], rows[0])], dtype=np.float64), corner)
    tips.sort(key=lambda tip: (tip[1][0], tip[0].number))
    n_left = (len(tips) + 1) // 2
    angles = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = BALLOON_MM * np.column_stack([np.cos(angles), np.sin(angles)])
    for side, group in ((-1.0, tips[:n_left]), (1.0, tips[n_left:])):
        group = sorted(group, key=lambda tip: float(tip[1][1]))
        pitch = 2.6 * BALLOON_MM
        heights = rows_near([float(tip[1]) for _, tip in group], pitch, float(box[0, 1]), float(box[1, 1]))
        x = float(box[0 if side < 0.0 else 1, 0]) + side * BALLOON_GAP_MM
        starts = [np.array([x, height]) for height in heights]
        order = uncrossed_order(starts, [tip for _, tip in group])
        for start, index in zip(starts, order, strict=True):
            item, tip = group[index]
            centre = start + np.array([side * BALLOON_MM, 0.0])
            sheet.lines([centre + circle], EDGE_MM)
            sheet.lines([np.array([start, tip])], LEADER_MM)
            sheet.dot(tip, 0.5)
            sheet.text(centre - (0.0, TEXT_MM / 2.0), str(item.number), TEXT_MM, align="center", bold=True)
