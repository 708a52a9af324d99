"""Separation of mirrors, their light and the camera's body, as smooth CasADi terms with unknown separating planes.

Coordinates are in view axes, lengths in units of the design scale. Two convex solids are at least g apart exactly if
some plane has one solid below it and the other at least g above it. This is exact for the solids of mirrors and the
light they reflect, needs no guess of facing edges, and allows a neighbour to stand behind a mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import Literal, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.constraints import MARGIN
from mirrorcam.optics.design.program.draft import Draft, displacements, safe_gap
from mirrorcam.optics.design.program.mirror_variables import Kind, MirrorVariables, Optics, add_mirror
from mirrorcam.optics.design.program.seeds import Seed, tile_positions
from mirrorcam.optics.design.program.terms import Expression, Term, TermBuilder
from mirrorcam.optics.geometry.arrangement import Arrangement

BEAM_OFFSET = 0.1
"""Maximum offset, in units of the thickness, between the beams of a second-surface mirror and its apparent mirror."""
BOX_CORNERS = 8
TILE_TOLERANCE = 1e-6
"""Tolerance for the positions of tiles."""
PairKind = Literal["seen", "gap", "in", "out"]


@dataclass(frozen=True)
class SeparatingPlane:
    """An unknown plane of a term, normal (3) . x = offset, that separates solids below and above it."""

    term: TermBuilder
    normal: Expression
    offset: Expression

    @classmethod
    def unknown(cls, term: TermBuilder) -> Self:
        """Add a plane whose normal has nearly unit length, so that a slack is nearly a length."""
        n, d = term.unknown(3), term.unknown(1)
        term.require(1.0 - ca.dot(n, n))
        term.require(ca.dot(n, n) - 0.81)
        return cls(term, n, d)

    def require_below(self, points: list[Expression]) -> None:
        for point in points:
            self.term.require(self.offset - ca.dot(self.normal, point))

    def require_beam_below(self, light: MirrorVariables) -> None:
        """Require that the beam from a mirror's virtual centre through its face, to infinity, lies below."""
        for point in light.face:
            self.require_below([point])
            self.term.require(-ca.dot(self.normal, point - light.centre))

    def require_above(self, points: list[Expression], family: str, gap: Expression | float = 0.0) -> None:
        for point in points:
            self.term.require(ca.dot(self.normal, point) - self.offset - gap - MARGIN, family)


@lru_cache
def sub_image_gap_term(sides: int) -> Term:
    """Two sub-images lie on opposite sides of a line, a gap apart.

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
    """The solids of two mirrors lie on opposite sides of a plane, a gap apart.

    Unknowns: fold angle, both mirrors, plane (4). Parameters: optics, gap.
    """
    term = TermBuilder()
    optics, gap = Optics.of_term(term), term.parameter()
    first, second = add_mirror(kind, optics, term), add_mirror(kind, optics, term)
    plane = SeparatingPlane.unknown(term)
    plane.require_below(first.solid)
    plane.require_above(second.solid, "spacing", gap)
    return term.built()


@lru_cache
def incoming_term(kind: Kind) -> Term:
    """The second mirror does not reach into the light from the pupil to the first's face: the convex hull of both.

    Unknowns: fold angle, both mirrors, plane (4). Parameters: optics.
    """
    term = TermBuilder()
    optics = Optics.of_term(term)
    light, other = add_mirror(kind, optics, term), add_mirror(kind, optics, term)
    plane = SeparatingPlane.unknown(term)
    extent = ca.SX(0.0) if kind.pinhole else optics.radius * optics.in_pupil_plane(plane.normal)
    term.require(plane.offset - extent)
    plane.require_below(light.face)
    plane.require_above(other.solid, "occlusion")
    return term.built()


@lru_cache
def outgoing_term(kind: Kind) -> Term:
    """The second mirror does not reach into the beam from the first's virtual centre through its face, to infinity.

    That beam contains the light of the full pupil if the focus is beyond twice the distance of the mirrors.

    Unknowns: fold angle, both mirrors, plane (4). Parameters: optics.
    """
    term = TermBuilder()
    optics = Optics.of_term(term)
    light, other = add_mirror(kind, optics, term), add_mirror(kind, optics, term)
    plane = SeparatingPlane.unknown(term)
    plane.require_beam_below(light)
    plane.require_above(other.solid, "occlusion", BEAM_OFFSET * optics.thickness if kind.second_surface else 0.0)
    return term.built()


def _box(term: TermBuilder, optics: Optics) -> list[Expression]:
    """Corners (3) in view axes of a box, whose corners in the rig frame are parameters of the term."""
    corners = term.parameter(3 * BOX_CORNERS)
    return [optics.view_from_rig @ corners[3 * k : 3 * k + 3] for k in range(BOX_CORNERS)]


@lru_cache
def body_gap_term(kind: Kind) -> Term:
    """The solid of a mirror and a box lie on opposite sides of a plane.

    Unknowns: fold angle, mirror, plane (4). Parameters: optics, corners of the box in the rig frame (24).
    """
    term = TermBuilder()
    optics = Optics.of_term(term)
    mirror, plane = add_mirror(kind, optics, term), SeparatingPlane.unknown(term)
    plane.require_below(mirror.solid)
    plane.require_above(_box(term, optics), "body")
    return term.built()


@lru_cache
def body_light_term(kind: Kind) -> Term:
    """A box does not reach into the beam from a mirror's virtual centre through its face, to infinity.

    Unknowns: fold angle, mirror, plane (4). Parameters: optics, corners of the box in the rig frame (24).
    """
    term = TermBuilder()
    optics = Optics.of_term(term)
    light, plane = add_mirror(kind, optics, term), SeparatingPlane.unknown(term)
    plane.require_beam_below(light)
    plane.require_above(_box(term, optics), "body")
    return term.built()


@dataclass(frozen=True, order=True)
class PairConstraint:
    """A constraint on two mirrors.

    "seen" is a gap in the image, "gap" a gap in space. "in" and "out" keep the second mirror out of the light to and
    from the first.
    """

    kind: PairKind
    first: int
    second: int


def neighbour_pairs(arrangement: Arrangement) -> tuple[PairConstraint, ...]:
    """Initial constraints of every design, on neighbours; others are added when a solution violates them.

    Neighbours have touching tiles in the seed. They get gaps and unblocked light in both directions; diagonal
    neighbours need no constraint on outgoing beams.
    """
    tiles, pairs = tile_positions(arrangement), []
    for i, j in combinations(range(len(tiles)), 2):
        dx, dy = np.abs(tiles[j] - tiles[i]) + TILE_TOLERANCE
        if max(dx, dy) > 1.0 + 2.0 * TILE_TOLERANCE:
            continue
        diagonal = min(dx, dy) >= 1.0
        pairs += [PairConstraint("seen", i, j), PairConstraint("gap", i, j)]
        legs: tuple[PairKind, ...] = ("in",) if diagonal else ("in", "out")
        pairs += [PairConstraint(leg, *ordered) for leg in legs for ordered in ((i, j), (j, i))]
    return tuple(pairs)


def add_body(draft: Draft) -> None:
    """Add constraints that keep mirrors and their light out of the boxes around the camera's body and lens."""
    spec = draft.spec
    points = draft.seed.chief_points(spec.view_from_rig)
    for box_mm, (mirror, point) in product(spec.keep_outs_in_rig_mm, zip(draft.mirrors, points, strict=True)):
        box = (box_mm / spec.scale_mm).ravel()
        lateral = -_unit(point * [1.0, 1.0, 0.0])
        for term, normal in (
            (body_gap_term(draft.kind), -_unit(point)),
            (body_light_term(draft.kind), lateral),
        ):
            plane = draft.program.unknown([*normal, normal @ point / 2.0], *_plane_range(3))
            draft.add(term, [*mirror, plane], [box])


