"""What the picture of the camera's step names: all that the guide speaks of is seen in one of its views."""

from __future__ import annotations

import pytest

from mirrorcam.cad.guide.clip_picture import FIRST_END, is_v, notes_of
from mirrorcam.cad.guide.labels import place_of
from mirrorcam.cad.guide.picture_views import labels_of, shot_of, views_of
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.camera_library import read_body
from tests.cad.guide.conftest import Made


def test_the_picture_shows_points_slots_and_both_screws_with_their_lengths(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "camera")
    seen = set()
    for view in views_of(picture):
        shot = shot_of(view)
        seen |= {label.text for label in labels_of(view) if place_of(shot, label) is not None}
    screws = {f"{name} screw, M3 x {length}" for name, length in (("corner", 25), ("back", 12))}
    assert {"V", "front pad", "side pad", "slot of the cable tie", FIRST_END} | screws <= seen


@pytest.mark.parametrize("name", ["c920", "pi_camera_2"])
def test_notes_are_what_a_clip_has(name: str) -> None:
    clip = plan_clip(HARDWARE.replaced(camera=read_body(name)))
    texts = {text for text, _ in notes_of(clip)}
    assert ("V" in texts) == (clip.nest is not None and is_v(clip.nest))
    assert ("front pad" in texts) == (clip.nest is not None)
    assert "slot of the cable tie" in texts
