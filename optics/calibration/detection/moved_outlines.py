"""Outlines of mirrors moved to where frames show their edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.detection.mirror_sides import Side
from mirrorcam.optics.calibration.detection.segmentation import SeenEdge
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

AGREES_PX = 3.0  # an edge this near to its place is left there: dim or still parts of a scene move it by 2


def outlined(layout: Layout, edges: Sequence[dict[int, SeenEdge]]) -> tuple[Layout, tuple[str, ...]]:
    """Move the mirrors' outlines to where the frames show them.

    An edge stays where it was not seen. A mirror stays as it is where the new edges would make the layout invalid.

    Parameters
    ----------
    layout
        A layout whose mirror planes are right.
    edges
        Its `seen_edges`.

    Returns
    -------
    layout, notes
        The layout with moved outlines, and a note on each mirror whose edges are beside their places.
    """
    waiting = {}
    for index, (mirror, seen) in enumerate(zip(layout.mirrors, edges, strict=True)):
        moves = {number: edge for number, edge in seen.items() if np.abs(edge.off_px).max() > AGREES_PX}
        if moves:
            far = max(float(np.abs(edge.off_px).max()) for edge in moves.values())
            count = f"{len(moves)} of {len(mirror.outline_in_rig_mm)}"
            text = f"mirror {layout.mirror_names[index]}: {count} edges are seen up to {far:.0f} px"
            waiting[index] = {number: edge.line for number, edge in moves.items()}, text
    return _moved(layout, waiting)


def _moved(layout: Layout, waiting: dict[int, tuple[dict[int, FloatArray], str]]) -> tuple[Layout, tuple[str, ...]]:
    """The layout with the edges of some mirrors on other lines, where that is possible, and a note on each of them."""
    notes = []
    # A mirror whose new outline overlaps another one is tried again once the other one has moved.
    refused = dict.fromkeys(waiting, "")
    for _ in range(len(waiting)):
        for index in list(refused):
            mirrors = list(layout.mirrors)
            try:
                mirrors[index] = with_edges(mirrors[index], waiting[index][0])
                layout = layout.replaced(mirrors=tuple(mirrors))
            except InvalidValue as error:
                refused[index] = str(error)
            else:
                del refused[index]
    for index, (_, edges) in waiting.items():
        outcome = f"not moved: {refused[index]}" if index in refused else "moved there"
        notes.append(f"{edges} beside their places, {outcome}")
    return layout, tuple(notes)


def with_edges(mirror: Mirror, lines: dict[int, FloatArray]) -> Mirror:
    """The mirror with some edges on other lines of its plane frame; raises InvalidValue where that is impossible."""
    corners = mirror.outline_in_plane_mm
    unmoved = [side.moved(side, np.zeros(2)) for side in (Side.of(corners, edge) for edge in range(len(corners)))]
    edges = [lines.get(edge, line) for edge, line in enumerate(unmoved)]
    pairs = zip([edges[-1], *edges[:-1]], edges, strict=True)
    found = np.array([np.linalg.solve([before[:2], line[:2]], [before[2], line[2]]) for before, line in pairs])
    frame = mirror.rig_from_plane
    outline = frame[:3, 3] + found @ frame[:3, :2].T
    if not mirror.curvature_per_m.any():
        return mirror.replaced(outline_in_rig_mm=outline)
    # The same surface, described by its tangent plane in the new middle; the angle between the two planes is so small
    # that the curvature is the same in both.
    middle = found.mean(axis=0)
    xx, yy, xy = mirror.curvature_per_m / 1e3
    rise = frame[:3, :2] @ np.array([[xx, xy], [xy, yy]]) @ middle
    touching = outline.mean(axis=0) + mirror.sag_mm(outline.mean(axis=0)) * mirror.normal_in_rig
    normal = mirror.normal_in_rig - rise
    normal /= np.linalg.norm(normal)
    centre = 2.0 * (normal @ touching) * normal
    return mirror.replaced(
        virtual_centre_in_rig_mm=centre,
        outline_in_rig_mm=outline * ((touching @ normal) / (outline @ normal))[:, None],
    )
