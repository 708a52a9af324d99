"""What a layout must satisfy, as smooth terms in CasADi; in view axes, all lengths in units of the design's scale.

Convex bodies keep apart by an unknown plane between them: they are at least g apart exactly when some plane has one
body below it and the other at least g above it. This is exact for mirror sheets and for the light that they pass on,
needs no guess of which edge faces which, and lets a neighbour stand behind a mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import prod

import casadi as ca
import numpy as np

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.design.program.terms import Expression, Term, TermBuilder

MARGIN = 1e-6
"""Kept beyond every limit (in scales), so that the rounded layout still satisfies it."""

LEAST_TURN = 1e-3
"""Smallest turn at a corner of a sub-image, as the area its two edges span, relative to a tile of the sensor."""

LEAST_INCIDENCE = 0.1

STRAY = 0.1
"""How far, in thicknesses, a beam from a mirror coated behind may stray from that of the apparent mirror."""

LEAST_GRID_SPACING = 0.05

REGION_CORNERS = 8
"""Corners of the region at a depth that all views must show."""


@dataclass(frozen=True)
class Kind:
    """What decides about the expressions of a mirror."""

    sides: int
    distorted: bool
    second_surface: bool


@dataclass(frozen=True)
class Mirror:
    """One mirror in expressions: virtual centre (3), corners in normalized coordinates (2), corners of its face (3).

    All of the *apparent* mirror where it is coated behind (see `optics.mirror`). `before` and `behind` say how far the
    sheet reaches along `normal` (away from the pupil) from the face; light meets the front `entry` (3) aside.
    """

    centre: Expression
    corners: list[Expression]
    face: list[Expression]
    normal: Expression
    before: Expression
    behind: Expression
    entry: Expression

    @property
    def sheet(self) -> list[Expression]:
        """All corners (3) of the sheet."""
        return [point + self.normal * by for by in (-self.before, self.behind) for point in self.face]


def turn(a: Expression, b: Expression) -> Expression:
    """The 2-D cross product."""
    return a[0] * b[1] - a[1] * b[0]


def reflected(point: Expression, centre: Expression) -> Expression:
    """A point (3) reflected at the plane of a virtual centre (3)."""
    return point - 2.0 * (ca.dot(point, centre) / ca.sumsqr(centre) - 0.5) * centre


def edges_of(vertices: list[Expression]) -> list[tuple[Expression, Expression]]:
    """Both ends of each edge of a polygon."""
    return list(pairwise([*vertices, vertices[0]]))


def polygon_area(vertices: list[Expression]) -> Expression:
    """Signed area of a polygon (shoelace), positive when it runs from +x to +y."""
    return 0.5 * sum(turn(a, b) for a, b in edges_of(vertices))


def subdivided(vertices: list[Expression], per_edge: int) -> list[Expression]:
    """The outline of a polygon with `per_edge` points on each edge, the vertex among them."""
    return [a + (b - a) * (step / per_edge) for a, b in edges_of(vertices) for step in range(per_edge)]


def pixels(intrinsics: Expression, normalized: Expression) -> Expression:
    """Brown-Conrady distortion and intrinsics (9), as `Camera.pixels_from_normalized`."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = (intrinsics[k] for k in range(9))
    x, y = normalized[0], normalized[1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return ca.vertcat(fx * xd + cx, fy * yd + cy)


def view_from_rig(fold: Expression) -> Expression:
    """The rotation (3, 3) of a fold, given as its cosine and sine."""
    return ca.blockcat([[1.0, 0.0, 0.0], [0.0, fold[0], -fold[1]], [0.0, fold[1], fold[0]]])


def mirror_of(kind: Kind, optics: Expression, centre: Expression, corners: Expression) -> Mirror:
    """The mirror of a virtual centre (3) and corners (2 sides); `optics` (4): cosine, sine, thickness, index.

    Coated behind, the apparent plane lies t (1 - tan' / tan) before the coating and light meets the front t tan' aside
    of there, both by Snell at the chief ray (see `optics.slab`).
    """
    turned, thickness, index = view_from_rig(optics[:2]), optics[2], optics[3]
    polygon = [corners[2 * k : 2 * k + 2] for k in range(kind.sides)]
    rays = [turned @ ca.vertcat(corner, 1.0) for corner in polygon]
    squared = ca.sumsqr(centre)
    face = [ray * (0.5 * squared / ca.dot(ray, centre)) for ray in rays]
    normal = centre / ca.sqrt(squared)
    before, behind, entry = ca.SX(0.0), thickness, ca.SX.zeros(3)
    if kind.second_surface:
        chief: Expression = sum(face[1:], start=face[0])
        chief /= ca.sqrt(ca.sumsqr(chief))
        cosine = ca.dot(chief, normal)
        # n cos'; then tan' / tan = cos / (n cos') and tan' = sin / (n cos'), also head-on.
        inner = ca.sqrt(index**2 - 1.0 + cosine**2)
        behind = thickness * (1.0 - cosine / inner)
        before, entry = thickness - behind, thickness / inner * (chief - cosine * normal)
    return Mirror(centre, polygon, face, normal, before, behind, entry)


def _given(kind: Kind, term: TermBuilder, optics: Expression) -> Mirror:
    centre = term.unknown(3)
    return mirror_of(kind, optics, centre, term.unknown(2 * kind.sides))


@lru_cache
def mirror_term(kind: Kind) -> Term:
    """A mirror that can be cut, seen and folded into place.

    Unknowns: virtual centre, corners. Parameters: optics (4), intrinsics (9), sensor px (2), shortest edge, smallest
    area, nearest depth, area of a tile, what each tile's worth of sub-image takes off the objective.
    """
    term = TermBuilder()
    optics, intrinsics, size_px = term.parameter(4), term.parameter(9), term.parameter(2)
    min_edge, min_area, depth, tile_area, reward = (term.parameter() for _ in range(5))
    mirror = _given(kind, term, optics)
    turned = view_from_rig(optics[:2])
    for corner in mirror.corners:
        term.require(ca.dot(turned @ ca.vertcat(corner, 1.0), mirror.centre) - LEAST_INCIDENCE)
    for before, after in edges_of([b - a for a, b in edges_of(mirror.corners)]):
        term.require(turn(before, after) / tile_area - LEAST_TURN)
    for a, b in edges_of(mirror.face):
        term.require(ca.sumsqr(b - a) - min_edge**2 - MARGIN, "size")
    fans = [ca.cross(a - mirror.face[0], b - mirror.face[0]) for a, b in pairwise(mirror.face[1:])]
    term.require(0.5 * sum(ca.dot(fan, mirror.normal) for fan in fans) - min_area - MARGIN, "size")
    for point in mirror.sheet:
        term.require(depth - point[2] - MARGIN, "depth")
    if kind.second_surface:
        # The pupil must lie before the sheet.
        term.require(ca.sqrt(ca.sumsqr(mirror.centre)) / 2.0 - mirror.before - MARGIN, "occlusion")
    if kind.distorted:
        # Edges bend: points along them stay on the sensor. Without distortion, the corners' bounds are enough.
        margin_px = 0.25
        for point in subdivided(mirror.corners, 8):
            pixel = pixels(intrinsics, point)
            term.require((ca.vertcat(pixel + 0.5, size_px - 0.5 - pixel) - margin_px) / size_px[0])
    term.minimise(-reward * polygon_area(mirror.corners) / tile_area)
    return term.built()


def region_directions() -> FloatArray:
    """Directions (8, 2) of the corners of a region from its middle, in view axes, as x and y of a unit circle.

    They run so that a mirror shows them from +x to +y.
    """
    around = 2.0 * np.pi * (np.arange(REGION_CORNERS) + 0.5) / REGION_CORNERS
    return np.column_stack([np.cos(around), -np.sin(around)])


@lru_cache
def region_term() -> Term:
    """A star-shaped region that winds once: each corner keeps to its own sector about an unknown middle.

    Unknowns: middle (2), corners (2 each). Parameters: half the size (2) it starts with.
    """
    term = TermBuilder()
    middle, corners, half_size = term.unknown(2), term.unknown(2 * REGION_CORNERS), term.parameter(2)
    directions = region_directions()
    borders = directions + np.roll(directions, -1, axis=0)
    for k in range(REGION_CORNERS):
        spoke = (corners[2 * k : 2 * k + 2] - middle) / half_size
        term.require(-turn(ca.DM(borders[k - 1]), spoke))
        term.require(turn(ca.DM(borders[k]), spoke))
    return term.built()


@lru_cache
def view_term(kind: Kind) -> Term:
    """A mirror shows a region whole; the pixels it spends on it count.

    Unknowns: virtual centre, corners, the region's corners: tangents from where it is aimed, which keeps them of one
    size at any depth. Parameters: optics (4), intrinsics (9), sensor px (2), depth, aim (2), area of a tile, weight of
    the sensor's share, least share.
    """
    term = TermBuilder()
    optics, intrinsics, size_px = term.parameter(4), term.parameter(9), term.parameter(2)
    depth, aim, tile_area, weight, least = (term.parameter(size) for size in (1, 2, 1, 1, 1))
    mirror = _given(kind, term, optics)
    corners = term.unknown(2 * REGION_CORNERS)
    rig_from_view = view_from_rig(optics[:2]).T
    seen = []
    for k in range(REGION_CORNERS):
        point = ca.vertcat(aim + corners[2 * k : 2 * k + 2] * (1.0 + depth), depth)
        image = rig_from_view @ reflected(point, mirror.centre)
        seen.append(image[:2] / image[2])
    for a, b in _usable_edges(mirror, rig_from_view) if kind.second_surface else edges_of(mirror.corners):
        for point in seen:
            term.require(turn(b - a, point - a) / tile_area, "overlap")
    if kind.distorted:
        area_px = polygon_area([pixels(intrinsics, point) for point in subdivided(seen, 3)])
    else:
        area_px = polygon_area(seen) * intrinsics[0] * intrinsics[1]
    share = area_px / (size_px[0] * size_px[1])
    term.require(share - least)
    term.minimise(-weight * share)
    return term.built()


def _usable_edges(mirror: Mirror, rig_from_view: Expression) -> list[tuple[Expression, Expression]]:
    """Edges moved inwards by as much as light meets the front aside: it has to enter and to leave through the front."""
    moved = []
    for a, b in edges_of(mirror.face):
        inwards = ca.cross(mirror.normal, b - a) / ca.sqrt(ca.sumsqr(b - a))
        by = ca.sqrt(ca.dot(inwards, mirror.entry) ** 2 + 1e-10) * inwards
        ends = [rig_from_view @ (point + by) for point in (a, b)]
        moved.append((ends[0][:2] / ends[0][2], ends[1][:2] / ends[1][2]))
    return moved


def squared_grid_error(centres: list[Expression], rows: int, cols: int) -> tuple[Expression, list[Expression]]:
    """Squared grid error of virtual centres (row by row, view axes) to their best grid, and that grid's spacings.

    Linear regression on the indices is the best fit; the error is relative to the geometric mean of the spacings.
    """
    rightwards = np.tile(np.arange(cols) - (cols - 1) / 2.0, rows)
    downwards = np.repeat(np.arange(rows) - (rows - 1) / 2.0, cols)
    mean: Expression = sum(centres, start=ca.SX.zeros(3)) / len(centres)
    residual = ca.horzcat(*(centre - mean for centre in centres)).T
    spacings = []
    for axis, steps in ((0, rightwards), (1, downwards)):
        if steps.any():
            spacing = ca.dot(residual[:, axis], ca.DM(steps)) / float(steps @ steps)
            residual[:, axis] -= spacing * ca.DM(steps)
            spacings.append(spacing)
    return ca.sumsqr(residual) / len(centres) / prod(spacings) ** (2.0 / len(spacings)), spacings


@lru_cache
def grid_term(rows: int, cols: int) -> Term:
    """Virtual centres (row by row) near a grid whose spacings are positive. Parameter: weight of its squared error."""
    term = TermBuilder()
    centres, weight = [term.unknown(3) for _ in range(rows * cols)], term.parameter()
    error, spacings = squared_grid_error(centres, rows, cols)
    for spacing in spacings:
        term.require(spacing - LEAST_GRID_SPACING)
    term.minimise(weight * error)
    return term.built()


@lru_cache
def mean_term(count: int) -> Term:
    """The mean of `count` virtual centres is the parameter (3)."""
    term = TermBuilder()
    centres = [term.unknown(3) for _ in range(count)]
    term.require(sum(centres[1:], start=centres[0]) / count - term.parameter(3))
    return term.built(equality=True)


def _plane(term: TermBuilder) -> tuple[Expression, Expression]:
    """An unknown plane n.x = d with a normal of almost unit length, so that what a slack measures is about a length."""
    n, d = term.unknown(3), term.unknown(1)
    term.require(1.0 - ca.dot(n, n))
    term.require(ca.dot(n, n) - 0.81)
    return n, d


@lru_cache
def seen_gap_term(sides: int) -> Term:
    """Two sub-images on both sides of a line and `gap` apart.

    Unknowns: corners of both, line (3). Parameters: gap in normalized coordinates.
    """
    term = TermBuilder()
    first, second = term.unknown(2 * sides), term.unknown(2 * sides)
    line, gap = term.unknown(3), term.parameter()
    term.require(1.0 - ca.sumsqr(line[:2]))
    term.require(ca.sumsqr(line[:2]) - 0.81)
    for k in range(sides):
        term.require(-ca.dot(line, ca.vertcat(first[2 * k : 2 * k + 2], 1.0)))
        term.require(ca.dot(line, ca.vertcat(second[2 * k : 2 * k + 2], 1.0)) - gap - MARGIN, "seen gap")
    return term.built()


@lru_cache
def gap_term(kind: Kind) -> Term:
    """The sheets of two mirrors on both sides of a plane and `gap` apart.

    Unknowns: both mirrors, plane (4). Parameters: optics (4), gap.
    """
    term = TermBuilder()
    optics, gap = term.parameter(4), term.parameter()
    first, second = _given(kind, term, optics), _given(kind, term, optics)
    n, d = _plane(term)
    for point in first.sheet:
        term.require(d - ca.dot(n, point))
    for point in second.sheet:
        term.require(ca.dot(n, point) - d - gap - MARGIN, "spacing")
    return term.built()


@lru_cache
def incoming_term(kind: Kind) -> Term:
    """No part of the second mirror reaches into the pyramid from the pupil to the face of the first.

    Unknowns: both mirrors, plane (4). Parameters: optics (4).
    """
    term = TermBuilder()
    optics = term.parameter(4)
    light, other = _given(kind, term, optics), _given(kind, term, optics)
    n, d = _plane(term)
    term.require(d)
    for point in light.face:
        term.require(d - ca.dot(n, point))
    for point in other.sheet:
        term.require(ca.dot(n, point) - d - MARGIN, "occlusion")
    return term.built()


@lru_cache
def outgoing_term(kind: Kind) -> Term:
    """No part of the second mirror reaches into the beam from the first's virtual centre through its face, to infinity.

    Unknowns: both mirrors, plane (4). Parameters: optics (4).
    """
    term = TermBuilder()
    optics = term.parameter(4)
    light, other = _given(kind, term, optics), _given(kind, term, optics)
    n, d = _plane(term)
    for point in light.face:
        term.require(d - ca.dot(n, point))
        term.require(-ca.dot(n, point - light.centre))
    stray = STRAY * optics[2] if kind.second_surface else 0.0
    for point in other.sheet:
        term.require(ca.dot(n, point) - d - stray - MARGIN, "occlusion")
    return term.built()
