"""The picture of the camera's step: everything that the guide mentions is visible in one of its views.

Pictures of a device: every part is shown and labelled, with the same bytes each time.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.guide.device_pictures import FIRST_END, is_v, notes_of
from mirrorcam.cad.guide.labels import pixel_of
from mirrorcam.cad.guide.picture_views import labels_of, rendering_of, views_of, write_picture
from mirrorcam.cad.guide.shading import Screen, render
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.geometry.camera_library import read_body
from tests.cad.guide.conftest import Made


def test_the_picture_shows_points_slots_and_both_screws_with_their_lengths(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "camera")
    seen = set()
    for view in views_of(picture):
        shot = rendering_of(view)
        seen |= {label.text for label in labels_of(view) if pixel_of(shot, label) is not None}
    tray = made.device.clip.tray
    assert tray is not None
    screws = {
        f"{name} screw, M3 x {screw.length_mm:g}" for name, screw in zip(("back", "corner"), tray.screws, strict=True)
    }
    assert {"V", "front pad", "side pad", "slot of the cable tie", FIRST_END} | screws <= seen


@pytest.mark.parametrize("name", ["c920", "pi_camera_2"])
def test_notes_are_what_a_clip_has(name: str) -> None:
    clip = plan_clip(HARDWARE.replaced(camera=read_body(name)))
    texts = {text for text, _ in notes_of(clip)}
    assert ("V" in texts) == (clip.nest is not None and is_v(clip.nest))
    assert ("front pad" in texts) == (clip.nest is not None)
    assert "slot of the cable tie" in texts


def test_the_exploded_view_shows_every_part_and_mirror(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "exploded")
    points = np.concatenate([item.body.triangles.reshape(-1, 3) for item in picture.items])
    shot = render([item.body for item in picture.items], Screen.around(points, picture.axes, (700, 525), (20, 20)))
    seen = set(np.unique(shot.bodies).tolist())
    shown = [index for index, component in enumerate(made.components) if component.kind in ("part", "mirror", "camera")]
    assert set(shown) <= seen


def test_every_insert_is_seen_in_a_view_and_counted_at_its_part(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "inserts")
    hidden: set[int] = set()
    counted = 0
    for number, view in enumerate(views_of(picture)):
        shot = rendering_of(replace(view, size_px=(700, 525)))
        pixels = np.bincount(shot.bodies[shot.bodies >= 0], minlength=len(view.items))
        # Items with a line to their seat are inserted; the views of a small device have the same items.
        unseen = {index for index, item in enumerate(view.items) if item.line is not None and pixels[index] < 12}
        hidden = hidden & unseen if number else unseen
        counted = sum(int(item.label.rpartition(": ")[2]) for item in view.items if item.label)
    assert hidden == set()
    assert counted == sum(component.kind == "insert" for component in made.components)


def test_every_mirror_and_seat_is_named_where_it_is(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "mirrors")
    mirrors, seats = views_of(picture)
    assert "from the scene" in mirrors.caption
    shots = [rendering_of(view) for view in (mirrors, seats)]
    at = [
        {label.text.removeprefix("seat "): pixel_of(shot, label) for label in labels_of(view)}
        for view, shot in zip((mirrors, seats), shots, strict=True)
    ]
    assert set(at[0]) == set(at[1]) == set(made.device.layout.mirror_names)
    mirror = {item.label: index for index, item in enumerate(mirrors.items) if item.label}
    for name, point in at[1].items():
        assert point is not None
        # In the same view, a mirror is over its own seat and over no other.
        middle = shots[0].screen.pixels(dict(seats.notes)[f"seat {name}"])
        assert shots[0].bodies[int(middle[1]), int(middle[0])] == mirror[name]


@pytest.mark.slow
def test_a_picture_has_margins_names_and_the_same_bytes(made: Made, tmp_path: Path) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "mirrors")
    assert {item.label for item in picture.items} > {"0-0", "0-1", "1-0", "1-1"}
    for folder in ("a", "b"):
        write_picture(tmp_path / folder, picture)
    first, second = ((tmp_path / folder / picture.path).read_bytes() for folder in ("a", "b"))
    assert first == second
    image = read_image(tmp_path / "a" / picture.path)
    assert image.shape == (2100, 1400, 3)
    assert (image[:20] == 255).all()
    assert (image[:, :8] == 255).all()
    blue = image[..., 2].astype(int) - image[..., 0] > 30
    assert blue.mean() > 0.05


def test_the_holders_screws_are_seen_at_the_openings_that_they_pass(made: Made) -> None:
    (picture,) = [picture for picture in made.pictures if picture.name == "holder"]
    shot = rendering_of(replace(picture, size_px=(700, 525)))
    pixels = np.bincount(shot.bodies[shot.bodies >= 0], minlength=len(picture.items))
    seen = [count for item, count in zip(picture.items, pixels, strict=True) if item.line is not None]
    assert len(seen) == 4
    assert min(seen) > 12
