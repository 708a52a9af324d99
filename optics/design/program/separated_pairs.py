"""Pairs of mirrors, and mirrors and the camera's body, kept apart in a program by an unknown plane each."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program import robustness, separation
from mirrorcam.optics.design.program.draft import Draft
from mirrorcam.optics.design.program.seeds import Seed, tile_places
from mirrorcam.optics.geometry.arrangement import Arrangement

NEAR_TILES = 1e-6
"""Difference of the places of two tiles that is none."""

PairKind = Literal["seen", "gap", "in", "out"]


@dataclass(frozen=True, order=True)
class PairConstraint:
    """A constraint on two mirrors: a gap between them, in the image ("seen") or in space ("gap"), or free light.

    "in" and "out" keep the second out of the light to and from the first.
    """

    kind: PairKind
    first: int
    second: int


def neighbour_pairs(arrangement: Arrangement) -> tuple[PairConstraint, ...]:
    """The constraints on neighbours that every design starts with; others follow where a solution violates them.

    Neighbours are those whose tiles touch in the seed. Gaps and free light in both directions; across the diagonal,
    beams leave side by side without being kept apart.
    """
    places, pairs = tile_places(arrangement), []
    for i, j in combinations(range(len(places)), 2):
        across, down = np.abs(places[j] - places[i]) + NEAR_TILES
        if max(down, across) > 1.0 + 2.0 * NEAR_TILES:
            continue
        diagonal = min(down, across) >= 1.0
        pairs += [PairConstraint("seen", i, j), PairConstraint("gap", i, j)]
        legs: tuple[PairKind, ...] = ("in",) if diagonal else ("in", "out")
        pairs += [PairConstraint(leg, *ordered) for leg in legs for ordered in ((i, j), (j, i))]
    return tuple(pairs)


def add_body(draft: Draft) -> None:
    """The box around the camera's body, out of the reach of mirrors and of their light."""
    spec = draft.spec
    box = (spec.kept_free_in_rig_mm / spec.scale_mm).ravel()
    if box.size == 0:
        return
    for mirror, middle in zip(draft.mirrors, draft.seed.middles(spec.view_from_rig), strict=True):
        sideways = -_unit(middle * [1.0, 1.0, 0.0])
        for term, normal in (
            (separation.body_gap_term(draft.kind), -_unit(middle)),
            (separation.body_light_term(draft.kind), sideways),
        ):
            plane = draft.program.unknown([*normal, normal @ middle / 2.0], *_plane_range(3))
            draft.add(term, [*mirror, plane], [box])


def add_pairs(draft: Draft, pairs: tuple[PairConstraint, ...]) -> None:
    """The constraints on pairs, each with the unknowns of its plane."""
    spec, kind = draft.spec, draft.kind
    terms = {
        "gap": separation.gap_term(kind),
        "in": separation.incoming_term(kind),
        "out": separation.outgoing_term(kind),
    }
    gap, seen_gap = spec.spacing_mm / spec.scale_mm, spec.seen_gap_mm / spec.scale_mm
    moved, middles = robustness.displacements(spec, draft.seed), draft.seed.middles(spec.view_from_rig)
    for pair in pairs:
        plane = _first_plane(pair, draft.seed, middles)
        unknown = draft.program.unknown(plane, *_plane_range(plane.size - 1))
        first, second = draft.mirrors[pair.first], draft.mirrors[pair.second]
        if pair.kind == "seen":
            safe = robustness.safe_gap(moved[[pair.first, pair.second]], plane[:2])
            draft.program.add(
                separation.seen_gap_term(kind.sides), [first[1], second[1], unknown], [max(seen_gap, safe)]
            )
        else:
            given: list[ArrayLike] = [gap] if pair.kind == "gap" else []
            draft.add(terms[pair.kind], [*first, *second, unknown], given)


def _plane_range(size: int) -> tuple[FloatArray, FloatArray]:
    """Least and greatest values of the normal (size) of a plane or line, and of its offset."""
    reach = np.array([*np.ones(size), np.inf])
    return -reach, reach


def _first_plane(pair: PairConstraint, seed: Seed, middles: FloatArray) -> FloatArray:
    """The plane (normal, offset) or line (3) that a pair starts with; chief rays meet their mirrors at `middles`."""
    if pair.kind == "seen":
        p, q = seed.chief[pair.first], seed.chief[pair.second]
        across = _unit(q - p)
        return np.array([*across, -across @ (p + q) / 2.0])
    a, b, centre = middles[pair.first], middles[pair.second], seed.centres[pair.first]
    if pair.kind == "gap":
        normal = _unit(b - a)
        return np.array([*normal, normal @ (a + b) / 2.0])
    between = _unit(_unit(b) - _unit(a))
    if pair.kind == "in":
        return np.array([*between, 0.0])
    turned = between - 2.0 * (between @ centre) / (centre @ centre) * centre
    return np.array([*turned, turned @ centre])


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
