"""A camera of one's own: answers become a profile, faulty ones are asked again, nothing of the user's is replaced."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.device.new_camera import write_new_camera
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.camera_library import read_body, read_camera, read_profile

C920 = read_profile("c920")
# Name, A to P, lip, picture, view, pupil, focus.
MINE = [
    *("Mine", "90", "30", "25,5", "12", "-3", "1.5", "18", "2", "5", "4", "1", "30", "10", "95"),
    *("2.5", "1280", "720", "600 at 495", "1.7", "450"),
]


class Person:
    """Gives answers, one after the other, and keeps what it was asked and told."""

    def __init__(self, answers: list[str]) -> None:
        self.answers: Iterator[str] = iter(answers)
        self.asked: list[str] = []
        self.told: list[str] = []

    def ask(self, question: str) -> str:
        self.asked.append(question)
        answer = next(self.answers, None)
        if answer is None:
            raise EOFError
        return answer

    def say(self, line: str) -> None:
        self.told.append(line)


def test_answers_become_a_profile_that_all_commands_read(tmp_path: Path) -> None:
    person = Person(MINE)
    write_new_camera(tmp_path / "mine.toml", C920, person.ask, person.say)
    body, camera = read_body(str(tmp_path / "mine.toml")), read_camera(str(tmp_path / "mine.toml"))
    assert (body.name, body.width_mm, body.depth_mm, body.lens_x_mm, body.mass_g) == ("Mine", 90.0, 25.5, -3.0, 95.0)
    assert (camera.width_px, camera.height_px, camera.aperture_mm, camera.focus_mm) == (1280, 720, 1.7, 450.0)
    # 600 mm of a ruler, 495 mm before the front and 500 mm before the pupil, fill the width.
    assert camera.fx_px == pytest.approx(1280.0 * 500.0 / 600.0, abs=0.01)
    degrees = math.degrees(2.0 * math.atan(0.6))
    assert body.field_of_view_deg is not None
    assert body.field_of_view_deg[0] == pytest.approx(degrees, abs=0.1)
    assert set(body.guessed) == {"held_by.lip_mm"}
    drawing = (tmp_path / "mine.svg").read_text(encoding="utf-8")
    assert "Mine: as measured" in drawing
    assert len(person.asked) == len(MINE)


def test_empty_answers_keep_what_is_offered_and_question_marks_are_guesses(tmp_path: Path) -> None:
    person = Person(["Twin", *[""] * 3, "?", *[""] * 16])
    write_new_camera(tmp_path / "twin.toml", C920, person.ask, person.say)
    body = read_body(str(tmp_path / "twin.toml"))
    assert body.replaced(name=C920.name, guessed=C920.body.guessed) == C920.body
    assert set(body.guessed) == {*C920.body.guessed, "end_radius_mm"}
    assert read_profile(str(tmp_path / "twin.toml")).guessed == ("aperture_mm",)


def test_empty_answers_keep_the_holes_of_a_board(tmp_path: Path) -> None:
    board = read_profile("arducam_b0196")
    person = Person(["Twin", *[""] * 30])
    write_new_camera(tmp_path / "twin.toml", board, person.ask, person.say)
    held, expected = read_body(str(tmp_path / "twin.toml")).held_by, board.body.held_by
    assert isinstance(held, BoardHoles) and isinstance(expected, BoardHoles)
    reach = [np.abs(each.holes_mm).max(axis=0) for each in (held, expected)]
    assert reach[0] == pytest.approx(reach[1], abs=0.01)
    assert (held.hole_mm, held.post_mm, held.screw_mm) == (expected.hole_mm, expected.post_mm, expected.screw_mm)


def test_what_cannot_be_read_is_asked_again_with_a_reason(tmp_path: Path) -> None:
    answers = ["", "wide", "-4", "0", "95", *[""] * 15, "1280.5", "1280", "720", "200", "70 at", "70", "", ""]
    person = Person(answers)
    write_new_camera(tmp_path / "mine.toml", C920, person.ask, person.say)
    assert read_body(str(tmp_path / "mine.toml")).width_mm == 95.0
    assert "wide: expected a number" in person.told
    assert sum(line.startswith(("-4: ", "0: ")) for line in person.told) == 2
    assert any(line.startswith("1280.5: expected a valid integer") for line in person.told)
    assert any(line.startswith("200: expected a field of view") for line in person.told)


def test_answers_that_contradict_each_other_are_asked_again_and_none_is_lost(tmp_path: Path) -> None:
    """Edges rounder than half of the height: the second round offers the first one's answers."""
    first = ["Mine", "90", "20", *[""] * 18]
    second = ["", "", "", "", "9", *[""] * 16]
    person = Person([*first, *second])
    write_new_camera(tmp_path / "mine.toml", C920, person.ask, person.say)
    body = read_body(str(tmp_path / "mine.toml"))
    assert (body.name, body.width_mm, body.height_mm, body.end_radius_mm) == ("Mine", 90.0, 20.0, 9.0)
    assert any("end_radius_mm 14, expected at most half" in line for line in person.told)


def test_a_board_is_asked_for_its_holes_and_one_without_a_lens_for_no_optics(tmp_path: Path) -> None:
    like = read_profile("board_38")
    person = Person(["My board", *[""] * 14, "28", "28", "2.2", "5", "2"])
    write_new_camera(tmp_path / "board.toml", like, person.ask, person.say)
    held = read_body(str(tmp_path / "board.toml")).held_by
    assert held.kind == "board"
    assert set(held.holes_mm) == {(x, y) for x in (-14.0, 14.0) for y in (-14.0, 14.0)}
    with pytest.raises(InputError, match="the focal length is unknown"):
        read_camera(str(tmp_path / "board.toml"))


@pytest.mark.parametrize("taken", ["mine.toml", "mine.svg", "mine.pdf"])
def test_no_file_is_replaced(tmp_path: Path, taken: str) -> None:
    (tmp_path / taken).write_text("kept")
    with pytest.raises(InputError, match=f"{taken}: already exists"):
        write_new_camera(tmp_path / "mine.toml", C920, Person(MINE).ask, print)
    assert [path.name for path in tmp_path.iterdir()] == [taken]
    assert (tmp_path / taken).read_text() == "kept"


def test_who_stops_answering_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no answer to .D: radius"):
        write_new_camera(tmp_path / "mine.toml", C920, Person(MINE[:4]).ask, print)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match=r"expected a name that ends in \.toml"):
        write_new_camera(tmp_path / "mine.json", C920, Person(MINE).ask, print)
