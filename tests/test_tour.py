"""The tour: its commands are commands, its pictures are there, and each is made of what a command writes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from cyclopts import CycloptsError

from docs.make_tour import TOUR, Illustration, commands, illustrate, illustrations
from mirrorcam.cli import application
from mirrorcam.core.images.pictures import read_image, write_image

LARGEST_BYTES = 1_500_000


def tour() -> str:
    return TOUR.read_text(encoding="utf-8")


@pytest.mark.parametrize("line", commands(tour()))
def test_every_command_of_the_tour_can_be_run(line: str) -> None:
    program, *arguments = shlex.split(line)
    assert program == "mirrorcam"
    application().parse_args(arguments, exit_on_error=False, print_error=False)


def test_an_option_that_does_not_exist_is_seen() -> None:
    with pytest.raises(CycloptsError, match="--focus-mm"):
        application().parse_args(["refocus", "a.npz", "--focus-mm", "400"], exit_on_error=False, print_error=False)


def test_every_picture_is_there_and_made_of_what_a_command_writes() -> None:
    text = tour()
    written = {Path(out) for line in commands(text) for out in re.findall(r"--out (\S+)", line)}
    found = illustrations(text)
    assert len(found) >= 8
    for each in found:
        picture = TOUR.parent / each.picture
        assert 1_000 < picture.stat().st_size < LARGEST_BYTES
        assert {Path(name).parts[0] for name in each.made_of} <= {str(folder) for folder in written}
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
