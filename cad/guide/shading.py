"""Orthographic pictures of triangles: shaded with a z-buffer in numpy, or as line art of sharp edges and outlines.

Both are the same on every machine, and need no display.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray

Rgb = tuple[float, float, float]
Pixels = NDArray[np.uint8]
SUPERSAMPLING = 2
# Number of fragments in a block, which limits memory.
FRAGMENTS = 1_500_000
# An edge is drawn between adjacent pixels if the cosine between their normals is smaller, or their depth step larger.
EDGE_COSINE = 0.97
EDGE_JUMP_PX = 9.0
EDGE_DARKNESS = 0.62
# Bias towards the viewer, so that rounding does not hide lines on a surface.
LINE_BIAS_MM = 0.3
# Directions to two lights in the viewer's axes (right, up, towards), and their strengths; ambient light is added.
LIGHTS = ((np.array([-0.45, 0.60, 0.66]), 0.42), (np.array([0.70, 0.10, 0.50]), 0.16))
AMBIENT = 0.50
# Ambient occlusion: the z of a pixel is compared with the mean z of squares of these sizes, mm.
CORNER_MM = (3.0, 9.0)
CORNER_DARKNESS = 0.55


@dataclass(frozen=True)
class ShadedBody:
    """Triangles (n, 3, 3) in the rig frame, mm, counter-clockwise, in one colour (0 to 1); mirrors `shine`."""

    triangles: FloatArray
    rgb: Rgb
    shine: bool = False


@dataclass(frozen=True)
class Screen:
    """An orthographic view: `axes` (3, 3) with rows right, up and towards the viewer, centre (2,) in mm, and scale."""

    axes: FloatArray
    centre: FloatArray
    px_per_mm: float
    size_px: tuple[int, int]

    @classmethod
    def around(
        cls, points_in_rig: FloatArray, axes: FloatArray, size_px: tuple[int, int], margins_px: tuple[int, int]
    ) -> Screen:
        """The view that shows all points (n, 3), at least `margins_px` (x, y) from the picture's sides."""
        projected = points_in_rig @ axes[:2].T
        low, high = projected.min(axis=0), projected.max(axis=0)
        free = np.array(size_px) - 2.0 * np.array(margins_px)
        return cls(axes, (low + high) / 2.0, float((free / np.maximum(high - low, 1e-6)).min()), size_px)

    def pixels(self, points_in_rig: FloatArray) -> FloatArray:
        """Column, row (px) and z (mm, towards the viewer) (..., 3) of points (..., 3)."""
        projected = points_in_rig @ self.axes.T
        scale = np.array([self.px_per_mm, -self.px_per_mm])
        columns_rows = (projected[..., :2] - self.centre) * scale + np.array(self.size_px) / 2.0
        return np.concatenate([columns_rows, projected[..., 2:]], axis=-1)


@dataclass(frozen=True)
class Rendering:
    """A picture (h, w, 3), with the index of the body (-1: none) and the z (mm, towards the viewer) of each pixel."""

    image: Pixels
    bodies: NDArray[np.int32]
    z_mm: NDArray[np.float32]
    screen: Screen


def render(
    bodies: Sequence[ShadedBody], screen: Screen, lines: Sequence[tuple[FloatArray, Rgb, float]] = ()
) -> Rendering:
    """Draw bodies and visible parts of polylines (points (n, 3) in the rig frame, colour, width in px) on white."""
    fine = Screen(
        screen.axes,
        screen.centre,
        screen.px_per_mm * SUPERSAMPLING,
        (screen.size_px[0] * SUPERSAMPLING, screen.size_px[1] * SUPERSAMPLING),
    )
    triangles = np.concatenate([body.triangles for body in bodies])
    owners = np.repeat(np.arange(len(bodies)), [len(body.triangles) for body in bodies])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    front_facing = (lengths > 1e-12) & (normals @ screen.axes[2] > 1e-9 * lengths)
    triangles, owners, normals = (
        triangles[front_facing],
        owners[front_facing],
        normals[front_facing] / lengths[front_facing, None],
    )
    corners = fine.pixels(triangles)
    left, top, right, bottom = _window(corners, fine)
    inside = np.s_[top:bottom, left:right]
    shape = fine.size_px[::-1]
    z_mm, index = np.full(shape, -np.inf, dtype=np.float32), np.full(shape, -1, dtype=np.int32)
    image = np.ones((*shape, 3), dtype=np.float32)
    size = (right - left, bottom - top)
    z_mm[inside], index[inside] = _rasterise(corners - (left, top, 0.0), size)
    image[inside] = _shade(bodies, owners, normals @ screen.axes.T, index[inside], z_mm[inside], fine.px_per_mm)
    for points, rgb, width in lines:
        _draw_line(image, z_mm, fine, points, rgb, max(1, round(width * SUPERSAMPLING)))
    size = screen.size_px
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    pixel_triangles = index[::SUPERSAMPLING, ::SUPERSAMPLING]
    owner = np.where(pixel_triangles >= 0, owners[pixel_triangles], -1).astype(np.int32)
    pixels = np.asarray(np.clip(np.round(small * 255.0), 0, 255), dtype=np.uint8)
    return Rendering(pixels, owner, z_mm[::SUPERSAMPLING, ::SUPERSAMPLING], screen)


