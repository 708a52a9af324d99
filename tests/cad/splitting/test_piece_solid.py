"""A piece as a solid: the box of its plan cut out of the part, less its teardrop holes; what falls apart is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from build123d import Align, Box, BuildPart, Locations, Part

from mirrorcam.cad.plan.cuts import PiecePlan, hole_frame
from mirrorcam.cad.splitting.piece_solid import make_piece, whole_part
from mirrorcam.core.values import InputError

CORNER = (Align.MIN, Align.MIN, Align.MIN)


def make_posts(gap_mm: float) -> Part:
    """Two posts of 20 x 20 x 20 mm on a plate of 4 mm, this far apart along x."""
    with BuildPart() as posts:
        Box(40.0 + gap_mm, 20.0, 4.0, align=CORNER)
        with Locations((0.0, 0.0, 0.0), (20.0 + gap_mm, 0.0, 0.0)):
            Box(20.0, 20.0, 20.0, align=CORNER)
    return Part(posts.solids())


PIECE = PiecePlan(
    whole=10.0,
    make=make_posts,
    rig_from_bed=np.eye(4),
    low_mm=(-1.0, -1.0, -1.0),
    high_mm=(15.0, 21.0, 21.0),
    rig_from_pins=np.zeros((0, 4, 4)),
    hole_mm=(3.0, 8.0),
    crumb_mm=1.2,
)


def test_a_piece_is_its_box_of_the_part_less_its_holes() -> None:
    assert make_piece(PIECE).volume == pytest.approx(15.0 * 20.0 * 20.0)
    holes = np.array([hole_frame(np.array([15.0, y, 10.0]), 0, -1.0) for y in (6.0, 14.0)])
    drilled = make_piece(replace(PIECE, rig_from_pins=holes))
    steep = math.radians(42.0)
    teardrop = 1.5**2 * (math.pi - (math.pi / 2 - steep) + 1 / math.tan(steep))
    assert drilled.volume == pytest.approx(15.0 * 20.0 * 20.0 - 2.0 * 8.0 * teardrop, rel=1e-9)
    # The roofs are up: over a hole's axis the ridge reaches higher than its radius.
    assert not drilled.solids()[0].is_inside((10.0, 6.0, 10.0 + 1.5 / math.sin(steep) - 0.05))
    assert drilled.solids()[0].is_inside((10.0, 6.0, 10.0 - 1.55))


def test_a_box_on_a_turned_bed_is_turned_with_it() -> None:
    turned = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    piece = make_piece(replace(PIECE, rig_from_bed=turned, low_mm=(-1.0, -60.0, -1.0), high_mm=(21.0, -40.0, 21.0)))
    box = piece.bounding_box()
    assert pytest.approx((40.0, 50.0)) == (box.min.X, box.max.X)


def test_a_piece_of_two_solids_is_refused() -> None:
    with pytest.raises(InputError, match="falls apart into 2, expected one"):
        make_piece(replace(PIECE, low_mm=(10.0, -1.0, 5.0), high_mm=(40.0, 21.0, 21.0)))


def test_booleans_on_a_piece_leave_the_kept_part_as_it_was() -> None:
    before = whole_part(10.0, make_posts).volume
    make_piece(PIECE)
    assert whole_part(10.0, make_posts).volume == before
