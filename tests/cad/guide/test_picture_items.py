"""Pieces in pictures: moved with a line to where they belong, put in along their ways, joined to what rests."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.guide.assembly_steps import Stages
from mirrorcam.cad.guide.picture_items import (
    ARROW_MM,
    STEP_SHARE,
    joined,
    mean,
    moved,
    name_of,
    places_out,
    put_in,
    still,
    triangles_of,
)
from tests.cad.guide.conftest import Made


@pytest.fixture
def stages(made: Made) -> Stages:
    return Stages(made.pieces)


def one(made: Made, kind: str) -> Piece:
    return next(piece for piece in made.pieces if piece.kind == kind)


def test_what_rests_may_be_pale_but_for_mirrors(made: Made) -> None:
    part, mirror = one(made, "part"), one(made, "mirror")
    assert still(part).body.rgb == part.rgb
    assert min(still(part, pale=True).body.rgb) > min(part.rgb)
    assert still(mirror, pale=True).body.rgb == mirror.rgb
    assert still(mirror).body.shine and not still(part).body.shine


def test_a_piece_is_moved_as_it_is_and_may_have_a_line_from_its_seat(made: Made) -> None:
    part, away, seat = one(made, "part"), np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, -4.0])
    item = moved(part, away, name_of(part), seat=seat)
    np.testing.assert_allclose(item.body.triangles - triangles_of(part) - away, 0.0, atol=1e-9)
    assert item.line is not None and item.label == f"{part.number} {part.title}"
    np.testing.assert_allclose(item.line[1] - item.line[0], away - seat)
    assert moved(part, away).line is None


def test_an_insert_is_at_the_beginning_of_its_way_behind_an_arrow(made: Made) -> None:
    insert = one(made, "insert")
    seat = np.array([5.0, 0.0, 0.0])
    drawn, arrow = put_in(insert, seat)
    assert drawn.line is not None
    np.testing.assert_allclose(np.diff(drawn.line, axis=0), np.diff(places_out(insert), axis=0))
    way = drawn.line[0] - drawn.line[1]
    way /= np.linalg.norm(way)
    along = arrow.body.triangles.reshape(-1, 3) @ way
    assert np.ptp(along) == pytest.approx(ARROW_MM)
    assert along.max() < drawn.line[0] @ way
    assert name_of(insert) == ""


def test_fasteners_stand_off_what_rests(stages: Stages) -> None:
    items = joined(stages.mount, [], stages.holder_screws, stages.mount)
    assert len(items) == len(stages.mount) + len(stages.holder_screws)
    base = mean([piece.explode_mm for piece in stages.mount])
    for screw, item in zip(stages.holder_screws, items[len(stages.mount) :], strict=True):
        moves = item.body.triangles - triangles_of(screw)
        np.testing.assert_allclose(moves - STEP_SHARE * (screw.explode_mm - base), 0.0, atol=1e-9)


def test_the_mean_of_nothing_is_no_move() -> None:
    np.testing.assert_array_equal(mean([]), np.zeros(3))
    np.testing.assert_array_equal(mean([np.zeros(3), np.array([2.0, 4.0, 6.0])]), [1.0, 2.0, 3.0])
