"""The side view of a device as it stands: its rays, the depths of the design, and the desk under it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.drawing_sheet import SOFT, DrawingSheet
from mirrorcam.cad.guide.shading import Screen, ShadedBody, edges_of, merged_lines, render, visible_lines
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stand import aim_in_rig, design_depths_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

STEM = "side_view"
"""File name of the side view, without extension."""
# Width of the sheet, its largest height, its margin, and the space for title and captions.
WIDTH_MM, MAX_HEIGHT_MM, MARGIN_MM, CAPTION_MM = 297.0, 210.0, 12.0, 24.0
EDGE_MM, RAY_MM, MIDDLE_MM, DESK_MM = 0.15, 0.15, 0.5, 0.4
LIGHT, DEPTH_COLOUR = "#d97706", "#5d6778"
DEPTH_DASHES_MM = (2.0, 1.2)
TEXT_MM, TITLE_MM = 2.8, 4.0
HATCH_MM = 4.0
# Resolution on paper of the rendering that determines hidden edges, its margin, and extent past the farthest depth.
PX_PER_MM, EDGE_PX, BEYOND_MM = 8.0, 4, 25.0


def write_side_view(folder: Path, device: Device, components: Sequence[Component]) -> tuple[Path, Path]:
    """Write side_view.svg and side_view.pdf into a folder."""
    return draw_side_view(device, components).write(folder / STEM, "Where the device looks")


def look_text(look_deg: float) -> str:
    """The direction of the views: "level", "30° down" or "12° up"."""
    if abs(look_deg) < 0.05:
        return "level"
    return f"{abs(look_deg):.3g}° {'up' if look_deg > 0.0 else 'down'}"


@dataclass(frozen=True)
class Paper:
    """The scale of the drawing: `low` (2,) in mm, y and z of the stand, is at `corner` (2,) of the sheet."""

    low: FloatArray
    corner: FloatArray
    scale: float

    def at(self, points: FloatArray) -> FloatArray:
        """Positions (..., 2) on the sheet of points (..., 2; y and z of the stand)."""
        return np.asarray(self.corner + (points - self.low) * self.scale)


def draw_side_view(device: Device, components: Sequence[Component]) -> DrawingSheet:
    """Draw a device from its right: it looks to the right of the sheet, and up is up as it stands.

    Drawn are the middle ray, the highest and the lowest ray of all mirrors, the depths of the design, and the desk, or
    what else supports the device. Rays end at the desk or past the farthest depth.
    """
    layout, back = device.layout, device.back
    right, forward, up = back.rig_from_stand.T
    axes = np.array([forward, up, right])
    depths = design_depths_mm(device.layout, device.hardware)
    desk_z = back.stand.z_mm if back.stand else None
    farthest = depths[-1] + BEYOND_MM
    chief = np.array([np.zeros(3), _centre(layout), aim_in_rig(layout, farthest)]) @ axes[:2].T
    rays = [_until_desk(ray, desk_z) for ray in (chief, *_outer_rays(layout, axes, farthest))]
    supports = [_outline(support.solids, axes) for support in back.supports]
    body = np.concatenate([np.asarray(component.mesh.vertices) for component in components]) @ axes[:2].T
    extent = np.vstack([*rays, body, *supports])
    low, high = extent.min(axis=0), extent.max(axis=0)
    size = np.array([WIDTH_MM, MAX_HEIGHT_MM - CAPTION_MM]) - 2.0 * MARGIN_MM
    paper = Paper(low, np.full(2, MARGIN_MM), float((size / (high - low)).min()))
    top = float(paper.at(high)[1]) + MARGIN_MM + CAPTION_MM
    sheet = DrawingSheet(WIDTH_MM, top)
    _draw_device(sheet, paper, components, axes)
    sheet.lines([paper.at(outline) for outline in supports], EDGE_MM, SOFT)
    if desk_z is not None:
        _draw_desk(sheet, paper.at(np.array([(low[0], desk_z), (high[0], desk_z)])))
    sheet.lines([paper.at(rays[0])], MIDDLE_MM, LIGHT)
    sheet.lines([paper.at(ray) for ray in rays[1:]], RAY_MM, LIGHT)
    view_axis = axes[:2] @ layout.view_from_rig[2]
    for depth in depths:
        _draw_depth(sheet, paper, view_axis, depth, rays[1:])
    title = f"Where the device looks: {look_text(back.look_deg)}"
    sheet.text((MARGIN_MM, top - MARGIN_MM - 2.0), title, TITLE_MM, bold=True)
    captions = (
        f"From the right, 1 : {1.0 / paper.scale:.2g}, in mm. Dashed: depths of the design, from the lens's pupil.",
        "Thick: the middle ray, from the lens. Thin: the lowest and the highest ray at the largest depth.",
    )
    for line, caption in enumerate(captions):
        sheet.text((MARGIN_MM, top - MARGIN_MM - 9.0 - 5.0 * line), caption, TEXT_MM, colour=SOFT)
    if desk_z is not None:
        _draw_height(sheet, paper, axes[:2] @ aim_in_rig(layout, depths[-1]), desk_z)
    return sheet


def _centre(layout: Layout) -> FloatArray:
    """The mean (3,) of the mirrors' centres in the rig frame."""
    return np.mean([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors], axis=0)


