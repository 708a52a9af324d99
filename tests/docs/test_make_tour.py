"""The tour's pictures are there, and are placed side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from docs.make_tour import TOUR, Illustration, illustrate, illustrations
from mirrorcam.core.images.pictures import read_image, write_image

LARGEST_BYTES = 300_000


def test_every_picture_is_there() -> None:
    found = illustrations(TOUR.read_text(encoding="utf-8"))
    assert len(found) >= 8
    assert all(1_000 < (TOUR.parent / each.picture).stat().st_size < LARGEST_BYTES for each in found)
    shown = {Path(each.picture).name for each in found}
    assert shown == {path.name for path in (TOUR.parent / "images").glob("tour_*")}


def test_pictures_are_placed_side_by_side(tmp_path: Path) -> None:
    for number, width in enumerate((900, 1100)):
        write_image(tmp_path / f"{number}.png", np.full((300 + number, width, 3), 80 * number, np.uint8))
    illustrate([tmp_path / "0.png", tmp_path / "1.png"], tmp_path / "both.png")
    both = read_image(tmp_path / "both.png")
    assert both.shape[1] == 1440
    assert (both[5, 10] == 0).all()
    assert (both[5, -10] == 80).all()


def test_comments_say_what_pictures_are_made_of() -> None:
    text = "<!-- from a/b.png c.png -->\n![A thing](images/x.jpg)\n"
    assert illustrations(text) == [Illustration("images/x.jpg", ("a/b.png", "c.png"))]
    with pytest.raises(ValueError, match=r"images/y\.jpg"):
        illustrations(text + "\n![Another](images/y.jpg)\n")
