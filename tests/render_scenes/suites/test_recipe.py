"""Recipes of sets: their abbreviations, refused values, and the requests made from them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.suites.recipe import SetRecipe


def recipe(**stated: object) -> SetRecipe:
    return SetRecipe.model_validate({"name": "one"} | stated)


def test_short_forms_stand_for_whole_values() -> None:
    short = recipe(tolerances="none", sensor={"like": "poor", "exposure": 0.2}, design={"pattern": "hex7"})
    assert short.tolerances == Tolerances.none()
    assert short.sensor == SENSORS["poor"].replaced(exposure=0.2)
    assert short.mirrors == 7
    assert recipe(sensor="webcam").sensor == SENSORS["webcam"]


def test_the_camera_has_the_lens_and_the_pixels_that_are_stated() -> None:
    fisheye = recipe(lens_model="fisheye", distortion=[-0.02, 0.006, -0.004, 0.001], binned=0.5)
    assert fisheye.camera == Camera.c920().replaced(
        lens_model="fisheye", distortion=[-0.02, 0.006, -0.004, 0.001]
    ).binned(0.5)
    assert fisheye.spec is not None
    assert fisheye.spec.camera == fisheye.camera


def test_copies_differ_in_their_seeds_alone() -> None:
    copies = recipe(copies=3, seed=7).expanded()
    assert [(each.name, each.seed) for each in copies] == [("one-0000", 7), ("one-0001", 8), ("one-0002", 9)]
    assert all(each.replaced(name="one", seed=7) == recipe(seed=7) for each in copies)


def test_what_is_stated_does_not_depend_on_name_and_purpose_but_on_everything_else() -> None:
    stated = recipe().content_inputs()
    assert recipe(name="two", why="no reason", copies=3).content_inputs() == stated
    for change in ({"seed": 1}, {"frames": 19}, {"binned": 0.5}, {"design": {"rows": 2}}, {"depths_mm": [400.0]}):
        assert recipe(**change).content_inputs() != stated


def test_the_camera_of_the_library_counts_by_its_numbers() -> None:
    by_name = recipe(design={"camera": "brio"})
    in_numbers = recipe(design={"camera": by_name.camera.model_dump()})
    assert in_numbers.content_inputs() == by_name.content_inputs()


def test_boards_stand_at_the_depths_that_are_stated(default_layout: Layout) -> None:
    at_one = recipe(depths_mm=[400.0], frames=6, base_frames=0).request(default_layout)
    middle = np.array([*at_one.board.size_mm, 0.0, 2.0]) / 2.0
    depths_mm = (np.array(at_one.poses) @ middle)[:, :3] @ default_layout.view_from_rig[2]
    assert len(depths_mm) == 6
    assert np.all((depths_mm > 0.9 * 400.0) & (depths_mm < 1.17 * 400.0))
    assert at_one.layout == default_layout
    assert recipe().request(default_layout).poses == ()


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"name": "../out"}, "name"),
        ({"sensor": "phone"}, "sensor 'phone': expected one of ideal"),
        ({"sensor": {"like": "phone"}}, "expected one of ideal"),
        ({"design": {"pattern": "cross"}}, "design.pattern: 'cross', expected hexN, ringN"),
        ({"lens_model": "fisheye"}, "lens_model and distortion: expected both or none"),
        ({"lens_model": "fisheye", "distortion": [1.0]}, "distortion"),
        ({"finish": {"sag_mm": 0.1}}, "renderer fast: mirrors are smooth and flat"),
        ({"seed": 2**63 - 2, "copies": 3}, "seed: the last copy"),
        ({"frames": 0}, "frames"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_bad_recipes_are_refused(stated: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValue, match=message):
        recipe(**stated)


def test_a_layout_takes_the_place_of_a_design(default_layout: Layout) -> None:
    given = recipe(layout=default_layout.model_dump(mode="json", by_alias=True), binned=0.5)
    assert given.spec is None
    assert given.request(None).layout.camera == default_layout.camera.binned(0.5)
    with pytest.raises(InvalidValue, match="layout and design: expected at most one of the two"):
        recipe(layout=default_layout.model_dump(mode="json", by_alias=True), design={"rows": 2})


def test_a_board_that_cannot_be_seen_is_refused_when_the_set_is_asked_for(default_layout: Layout) -> None:
    tiny = {"kind": "charuco", "cols": 5, "rows": 4, "square_mm": 1.0, "marker_mm": 0.7}
    with pytest.raises(InputError, match="too small to be resolved"):
        recipe(board=tiny, depths_mm=[400.0]).request(default_layout)