def _window(corners: FloatArray, fine: Screen) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the pixels that triangles with corners (n, 3, 3) may colour, by occlusion too."""
    if not len(corners):
        return 0, 0, *fine.size_px
    margin = max(CORNER_MM) * fine.px_per_mm / 2.0 + 3.0
    # Whole pixels of the picture: occlusion is computed at its resolution.
    low = np.floor((corners[..., :2].min(axis=(0, 1)) - margin) / SUPERSAMPLING) * SUPERSAMPLING
    high = np.ceil((corners[..., :2].max(axis=(0, 1)) + margin) / SUPERSAMPLING) * SUPERSAMPLING
    left, top = np.clip(low, 0, np.array(fine.size_px) - SUPERSAMPLING).astype(int).tolist()
    right, bottom = np.clip(high, (left + SUPERSAMPLING, top + SUPERSAMPLING), fine.size_px).astype(int).tolist()
    return left, top, right, bottom


def _rasterise(corners: FloatArray, size_px: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """z (h, w), and index of the nearest triangle (h, w; -1: none), for corners (n, 3, 3) in px and mm."""
    width, height = size_px
    z_mm = np.full(width * height, -np.inf, dtype=np.float32)
    index = np.full(width * height, -1, dtype=np.int32)
    for triangle, pixel, z in _fragments(corners, width, height):
        previous = z_mm[pixel]
        np.maximum.at(z_mm, pixel, z)
        nearest = (z == z_mm[pixel]) & (z > previous)
        index[pixel[nearest]] = triangle[nearest]
    return z_mm.reshape(height, width), index.reshape(height, width)


def _fragments(
    corners: FloatArray, width: int, height: int
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.float32]]]:
    """Blocks of (triangle, pixel, z) for all pixels with their centre in a triangle, row by row."""
    pixels = corners[..., :2]
    edge_a, edge_b = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    area = edge_a[:, 0] * edge_b[:, 1] - edge_a[:, 1] * edge_b[:, 0]
    dz = corners[:, 1:, 2] - corners[:, :1, 2]
    regular = np.abs(area) > 1e-9
    safe = np.where(regular, area, 1.0)
    dz_dx = (dz[:, 0] * edge_b[:, 1] - dz[:, 1] * edge_a[:, 1]) / safe
    dz_dy = (dz[:, 1] * edge_a[:, 0] - dz[:, 0] * edge_b[:, 0]) / safe
    top = np.clip(np.ceil(pixels[..., 1].min(axis=1) - 0.5), 0, height).astype(int)
    bottom = np.clip(np.floor(pixels[..., 1].max(axis=1) - 0.5) + 1, 0, height).astype(int)
    rows = np.where(regular, np.maximum(bottom - top, 0), 0)
    triangle = np.repeat(np.arange(len(corners)), rows)
    row = np.arange(len(triangle)) - np.repeat(np.cumsum(rows) - rows, rows) + top[triangle]
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    y = row + 0.5
    for first, second in ((0, 1), (1, 2), (2, 0)):
        a, b = pixels[triangle, first], pixels[triangle, second]
        with np.errstate(divide="ignore", invalid="ignore"):
            x = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        crossed = (np.minimum(a[:, 1], b[:, 1]) <= y) & (y <= np.maximum(a[:, 1], b[:, 1])) & (a[:, 1] != b[:, 1])
        left, right = np.where(crossed, np.minimum(left, x), left), np.where(crossed, np.maximum(right, x), right)
    crossed = left <= right
    # Includes pixels slightly outside the triangle, so that there is no crack between adjacent triangles.
    start = np.clip(np.ceil(np.where(crossed, left, 0.0) - 0.5 - 1e-4), 0, width).astype(int)
    stop = np.clip(np.floor(np.where(crossed, right, -1.0) - 0.5 + 1e-4) + 1, 0, width).astype(int)
    counts = np.maximum(stop - start, 0)
    slope, corner = dz_dx[triangle], corners[triangle, 0]
    first_z = corner[:, 2] + slope * (start + 0.5 - corner[:, 0]) + dz_dy[triangle] * (y - corner[:, 1])
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    block_ends = np.searchsorted(ends, np.arange(FRAGMENTS, total + FRAGMENTS, FRAGMENTS))
    for low, high in pairwise([0, *(min(int(end) + 1, len(counts)) for end in block_ends)]):
        block = np.s_[low:high]
        span = counts[block]
        # Distance of each fragment from the first in its row.
        along = np.arange(int(span.sum())) - np.repeat(np.cumsum(span) - span, span)
        z = np.repeat(first_z[block], span) + np.repeat(slope[block], span) * along
        pixel = np.repeat(row[block] * width + start[block], span) + along
        yield np.repeat(triangle[block], span).astype(np.int32), pixel, z.astype(np.float32)


def _shade(
    bodies: Sequence[ShadedBody],
    owners: NDArray[np.int64],
    normals_in_view: FloatArray,
    index: NDArray[np.int32],
    z_mm: NDArray[np.float32],
    px_per_mm: float,
) -> NDArray[np.float32]:
    """Colours (h, w, 3): two lights, ambient occlusion, dark edges; a mirror shows a sky that is brighter upwards."""
    light = np.full(len(owners), AMBIENT)
    for direction, strength in LIGHTS:
        light += strength * np.maximum(normals_in_view @ (direction / np.linalg.norm(direction)), 0.0)
    colours = np.array([body.rgb for body in bodies])[owners] * light[:, None]
    shines = np.array([body.shine for body in bodies])[owners]
    # A mirror with normal n, seen along -z, reflects to 2 n_z n - z.
    mirrored_up = 2.0 * normals_in_view[:, 2] * normals_in_view[:, 1]
    sky = np.array([0.52, 0.66, 0.80]) + np.array([0.40, 0.30, 0.19]) * (0.5 + 0.5 * mirrored_up)[:, None]
    colours = np.where(shines[:, None], sky, colours)
    colours = np.vstack([colours, np.ones(3)]).astype(np.float32)
    normals = np.vstack([normals_in_view, np.zeros(3)]).astype(np.float32)
    covered = index >= 0
    unoccluded = _unoccluded(z_mm[::SUPERSAMPLING, ::SUPERSAMPLING], px_per_mm / SUPERSAMPLING)
    brightness = np.asarray(
        cv2.resize(unoccluded, index.shape[::-1], interpolation=cv2.INTER_NEAREST), dtype=np.float32
    )
    z = np.where(covered, z_mm, np.float32(-1e9))
    edge = np.zeros(index.shape, dtype=bool)
    for pixels, neighbours in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        # Only the few pairs of pixels with different triangles are compared.
        differs = index[pixels] != index[neighbours]
        first, second = index[pixels][differs], index[neighbours][differs]
        bent = np.einsum("nc,nc->n", normals[first], normals[second]) < EDGE_COSINE
        stepped = np.abs(z[pixels][differs] - z[neighbours][differs]) > EDGE_JUMP_PX / px_per_mm
        differs[differs] = bent | stepped
        edge[pixels] |= differs
        edge[neighbours] |= differs
    brightness[edge] *= 1.0 - EDGE_DARKNESS
    brightness[edge & ~covered] *= 0.7
    return np.asarray(cv2.multiply(np.take(colours, index, axis=0), cv2.merge([brightness] * 3)))


def _unoccluded(z_mm: NDArray[np.float32], px_per_mm: float) -> NDArray[np.float32]:
    """The share (h, w) of ambient light that reaches the surface with z (h, w); 1 where z is not finite."""
    covered = np.isfinite(z_mm)
    background_z = np.float32(z_mm[covered].min()) if covered.any() else np.float32(0.0)
    z = np.where(covered, z_mm, background_z)
    occlusion = np.zeros(z.shape, dtype=np.float32)
    weight = covered.astype(np.float32)
    height = z - background_z
    for size in CORNER_MM:
        kernel = (2 * max(1, round(size * px_per_mm / 2.0)) + 1,) * 2
        coverage = np.maximum(cv2.blur(weight, kernel), 1e-3)
        surroundings = cv2.blur(height, kernel) / coverage + background_z
        # In a corner the surroundings are slightly nearer; much nearer surfaces are separate objects in front.
        nearer = np.maximum(surroundings - z, 0.0) / size
        occlusion += nearer / (1.0 + nearer**2)
    return np.asarray(1.0 - CORNER_DARKNESS * occlusion * covered, dtype=np.float32)


def _draw_line(
    image: NDArray[np.float32],
    z_mm: NDArray[np.float32],
    screen: Screen,
    points_in_rig: FloatArray,
    rgb: Rgb,
    width_px: int,
) -> None:
    brush = np.arange(width_px) - width_px // 2
    dx, dy = (offset.ravel() for offset in np.meshgrid(brush, brush))
    width, height = screen.size_px
    for start, end in pairwise(points_in_rig):
        count = int(np.linalg.norm((screen.pixels(end) - screen.pixels(start))[:2])) + 2
        points = screen.pixels(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
        columns = np.round(points[:, :1]).astype(int) + dx
        rows = np.round(points[:, 1:2]).astype(int) + dy
        z = np.broadcast_to(points[:, 2:], rows.shape)
        on_screen = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        columns, rows, z = columns[on_screen], rows[on_screen], z[on_screen]
        visible = z > z_mm[rows, columns] - LINE_BIAS_MM
        image[rows[visible], columns[visible]] = rgb


# Faces that meet at a smaller angle belong to one curved surface.
SMOOTH_DEG = 25.0
# Tolerance of the z of a visible edge, since its surfaces are oblique within a pixel.
Z_TOLERANCE_MM = 0.6
# Minimum length of a drawn piece of an edge: rounding makes dots of hidden edges visible.
MIN_PIECE_PX = 2.5
NO_SURFACE = -1e9
# Decimals of positions on a sheet, mm.
DECIMALS = 2


def edges_of(mesh: trimesh.Trimesh, towards: FloatArray) -> FloatArray:
    """Ends (n, 2, 3) of the sharp edges of a closed mesh, and of its outline for a viewer in direction (3,)."""
    sharp = mesh.face_adjacency_angles > np.deg2rad(SMOOTH_DEG)
    front_facing = mesh.face_normals @ towards > 0.0
    pairs = front_facing[mesh.face_adjacency]
    selected = (sharp & pairs.any(axis=1)) | (pairs[:, 0] != pairs[:, 1])
    return np.asarray(mesh.vertices[mesh.face_adjacency_edges[selected]], dtype=np.float64)


def visible_lines(edges: FloatArray, rendering: Rendering) -> list[FloatArray]:
    """The visible pieces (2, 2) in px of edges (n, 2, 3) in the rig frame, mm, in a rendered picture."""
    ends = rendering.screen.pixels(edges)
    spans = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(spans[:, :2], axis=1)
    steps = np.ceil(lengths).astype(int) + 1
    owner = np.repeat(np.arange(len(edges)), steps + 1)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(steps + 1) - (steps + 1), steps + 1)
    points = ends[owner, 0] + (step / steps[owner])[:, None] * spans[owner]
    visible = _visible(points, rendering)
    first, last = visible.copy(), visible.copy()
    first[1:] &= ~(visible[:-1] & (owner[1:] == owner[:-1]))
    last[:-1] &= ~(visible[1:] & (owner[1:] == owner[:-1]))
    pieces = np.stack([points[first, :2], points[last, :2]], axis=1)
    long_enough = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1) >= np.minimum(
        MIN_PIECE_PX, 0.9 * lengths[owner[first]]
    )
    return list(pieces[long_enough])


def _visible(points: FloatArray, rendering: Rendering) -> NDArray[np.bool_]:
    """Mask (n,) of points (n, 3), px and z, that are not behind the farthest surface of the adjacent pixels."""
    farthest = cv2.erode(np.maximum(rendering.z_mm, NO_SURFACE), np.ones((3, 3), dtype=np.uint8))
    height, width = farthest.shape
    columns, rows = np.floor(points[:, :2]).astype(int).T
    return np.asarray(
        points[:, 2] >= farthest[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)] - Z_TOLERANCE_MM
    )


def merged_lines(lines: Sequence[FloatArray]) -> list[FloatArray]:
    """Lines (n, 2) of a sheet, mm, rounded and merged at their ends, so that a curve is one line."""
    rounded = [np.round(line, DECIMALS) for line in lines]
    merged = shapely.line_merge(shapely.MultiLineString([line for line in rounded if (line[0] != line[-1]).any()]))
    return [shapely.get_coordinates(line) for line in shapely.get_parts(merged)]