def add_pairs(draft: Draft, pairs: tuple[PairConstraint, ...]) -> None:
    """Add constraints on pairs of mirrors, each with an unknown plane."""
    spec, kind = draft.spec, draft.kind
    terms = {
        "gap": gap_term(kind),
        "in": incoming_term(kind),
        "out": outgoing_term(kind),
    }
    gap, seen_gap = spec.spacing_mm / spec.scale_mm, spec.seen_gap_mm / spec.scale_mm
    shifts, points = displacements(spec, draft.seed), draft.seed.chief_points(spec.view_from_rig)
    for pair in pairs:
        plane = _first_plane(pair, draft.seed, points)
        unknown = draft.program.unknown(plane, *_plane_range(plane.size - 1))
        first, second = draft.mirrors[pair.first], draft.mirrors[pair.second]
        if pair.kind == "seen":
            safe = safe_gap(shifts[[pair.first, pair.second]], plane[:2])
            draft.program.add(sub_image_gap_term(kind.sides), [first[1], second[1], unknown], [max(seen_gap, safe)])
        else:
            parameters: list[ArrayLike] = [gap] if pair.kind == "gap" else []
            draft.add(terms[pair.kind], [*first, *second, unknown], parameters)


def _plane_range(size: int) -> tuple[FloatArray, FloatArray]:
    """Minimum and maximum of the normal (size) of a plane or line, and of its offset."""
    limit = np.array([*np.ones(size), np.inf])
    return -limit, limit


def _first_plane(pair: PairConstraint, seed: Seed, points: FloatArray) -> FloatArray:
    """Start value of a pair's plane (normal, offset) or line (3); chief rays meet their mirrors at `points` (n, 3)."""
    if pair.kind == "seen":
        p, q = seed.chief_rays[pair.first], seed.chief_rays[pair.second]
        direction = _unit(q - p)
        return np.array([*direction, -direction @ (p + q) / 2.0])
    a, b, centre = points[pair.first], points[pair.second], seed.centres[pair.first]
    if pair.kind == "gap":
        normal = _unit(b - a)
        return np.array([*normal, normal @ (a + b) / 2.0])
    normal = _unit(_unit(b) - _unit(a))
    if pair.kind == "in":
        return np.array([*normal, 0.0])
    reflected = normal - 2.0 * (normal @ centre) / (centre @ centre) * centre
    return np.array([*reflected, reflected @ centre])


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
