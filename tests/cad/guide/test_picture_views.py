"""Views of a picture: one below the other, with labels of points only where these are visible.

Components in pictures: displaced with a line to their seats, inserted along their exit paths, assembled onto fixed
ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.guide.assembly_steps import Stages
from mirrorcam.cad.guide.labels import CAPTION_ROOM_PX, pixel_of
from mirrorcam.cad.guide.picture_views import (
    ARROW_MM,
    STEP_RATIO,
    DevicePicture,
    Item,
    assembled,
    displaced,
    exit_path,
    in_place,
    inserted,
    labels_of,
    mean,
    name_of,
    rendering_of,
    triangles_of,
    views_of,
    write_picture,
)
from mirrorcam.cad.guide.shading import ShadedBody
from mirrorcam.core.images.pictures import read_image
from tests.cad.guide.conftest import Made

CUBE = Item(ShadedBody(np.asarray(trimesh.creation.box((20.0, 20.0, 20.0)).triangles), (0.5, 0.5, 0.5)), "")
NOTES = (("front", np.array([0.0, 0.0, 10.0])), ("back", np.array([0.0, 0.0, -10.0])))


@pytest.mark.slow
def test_each_view_names_the_points_that_it_shows() -> None:
    behind = DevicePicture("cube", "Cube", np.diag([-1.0, 1.0, -1.0]), (CUBE,), notes=NOTES)
    front = DevicePicture("cube", "Cube", np.eye(3), (CUBE,), notes=NOTES, lower=behind)
    seen = []
    for view in views_of(front):
        shot = rendering_of(view)
        seen.append([label.text for label in labels_of(view) if pixel_of(shot, label) is not None])
    assert seen == [["front"], ["back"]]


def test_views_lie_one_below_the_other_with_their_captions(tmp_path: Path) -> None:
    plain = DevicePicture("cube", "Cube", np.eye(3), (CUBE,))
    write_picture(tmp_path, DevicePicture("cube", "Cube", np.eye(3), (CUBE,), caption="Above", lower=plain))
    image = read_image(tmp_path / "pictures" / "cube.png")
    assert image.shape == (2100, 1400, 3)
    assert (image[:60, :200] < 100).any()
    # The drawing starts below the caption, whatever its height.
    tall = DevicePicture("cube", "Cube", np.eye(3), (CUBE,), caption="Above")
    assert not (rendering_of(tall).bodies[:CAPTION_ROOM_PX] >= 0).any()
    assert (image[1050:1110, :200] == 255).all()


@pytest.fixture
def stages(made: Made) -> Stages:
    return Stages(made.components)


def one(made: Made, kind: str) -> Component:
    return next(component for component in made.components if component.kind == kind)


def test_existing_pieces_may_be_pale_except_mirrors(made: Made) -> None:
    part, mirror = one(made, "part"), one(made, "mirror")
    assert in_place(part).body.rgb == part.rgb
    assert min(in_place(part, pale=True).body.rgb) > min(part.rgb)
    assert in_place(mirror, pale=True).body.rgb == mirror.rgb
    assert in_place(mirror).body.shine and not in_place(part).body.shine


def test_a_piece_is_moved_as_it_is_and_may_have_a_line_from_its_seat(made: Made) -> None:
    part, away, seat = one(made, "part"), np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, -4.0])
    item = displaced(part, away, name_of(part), seat=seat)
    np.testing.assert_allclose(item.body.triangles - triangles_of(part) - away, 0.0, atol=1e-9)
    assert item.line is not None and item.label == f"{part.number} {part.title}"
    np.testing.assert_allclose(item.line[1] - item.line[0], away - seat)
    assert displaced(part, away).line is None


def test_an_insert_is_at_the_beginning_of_its_way_behind_an_arrow(made: Made) -> None:
    insert = one(made, "insert")
    seat = np.array([5.0, 0.0, 0.0])
    drawn, arrow = inserted(insert, seat)
    assert drawn.line is not None
    np.testing.assert_allclose(np.diff(drawn.line, axis=0), np.diff(exit_path(insert), axis=0))
    way = drawn.line[0] - drawn.line[1]
    way /= np.linalg.norm(way)
    along = arrow.body.triangles.reshape(-1, 3) @ way
    assert np.ptp(along) == pytest.approx(ARROW_MM)
    assert along.max() < drawn.line[0] @ way
    assert name_of(insert) == ""


def test_fasteners_are_displaced_from_existing_pieces(stages: Stages) -> None:
    items = assembled(stages.mount, [], stages.holder_screws, stages.mount)
    assert len(items) == len(stages.mount) + len(stages.holder_screws)
    base = mean([component.explode_mm for component in stages.mount])
    for screw, item in zip(stages.holder_screws, items[len(stages.mount) :], strict=True):
        moves = item.body.triangles - triangles_of(screw)
        np.testing.assert_allclose(moves - STEP_RATIO * (screw.explode_mm - base), 0.0, atol=1e-9)


def test_the_mean_of_nothing_is_no_move() -> None:
    np.testing.assert_array_equal(mean([]), np.zeros(3))
    np.testing.assert_array_equal(mean([np.zeros(3), np.array([2.0, 4.0, 6.0])]), [1.0, 2.0, 3.0])
