"""A camera's body: its box relative to the pupil, and valid files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody, Lips
from mirrorcam.optics.geometry.camera_library import camera_names, read_body

PLAIN = CameraBody(
    name="box",
    width_mm=90.0,
    height_mm=25.0,
    depth_mm=20.0,
    lens_x_mm=-32.0,
    lens_y_mm=2.0,
    pupil_behind_front_mm=4.0,
    lens_ring_mm=6.0,
    lens_protrusion_mm=0.0,
    cable_mm=5.0,
    mass_g=70.0,
    held_by=Lips(lip_mm=2.0),
)
BOARD: dict[str, Any] = {
    "lens_protrusion_mm": 4.0,
    "held_by": BoardHoles(holes_mm=((-9.0, 0.0), (9.0, 0.0)), hole_mm=2.2, post_mm=5.0),
}


def test_a_board_plays_by_half_of_what_its_holes_are_wider_than_its_screws() -> None:
    holes = BoardHoles(holes_mm=((-9.0, 0.0), (9.0, 0.0)), hole_mm=2.5, post_mm=5.0)
    assert holes.play_mm == pytest.approx(0.25)
    assert holes.replaced(screw_mm=2.5).play_mm == 0.0


def test_the_box_is_that_of_the_body_seen_from_the_pupil() -> None:
    """The body's centre is offset opposite to the lens; its front lies at the stated distance from the pupil."""
    low, high = np.array(PLAIN.box_mm)
    np.testing.assert_allclose(high - low, [90.0, 25.0, 20.0])
    np.testing.assert_allclose((low + high)[:2] / 2.0, [32.0, -2.0])
    assert high[2] == 4.0


@pytest.mark.parametrize("name", camera_names())
def test_lens_and_holes_are_within_the_body(name: str) -> None:
    """The pupil of a body with a barrel lies within the barrel, any other pupil within the body's depth."""
    body = read_body(name)
    low, high = np.array(body.box_mm)
    assert (low[:2] < -1.0).all()
    assert (high[:2] > 1.0).all()
    assert -body.lens_protrusion_mm < body.pupil_behind_front_mm < body.depth_mm
    if isinstance(body.held_by, BoardHoles):
        holes = np.array(body.held_by.holes_mm)
        assert (holes - body.held_by.hole_mm / 2.0 > low[:2]).all()
        assert (holes + body.held_by.hole_mm / 2.0 < high[:2]).all()
    elif isinstance(body.held_by, Lips):
        assert body.held_by.lip_mm < body.height_mm / 2.0 - abs(body.lens_y_mm) - body.lens_ring_mm / 2.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"guessed": ("lens_z_mm",)}, "guessed: lens_z_mm is not a dimension of a body"),
        ({"guessed": ("name",)}, "guessed: name is not a dimension of a body"),
        ({"end_radius_mm": 12.6}, "end_radius_mm 12.6, expected at most half of 90 x 25"),
        ({"foot_mm": (1.0, 0.0, 1.0)}, "foot_mm"),
        ({"lens_protrusion_mm": -1.0}, "lens_protrusion_mm"),
        ({"rest_mm": (1.0, 2.0)}, "rest_mm is given for a body held by lips"),
        ({"rest_mm": (3.0, 5.0), **BOARD}, "rest_mm 3 to 5, .* at most lens_protrusion_mm 4"),
        ({"rest_mm": (3.0, 2.0), **BOARD}, "rest_mm 3 to 2, expected increasing"),
    ],
)
def test_an_invalid_body_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValue, match=message):
        PLAIN.replaced(**changes)


def test_a_guess_may_be_about_what_holds_it_and_what_is_not_stated_is_not_written() -> None:
    assert PLAIN.replaced(guessed=("held_by.lip_mm", "mass_g")).guessed == ("held_by.lip_mm", "mass_g")
    assert not {"guessed", "foot_mm", "end_radius_mm"} & PLAIN.model_dump().keys()