def _outer_rays(layout: Layout, axes: FloatArray, depth_mm: float) -> list[FloatArray]:
    """The rays (2, 2; y and z of the stand) from mirrors' corners to the lowest and the highest point at a depth."""
    forward = layout.view_from_rig[2]
    rays = []
    for mirror in layout.mirrors:
        for point in mirror.outline_in_rig_mm:
            ray = point - mirror.virtual_centre_in_rig_mm
            end = point + (depth_mm - point @ forward) / (ray @ forward) * ray
            rays.append(np.array([point, end]) @ axes[:2].T)
    rays.sort(key=lambda ray: float(ray[1, 1]))
    return [rays[0], rays[-1]]


def _until_desk(ray: FloatArray, desk_z: float | None) -> FloatArray:
    """A ray (n, 2; y and z of the stand) whose last piece ends where it meets the desk."""
    start, end = ray[-2:]
    if desk_z is None or end[1] >= desk_z:
        return ray
    return np.vstack([ray[:-1], start + (start[1] - desk_z) / (start[1] - end[1]) * (end - start)])


def _outline(solids: Sequence[Frustum], axes: FloatArray) -> FloatArray:
    """The closed convex outline (n, 2; y and z of the stand) of solids."""
    points = corners_of(solids) @ axes[:2].T
    loop = points[ConvexHull(points).vertices]
    return np.vstack([loop, loop[:1]])


def _draw_device(sheet: DrawingSheet, paper: Paper, components: Sequence[Component], axes: FloatArray) -> None:
    """Draw the visible edges of all components."""
    bodies = [ShadedBody(np.asarray(component.mesh.triangles), (1.0, 1.0, 1.0)) for component in components]
    points = np.concatenate([body.triangles.reshape(-1, 3) for body in bodies])
    size = np.ptp(points @ axes[:2].T, axis=0) * paper.scale * PX_PER_MM
    width, height = (int(np.ceil(length)) + 2 * EDGE_PX for length in size)
    screen = Screen.around(points, axes, (width, height), (EDGE_PX, EDGE_PX))
    rendering = render(bodies, screen)
    for component in components:
        lines = [
            paper.at(screen.centre + (line - np.array([width, height]) / 2.0) * (1.0, -1.0) / screen.px_per_mm)
            for line in visible_lines(edges_of(component.mesh, axes[2]), rendering)
        ]
        sheet.lines(merged_lines(lines), EDGE_MM)


def _draw_desk(sheet: DrawingSheet, ends: FloatArray) -> None:
    """Draw the desk between two ends (2, 2) on the sheet, hatched below."""
    sheet.lines([ends], DESK_MM)
    starts = np.arange(ends[0, 0] + HATCH_MM / 2.0, ends[1, 0], HATCH_MM)
    hatches = [np.array([(x, ends[0, 1]), (x - HATCH_MM / 2.0, ends[0, 1] - HATCH_MM / 2.0)]) for x in starts]
    sheet.lines(hatches, RAY_MM)


def _draw_depth(
    sheet: DrawingSheet, paper: Paper, view_axis: FloatArray, depth_mm: float, rays: Sequence[FloatArray]
) -> None:
    """Draw the plane at a depth from the pupil between the outermost rays (2, 2), with its depth above it."""
    across = np.array([-view_axis[1], view_axis[0]])
    ends = []
    for start, end in rays:
        along = (depth_mm - start @ view_axis) / ((end - start) @ view_axis)
        # A ray that ends at the desk before the depth bounds it there.
        ends.append(depth_mm * view_axis + (start + min(along, 1.0) * (end - start)) @ across * across)
    line = paper.at(np.array(ends))
    sheet.lines([line], RAY_MM, DEPTH_COLOUR, DEPTH_DASHES_MM)
    sheet.text(line[1] + np.array([0.0, 1.5]), f"{depth_mm:g}", TEXT_MM, align="center")


def _draw_height(sheet: DrawingSheet, paper: Paper, aim: FloatArray, desk_z: float) -> None:
    """Draw the height of the middle ray above the desk at the farthest depth, or state that the desk is in its path."""
    foot = np.array([aim[0], desk_z])
    if aim[1] <= desk_z:
        sheet.text(paper.at(foot) + np.array([0.0, 3.0]), "the desk is nearer", TEXT_MM, align="right", over_lines=True)
        return
    low, high = paper.at(foot), paper.at(aim)
    sheet.lines([np.array([low, high])], RAY_MM)
    sheet.arrow_head(low, np.array([0.0, -1.0]))
    sheet.arrow_head(high, np.array([0.0, 1.0]))
    text = f"{aim[1] - desk_z:.0f}"
    sheet.text((low + high) / 2.0 + np.array([-1.0, -1.0]), text, TEXT_MM, align="right", over_lines=True)
