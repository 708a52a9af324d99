"""Controls set fields that a request has, within what it allows, and say what they buy."""

from __future__ import annotations

import json

import pytest

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import library, read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.controls import Control, control_groups, snapping_groups

EVERY = [control for group in control_groups(DesignSpec()) for control in group.controls]


def test_every_field_of_a_request_but_pattern_has_its_control() -> None:
    named = {control.name for control in EVERY} | {"cols"}
    assert named == DesignSpec.model_fields.keys() - {"pattern"}


@pytest.mark.parametrize("control", EVERY, ids=lambda control: control.name)
def test_the_ends_of_a_slider_are_requests_and_its_text_is_a_sentence(control: Control) -> None:
    assert control.help.endswith(".")
    assert control.help[0].isupper()
    if control.kind == "slider":
        for value in (control.least, control.most):
            DesignSpec().replaced(**{control.name: value})
    shape = {"shape": "free"} if control.name == "sides" else {}
    for choice, _ in control.choices:
        stated = str(control.preset) if choice == "stock:" else choice
        DesignSpec().replaced(
            **shape, **{control.name: stated if isinstance(control.preset, str) else json.loads(choice)}
        )


def test_a_camera_from_a_file_is_offered_with_the_presets() -> None:
    own = Camera.c920().replaced(name="mine", fx_px=900.0)
    (camera,) = (c for c in control_groups(DesignSpec(camera=own))[0].controls if c.kind == "camera")
    names = [each.camera.name for each in camera.cameras]
    assert (names[0], names[-1]) == ("Logitech C920", "mine")
    assert sorted(names[:-1]) == sorted(profile.name for profile in library().values() if profile.optics)


def test_a_camera_of_the_library_is_offered_once() -> None:
    (camera,) = (c for c in control_groups(DesignSpec(camera=read_camera("d435")))[0].controls if c.kind == "camera")
    assert [each.key for each in camera.cameras].count("d435") == 1
    assert len(camera.cameras) == len({each.camera.name for each in camera.cameras})


def test_an_atlas_snaps_to_its_values() -> None:
    axes = {"rows": [1.0, 2.0], "cols": [2.0, 3.0], "scale_mm": [60.0, 80.0], "tradeoff": [0.3]}
    (group,) = snapping_groups(axes)
    assert {control.name: list(control.values) for control in group.controls} == axes
