"""Segmentation of the sub-images: detects their edges on the sensor, and moves the mirrors' outlines there.

The image in a mirror changes from frame to frame; the gaps between mirrors and the holder do not. A mirror that was cut
too short or glued out of place shows the same corners, but less or more of the scene: its plane is right, its outline
is wrong. Its edges lie where pixels stop changing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from shapely import Polygon

from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import solve_tangent_in_air

SEARCH_PX = 40.0  # search range on either side of an edge; 2 mm within the plane are 32 px on a C920
STEP_PX = 4.0  # along an edge
FINE_PX = 0.5  # across an edge
MIN_CHANGE = 25.0  # grey levels between a pixel's darkest and brightest value, within a sub-image
MIN_VISIBLE = 0.5, 0.2, 0.2  # visible fraction of an edge's length: in all frames, and in each half of them
MIN_LENGTH_PX = 40.0
TOLERANCE_PX = 1.5  # between a point and the straight line through the others
MIN_COSINE = 0.97  # of the angle between the edge of a mirror and the edge of its sub-image
MAX_HALF_DIFFERENCE_PX = 1.5  # of an edge between halves of the frames
MIN_MOVE_PX = 3.0  # of an edge: dim or static parts of a scene shift its detected position by 2 px


class Extremes:
    """The minimum and maximum of each pixel (h, w) over frames, separately for even and odd frames."""

    def __init__(self) -> None:
        self._halves: list[tuple[Grey, Grey]] = []
        self._count = 0

    def add(self, grey: Grey) -> None:
        """Add a frame."""
        half = self._count % 2
        self._count += 1
        if half == len(self._halves):
            self._halves.append((grey.copy(), grey.copy()))
        else:
            darkest, brightest = self._halves[half]
            np.minimum(darkest, grey, out=darkest)
            np.maximum(brightest, grey, out=brightest)

    def changes(self) -> tuple[Grey, Grey, Grey] | None:
        """Range of each pixel in grey levels, over all frames and over each half; None for fewer than four frames."""
        if self._count < 4:
            return None
        (dark, bright), (other_dark, other_bright) = self._halves
        total = np.maximum(bright, other_bright) - np.minimum(dark, other_dark)
        return total, bright - dark, other_bright - other_dark


@dataclass(frozen=True)
class DetectedEdge:
    """Position of a mirror's edge, detected in the frames.

    Attributes
    ----------
    line
        Coefficients (nx, ny, d) of nx x + ny y = d in the mirror's own frame, mm.
    offset_px
        Outward offsets (2,) of the edge's ends from the layout's edge, px.
    offset_mm
        Mean outward offset within the mirror's plane, mm.
    midpoint_in_rig_mm, outward_in_rig
        Midpoint (3,) of the layout's edge, and its outward normal (3,) within the mirror's plane.
    """

    line: FloatArray
    offset_px: FloatArray
    offset_mm: float
    midpoint_in_rig_mm: FloatArray
    outward_in_rig: FloatArray


def detected_edges(layout: Layout, extremes: Extremes) -> list[dict[int, DetectedEdge]]:
    """Detect the edges of each mirror in the frames; return them by their number in the outline.

    Edges are searched within `SEARCH_PX`. An edge is left out if it is not visible (off the sensor, or adjacent to
    another sub-image without a gap), or if it differs between the halves of the frames, for example because a board was
    held in front of the mirror's edge.

    Parameters
    ----------
    layout
        A layout with calibrated mirror planes.
    extremes
        Pixel-wise extremes of the frames.
    """
    changes = extremes.changes()
    if changes is None:
        return [{} for _ in layout.mirrors]
    found = []
    for index in range(len(layout.mirrors)):
        in_all_frames, in_even, in_odd = (
            _edges(change, layout, index, min_visible) for change, min_visible in zip(changes, MIN_VISIBLE, strict=True)
        )
        agreeing = {
            edge: detected
            for edge, detected in in_all_frames.items()
            if edge in in_even and edge in in_odd
            if np.abs(in_even[edge].offset_px - in_odd[edge].offset_px).max() < MAX_HALF_DIFFERENCE_PX
        }
        found.append(agreeing)
    return found


def _edges(change: Grey, layout: Layout, index: int, min_visible: float) -> dict[int, DetectedEdge]:
    """Return the visible edges of an outline, by number."""
    mirror, camera = layout.mirrors[index], layout.camera
    apparent, usable = mirror.apparent, visible_part_in_plane_mm(mirror)
    found = {}
    sides = [Side.of(usable, edge) for edge in range(len(usable))]
    for edge in range(len(mirror.outline_in_rig_mm)):
        # The image in a second-surface mirror ends before the edge of its coating, almost parallel to it.
        nominal = Side.of(mirror.outline_in_plane_mm, edge)
        side = max(sides, key=lambda side: float(side.outward @ nominal.outward), default=None)
        if side is None or side.outward @ nominal.outward < MIN_COSINE:
            continue

        def pixels(s: FloatArray, d: FloatArray, side: Side = side) -> FloatArray:
            """Pixels (..., 2) at `s` along a side and `d` outwards, mm."""
            flat = side.start + s[..., None] * side.direction + d[..., None] * side.outward
            points = apparent.rig_from_plane[:3, 3] + flat @ apparent.rig_from_plane[:3, :2].T
            return camera.project(points + apparent.sag_mm(points)[..., None] * apparent.normal_in_rig)

        first, last = pixels(np.array([0.0, side.length_mm]), np.zeros(2))
        length_px = float(np.linalg.norm(last - first))
        near = pixels(np.full(2, side.length_mm / 2.0), np.array([0.0, 0.1]))
        px_per_mm = float(np.linalg.norm(near[1] - near[0])) / 0.1
        count = int(length_px / STEP_PX) if np.isfinite(length_px) else 0
        if count < 4:
            continue
        # Skip the ends, where the adjacent edges are.
        s = side.length_mm * np.linspace(0.06, 0.94, count)
        d = np.arange(-SEARCH_PX, SEARCH_PX + FINE_PX / 2.0, FINE_PX) / px_per_mm
        profiles = pixels(s[:, None] + 0.0 * d, d + 0.0 * s[:, None])
        offsets = _ends_of_change(change, profiles, d * px_per_mm)
        line = _consensus_line(s, offsets, min_agreeing=max(MIN_LENGTH_PX, min_visible * 0.88 * length_px) / STEP_PX)
        if line is None:
            continue
        ends = np.array([0.0, side.length_mm])
        offset_mm = (line[0] * ends + line[1]) / px_per_mm
        offset_px = np.sign(offset_mm) * np.linalg.norm(pixels(ends, offset_mm) - pixels(ends, np.zeros(2)), axis=1)
        frame = mirror.rig_from_plane
        found[edge] = DetectedEdge(
            line=nominal.displaced_line(side, offset_mm),
            offset_px=offset_px,
            offset_mm=float(offset_mm.mean()),
            midpoint_in_rig_mm=frame[:3, 3]
            + frame[:3, :2] @ (nominal.start + nominal.length_mm / 2.0 * nominal.direction),
            outward_in_rig=frame[:3, :2] @ nominal.outward,
        )
    return found


def _consensus_line(positions: FloatArray, offsets: FloatArray, *, min_agreeing: float) -> tuple[float, float] | None:
    """Slope and constant of the consensus line of offsets (n,), if at least `min_agreeing` agree; NaNs are ignored."""
    finite = np.flatnonzero(np.isfinite(offsets))
    if len(finite) < min_agreeing:
        return None
    pairs, span = finite[:: max(len(finite) // 24, 1)], np.ptp(positions)
    best = np.zeros(len(offsets), dtype=bool)
    for i in pairs:
        for j in pairs:
            if positions[j] - positions[i] > 0.25 * span:
                slope = (offsets[j] - offsets[i]) / (positions[j] - positions[i])
                near = np.abs(offsets - offsets[i] - slope * (positions - positions[i])) < TOLERANCE_PX
                if near.sum() > best.sum():
                    best = near
    if best.sum() < min_agreeing:
        return None
    slope, constant = np.polyfit(positions[best], offsets[best], 1)
    return float(slope), float(constant)


def _ends_of_change(change: Grey, pixels: FloatArray, offsets_px: FloatArray) -> FloatArray:
    """Offset (n,) at which change ends on profiles of pixels (n, m, 2) with offsets (m,); NaN if not visible."""
    size = np.array(change.shape[::-1], dtype=np.float64)
    on_sensor = (np.isfinite(pixels) & (pixels >= 0) & (pixels <= size - 1.0)).all(axis=2)
    uv = np.nan_to_num(pixels, nan=-1.0).astype(np.float32)
    profiles = cv2.remap(
        change.astype(np.float32), uv[..., 0], uv[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.array([_end_of_change(profile, offsets_px) for profile in np.where(on_sensor, profiles, np.nan)])


def _end_of_change(profile: FloatArray, offsets_px: FloatArray) -> float:
    """Offset where a profile from inside to outside falls below half of its value inside; NaN if it does not."""
    usable = np.isfinite(profile)
    if usable.sum() < 20:
        return float("nan")
    profile, offsets_px = profile[usable], offsets_px[usable]
    inside = float(np.median(profile[: max(len(profile) // 4, 8)]))
    if inside < MIN_CHANGE:
        return float("nan")
    below = profile < 0.5 * inside
    # The first point from which the profile stays below for three pixels.
    run = np.convolve(below, np.ones(6), mode="valid") == 6
    if not run.any() or run[0]:
        return float("nan")
    first = int(np.argmax(run))
    before, after = profile[first - 1], profile[first]
    return float(offsets_px[first - 1] + FINE_PX * (before - 0.5 * inside) / max(before - after, 1e-6))


def with_detected_outlines(layout: Layout, edges: Sequence[dict[int, DetectedEdge]]) -> tuple[Layout, tuple[str, ...]]:
    """Move the mirrors' outlines to the detected edges.

    An edge that is not visible stays. A mirror keeps its outline if the new edges would make the layout invalid.

    Parameters
    ----------
    layout
        A layout with calibrated mirror planes.
    edges
        Result of `detected_edges`.

    Returns
    -------
    layout, notes
        The layout with moved outlines, and a note on each mirror with displaced edges.
    """
    new_lines = {}
    for index, (mirror, detected) in enumerate(zip(layout.mirrors, edges, strict=True)):
        displaced = {number: edge for number, edge in detected.items() if np.abs(edge.offset_px).max() > MIN_MOVE_PX}
        if displaced:
            largest_px = max(float(np.abs(edge.offset_px).max()) for edge in displaced.values())
            count = f"{len(displaced)} of {len(mirror.outline_in_rig_mm)}"
            text = f"mirror {layout.mirror_names[index]}: {count} edges are displaced by up to {largest_px:.0f} px"
            new_lines[index] = {number: edge.line for number, edge in displaced.items()}, text
    return _with_moved_edges(layout, new_lines)


def _with_moved_edges(
    layout: Layout, new_lines: dict[int, tuple[dict[int, FloatArray], str]]
) -> tuple[Layout, tuple[str, ...]]:
    """Move edges of mirrors to new lines where the layout stays valid; return the layout and a note on each mirror."""
    notes = []
    # A mirror whose new outline overlaps another mirror is tried again after that mirror has moved.
    refused = dict.fromkeys(new_lines, "")
    for _ in range(len(new_lines)):
        for index in list(refused):
            mirrors = list(layout.mirrors)
            try:
                mirrors[index] = with_edges(mirrors[index], new_lines[index][0])
                layout = layout.replaced(mirrors=tuple(mirrors))
            except InvalidValue as error:
                refused[index] = str(error)
            else:
                del refused[index]
    for index, (_, edges) in new_lines.items():
        outcome = f"not moved: {refused[index]}" if index in refused else "outline moved there"
        notes.append(f"{edges}, {outcome}")
    return layout, tuple(notes)


def with_edges(mirror: Mirror, lines: dict[int, FloatArray]) -> Mirror:
    """Return the mirror with some edges moved to lines in its plane frame; raises InvalidValue if impossible."""
    corners = mirror.outline_in_plane_mm
    present_lines = [
        side.displaced_line(side, np.zeros(2)) for side in (Side.of(corners, edge) for edge in range(len(corners)))
    ]
    edges = [lines.get(edge, line) for edge, line in enumerate(present_lines)]
    pairs = zip([edges[-1], *edges[:-1]], edges, strict=True)
    found = np.array([np.linalg.solve([before[:2], line[:2]], [before[2], line[2]]) for before, line in pairs])
    frame = mirror.rig_from_plane
    outline = frame[:3, 3] + found @ frame[:3, :2].T
    if not mirror.curvature_per_m.any():
        return mirror.replaced(outline_in_rig_mm=outline)
    # The same surface, described by its tangent plane at the new midpoint. The two planes differ so little that the
    # curvature is the same in both.
    midpoint = found.mean(axis=0)
    xx, yy, xy = mirror.curvature_per_m / 1e3
    gradient = frame[:3, :2] @ np.array([[xx, xy], [xy, yy]]) @ midpoint
    tangent_point = outline.mean(axis=0) + mirror.sag_mm(outline.mean(axis=0)) * mirror.normal_in_rig
    normal = mirror.normal_in_rig - gradient
    normal /= np.linalg.norm(normal)
    centre = 2.0 * (normal @ tangent_point) * normal
    return mirror.replaced(
        virtual_centre_in_rig_mm=centre,
        outline_in_rig_mm=outline * ((tangent_point @ normal) / (outline @ normal))[:, None],
    )


@dataclass(frozen=True)
class Side:
    """An edge of a polygon in a mirror's own frame, mm, from `start` (2,) along `direction` (2,), and its normal."""

    start: FloatArray
    direction: FloatArray
    outward: FloatArray
    length_mm: float

    @classmethod
    def of(cls, polygon: FloatArray, edge: int) -> Side:
        start, end = polygon[edge], polygon[(edge + 1) % len(polygon)]
        length_mm = float(np.linalg.norm(end - start))
        direction = (end - start) / length_mm
        outward = np.array([direction[1], -direction[0]])
        return cls(start, direction, outward * np.sign(outward @ (start - polygon.mean(axis=0))), length_mm)

    def displaced_line(self, other: Side, offset_mm: FloatArray) -> FloatArray:
        """The line (nx, ny, d) of this edge after outward displacements (2,) at the ends of the nearby edge `other`."""
        ends = np.array([other.start, other.start + other.length_mm * other.direction])
        positions = (ends - self.start) @ self.direction
        first, second = self.start + positions[:, None] * self.direction + offset_mm[:, None] * self.outward
        normal = np.array([second[1] - first[1], first[0] - second[0]]) / np.linalg.norm(second - first)
        return np.array([*normal, normal @ first])


