"""What keeps mirrors, their light and the camera's body apart, as smooth terms in CasADi.

In view axes, all lengths in units of the design's scale. Convex solids are kept apart by an unknown plane between them:
they are at least g apart exactly when some plane has one solid below it and the other at least g above it. This is
exact for the solids of mirrors and for the light that they reflect, needs no guess of which edge faces which, and lets
a neighbour stand behind a mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import casadi as ca

from mirrorcam.optics.design.program.constraints import MARGIN
from mirrorcam.optics.design.program.mirror_variables import Kind, MirrorVariables, Optics, given_mirror
from mirrorcam.optics.design.program.terms import Expression, Term, TermBuilder

BEAM_OFFSET = 0.1
"""Largest offset, in thicknesses, of a beam from a second-surface mirror from that of the apparent mirror."""

BOX_CORNERS = 8


@dataclass(frozen=True)
class SeparatingPlane:
    """An unknown plane of a term, normal (3) . x = offset, that keeps what lies below it from what lies above."""

    term: TermBuilder
    normal: Expression
    offset: Expression

    @classmethod
    def unknown(cls, term: TermBuilder) -> Self:
        """Its normal has nearly unit length, so that a slack is nearly a length."""
        n, d = term.unknown(3), term.unknown(1)
        term.require(1.0 - ca.dot(n, n))
        term.require(ca.dot(n, n) - 0.81)
        return cls(term, n, d)

    def require_below(self, points: list[Expression]) -> None:
        for point in points:
            self.term.require(self.offset - ca.dot(self.normal, point))

    def require_beam_below(self, light: MirrorVariables) -> None:
        """The beam from a mirror's virtual centre through its face, to infinity."""
        for point in light.face:
            self.require_below([point])
            self.term.require(-ca.dot(self.normal, point - light.centre))

    def require_above(self, points: list[Expression], family: str, gap: Expression | float = 0.0) -> None:
        for point in points:
            self.term.require(ca.dot(self.normal, point) - self.offset - gap - MARGIN, family)


@lru_cache
def seen_gap_term(sides: int) -> Term:
    """Two sub-images lie on opposite sides of a line, `gap` apart.

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
    """The solids of two mirrors lie on opposite sides of a plane, `gap` apart.

    Unknowns: fold, both mirrors, plane (4). Parameters: optics, gap.
    """
    term = TermBuilder()
    optics, gap = Optics.given(term), term.parameter()
    first, second = given_mirror(kind, optics, term), given_mirror(kind, optics, term)
    plane = SeparatingPlane.unknown(term)
    plane.require_below(first.solid)
    plane.require_above(second.solid, "spacing", gap)
    return term.built()


@lru_cache
def incoming_term(kind: Kind) -> Term:
    """No part of the second mirror reaches into the light from the pupil to the face of the first: their convex hull.

    Unknowns: fold, both mirrors, plane (4). Parameters: optics.
    """
    term = TermBuilder()
    optics = Optics.given(term)
    light, other = given_mirror(kind, optics, term), given_mirror(kind, optics, term)
    plane = SeparatingPlane.unknown(term)
    reach = ca.SX(0.0) if kind.pinhole else optics.radius * optics.along_pupil(plane.normal)
    term.require(plane.offset - reach)
    plane.require_below(light.face)
    plane.require_above(other.solid, "occlusion")
    return term.built()


@lru_cache
def outgoing_term(kind: Kind) -> Term:
    """No part of the second mirror reaches into the beam from the first's virtual centre through its face, to infinity.

    The light of whole pupils, in focus beyond twice the distance of the mirrors, lies inside that beam.

    Unknowns: fold, both mirrors, plane (4). Parameters: optics.
    """
    term = TermBuilder()
    optics = Optics.given(term)
    light, other = given_mirror(kind, optics, term), given_mirror(kind, optics, term)
    plane = SeparatingPlane.unknown(term)
    plane.require_beam_below(light)
    plane.require_above(other.solid, "occlusion", BEAM_OFFSET * optics.thickness if kind.second_surface else 0.0)
    return term.built()


def _box(term: TermBuilder, optics: Optics) -> list[Expression]:
    """Corners (3) in view axes of a box given in rig."""
    corners = term.parameter(3 * BOX_CORNERS)
    return [optics.view_from_rig @ corners[3 * k : 3 * k + 3] for k in range(BOX_CORNERS)]


@lru_cache
def body_gap_term(kind: Kind) -> Term:
    """The solid of a mirror and a box lie on opposite sides of a plane.

    Unknowns: fold, mirror, plane (4). Parameters: optics, corners of the box in rig (24).
    """
    term = TermBuilder()
    optics = Optics.given(term)
    mirror, plane = given_mirror(kind, optics, term), SeparatingPlane.unknown(term)
    plane.require_below(mirror.solid)
    plane.require_above(_box(term, optics), "body")
    return term.built()


@lru_cache
def body_light_term(kind: Kind) -> Term:
    """No part of a box reaches into the beam from a mirror's virtual centre through its face, to infinity.

    Unknowns: fold, mirror, plane (4). Parameters: optics, corners of the box in rig (24).
    """
    term = TermBuilder()
    optics = Optics.given(term)
    light, plane = given_mirror(kind, optics, term), SeparatingPlane.unknown(term)
    plane.require_beam_below(light)
    plane.require_above(_box(term, optics), "body")
    return term.built()
