"""A small z-buffer: shaded triangles with dark edges, as seen from far away. Plain numpy, the same on every machine."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from optics.values import FloatArray

Rgb = tuple[float, float, float]
# Neighbouring pixels show an edge where the surface turns by more than this (cosine) or jumps by so many pixels.
EDGE_COSINE = 0.985
EDGE_JUMP_PX = 10.0
# A line that runs in a surface is drawn; rounding must not hide it.
LINE_BEFORE_SURFACE_MM = 0.3


@dataclass(frozen=True)
class Surface:
    """Triangles (n, 3, 3) in rig, mm, counter-clockwise from outside, of one colour (0 to 1)."""

    triangles: FloatArray
    rgb: Rgb


@dataclass(frozen=True)
class Screen:
    """An orthographic view: `axes` (3, 3) rows right, up, towards the viewer; its centre (2,) mm and px per mm."""

    axes: FloatArray
    centre: FloatArray
    px_per_mm: float
    width_px: int
    height_px: int

    def pixels(self, points_in_rig: FloatArray) -> FloatArray:
        """Column, row (px) and nearness (mm, larger is nearer) (..., 3) of points (..., 3)."""
        seen = points_in_rig @ self.axes.T
        scale = np.array([self.px_per_mm, -self.px_per_mm])
        flat = (seen[..., :2] - self.centre) * scale + (self.width_px / 2.0, self.height_px / 2.0)
        return np.concatenate([flat, seen[..., 2:]], axis=-1)


class Canvas:
    """An image (h, w, 3) being drawn, white at first, with the nearness (h, w) of what each pixel shows."""

    def __init__(self, screen: Screen) -> None:
        self.screen = screen
        shape = (screen.height_px, screen.width_px)
        self.image: NDArray[np.float64] = np.ones((*shape, 3))
        self.nearness: NDArray[np.float64] = np.full(shape, -np.inf)
        self._normals: NDArray[np.float64] = np.zeros((*shape, 3))
        light = screen.axes.T @ np.array([-0.45, 0.35, 0.8])
        self._light = light / np.linalg.norm(light)

    def fill(self, surface: Surface) -> None:
        """Draw the triangles that face the viewer, lit from the viewer's upper left."""
        for triangle, corners in zip(surface.triangles, self.screen.pixels(surface.triangles), strict=True):
            normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
            (ax, ay), (bx, by) = corners[1, :2] - corners[0, :2], corners[2, :2] - corners[0, :2]
            area = ax * by - ay * bx
            if abs(area) < 1e-9 or normal @ self.screen.axes[2] <= 0.0:
                continue
            normal = normal / np.linalg.norm(normal)
            size = (self.screen.width_px, self.screen.height_px)
            left, top = np.clip(np.floor(corners[:, :2].min(axis=0)).astype(int), 0, size)
            right, bottom = np.clip(np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1, 0, size)
            window = np.s_[top:bottom, left:right]
            dx = np.arange(left, right)[None, :] - corners[0, 0]
            dy = np.arange(top, bottom)[:, None] - corners[0, 1]
            along_a, along_b = (dx * by - dy * bx) / area, (dy * ax - dx * ay) / area
            rise_a, rise_b = corners[1:, 2] - corners[0, 2]
            depth = corners[0, 2] + along_a * rise_a + along_b * rise_b
            # A hair outside the triangle too, so that no crack shows between neighbours.
            inside = (along_a >= -1e-6) & (along_b >= -1e-6) & (along_a + along_b <= 1.0 + 1e-6)
            drawn = inside & (depth > self.nearness[window])
            self.nearness[window][drawn] = depth[drawn]
            self._normals[window][drawn] = normal
            self.image[window][drawn] = np.array(surface.rgb) * (0.55 + 0.45 * max(float(normal @ self._light), 0.0))

    def outline(self, darkness: float = 0.8) -> None:
        """Darken pixels where the surface turns or jumps."""
        edge = np.zeros(self.nearness.shape, dtype=bool)
        level = np.where(np.isfinite(self.nearness), self.nearness, -1e9)
        for here, there in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
            shown = np.isfinite(self.nearness[here]) | np.isfinite(self.nearness[there])
            turned = (self._normals[here] * self._normals[there]).sum(axis=-1) < EDGE_COSINE
            jumped = np.abs(level[here] - level[there]) > EDGE_JUMP_PX / self.screen.px_per_mm
            edge[here] |= shown & (turned | jumped)
        thick = edge.copy()
        thick[1:] |= edge[:-1]
        thick[:, 1:] |= edge[:, :-1]
        self.image[thick] *= 1.0 - darkness

    def line(self, path_in_rig: FloatArray, rgb: Rgb, width_px: int) -> None:
        """Draw a polyline (n, 3) where nothing is nearer."""
        brush = np.arange(width_px) - width_px // 2
        dx, dy = (offset.ravel() for offset in np.meshgrid(brush, brush))
        for start, end in pairwise(path_in_rig):
            count = int(np.linalg.norm((self.screen.pixels(end) - self.screen.pixels(start))[:2])) + 2
            points = self.screen.pixels(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
            columns = np.round(points[:, :1]).astype(int) + dx
            rows = np.round(points[:, 1:2]).astype(int) + dy
            depth = np.broadcast_to(points[:, 2:], rows.shape)
            on = (columns >= 0) & (columns < self.screen.width_px) & (rows >= 0) & (rows < self.screen.height_px)
            columns, rows, depth = columns[on], rows[on], depth[on]
            seen = depth > self.nearness[rows, columns] - LINE_BEFORE_SURFACE_MM
            self.image[rows[seen], columns[seen]] = rgb

    def shrunk(self, factor: int) -> NDArray[np.uint8]:
        """The image (h / factor, w / factor, 3), every pixel the mean of a square."""
        height, width = self.screen.height_px // factor, self.screen.width_px // factor
        blocks = self.image[: height * factor, : width * factor].reshape(height, factor, width, factor, 3)
        return np.asarray(np.round(blocks.mean(axis=(1, 3)) * 255.0), dtype=np.uint8)
