"""Views of a picture: one below the other, and names of points only where these are seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from mirrorcam.cad.guide.labels import CAPTION_ROOM_PX, place_of
from mirrorcam.cad.guide.picture_views import DevicePicture, Item, labels_of, shot_of, views_of, write_picture
from mirrorcam.cad.guide.shading import ShadedBody
from mirrorcam.core.images.pictures import read_image

CUBE = Item(ShadedBody(np.asarray(trimesh.creation.box((20.0, 20.0, 20.0)).triangles), (0.5, 0.5, 0.5)), "")
NOTES = (("front", np.array([0.0, 0.0, 10.0])), ("back", np.array([0.0, 0.0, -10.0])))


def test_each_view_names_the_points_that_it_shows() -> None:
    behind = DevicePicture("cube", "Cube", np.diag([-1.0, 1.0, -1.0]), (CUBE,), notes=NOTES)
    front = DevicePicture("cube", "Cube", np.eye(3), (CUBE,), notes=NOTES, below=behind)
    seen = []
    for view in views_of(front):
        shot = shot_of(view)
        seen.append([label.text for label in labels_of(view) if place_of(shot, label) is not None])
    assert seen == [["front"], ["back"]]


def test_views_lie_one_below_the_other_with_their_captions(tmp_path: Path) -> None:
    plain = DevicePicture("cube", "Cube", np.eye(3), (CUBE,))
    write_picture(tmp_path, DevicePicture("cube", "Cube", np.eye(3), (CUBE,), caption="Above", below=plain))
    image = read_image(tmp_path / "pictures" / "cube.png")
    assert image.shape == (2100, 1400, 3)
    assert (image[:60, :200] < 100).any()
    # What is drawn begins below the caption, however high it is.
    tall = DevicePicture("cube", "Cube", np.eye(3), (CUBE,), caption="Above")
    assert not (shot_of(tall).bodies[:CAPTION_ROOM_PX] >= 0).any()
    assert (image[1050:1110, :200] == 255).all()
