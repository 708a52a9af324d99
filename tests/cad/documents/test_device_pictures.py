"""Pictures of a device: every part is shown and named, with the same bytes each time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.cad.documents.device_pictures import write_picture
from mirrorcam.cad.documents.shading import Screen, render
from mirrorcam.optics.base.pictures import read_image
from tests.cad.documents.conftest import Made


def test_the_exploded_view_shows_every_part_and_mirror(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "exploded")
    points = np.concatenate([item.body.triangles.reshape(-1, 3) for item in picture.items])
    shot = render([item.body for item in picture.items], Screen.around(points, picture.axes, (700, 525), (20, 20)))
    seen = set(np.unique(shot.bodies).tolist())
    shown = [index for index, piece in enumerate(made.pieces) if piece.kind in ("part", "mirror", "camera")]
    assert set(shown) <= seen


def test_a_picture_has_margins_names_and_the_same_bytes(made: Made, tmp_path: Path) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "mirrors")
    assert {item.label for item in picture.items} > {"0-0", "0-1", "1-0", "1-1"}
    for folder in ("a", "b"):
        write_picture(tmp_path / folder, picture)
    first, second = ((tmp_path / folder / picture.path).read_bytes() for folder in ("a", "b"))
    assert first == second
    image = read_image(tmp_path / "a" / picture.path)
    assert image.shape == (1050, 1400, 3)
    assert (image[:20] == 255).all()
    assert (image[:, :8] == 255).all()
    blue = image[..., 2].astype(int) - image[..., 0] > 30
    assert blue.mean() > 0.05