def visible_part_in_plane_mm(mirror: Mirror) -> FloatArray:
    """Return the polygon (n, 2) on the `apparent` mirror's plane within which the camera sees the scene, mm.

    For a first-surface mirror, this is the entire mirror. For a second-surface mirror, whose front is cut like its
    coating, it is where light both enters and leaves through the front. `Mirror.usable_normalized` approximates this by
    the chief ray, with errors of some pixels towards the sides. Here the corners are exact: each corner of the front
    appears directly, and again where the light that entered at the corner leaves, after twice the plate's thickness.
    """
    apparent = mirror.apparent
    if not mirror.is_second_surface:
        return apparent.outline_in_plane_mm
    air_mm = mirror.distance_mm - mirror.thickness_mm
    foot = -air_mm * mirror.normal_in_rig
    lateral = mirror.outline_in_rig_mm + mirror.distance_mm * mirror.normal_in_rig
    lateral_mm = np.linalg.norm(lateral, axis=1, keepdims=True)
    tangent = solve_tangent_in_air(lateral_mm, air_mm, 2.0 * mirror.thickness_mm, mirror.refractive_index)
    entry_ratio = np.divide(air_mm * tangent, lateral_mm, out=np.ones_like(tangent), where=lateral_mm > 0.0)
    front, entry = foot + lateral, foot + entry_ratio * lateral
    overlap = Polygon(front[:, :2] / front[:, 2:]).intersection(Polygon(entry[:, :2] / entry[:, 2:]))
    if overlap.area <= 0.0:
        return np.zeros((0, 2))
    on_plane = apparent.intersect(np.array(overlap.exterior.coords)[:-1])
    return (on_plane - apparent.rig_from_plane[:3, 3]) @ apparent.rig_from_plane[:3, :2]
