"""Controls set fields that a request has, within what it allows, and say what they buy."""

from __future__ import annotations

import json

import pytest

from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import library, read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.controls import Control, control_groups, snapping_groups

EVERY = [control for group in control_groups(DesignSpec()) for control in group.controls]


def test_every_field_of_a_request_has_its_control() -> None:
    assert {control.name for control in EVERY} | {"cols"} == DesignSpec.model_fields.keys()


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


@pytest.mark.parametrize("control", [each for each in EVERY if each.named], ids=lambda control: control.name)
def test_each_name_sets_fields_of_a_request(control: Control) -> None:
    requests = [DesignSpec.model_validate(each.fields) for each in control.named]
    assert len(set(requests)) == len({each.text for each in control.named}) == len(requests)
    assert DesignSpec() in requests


def test_a_camera_and_a_pattern_from_a_file_are_offered_with_the_others() -> None:
    own = DesignSpec(camera=Camera.c920().replaced(name="mine", fx_px=900.0), pattern=Pattern.ring(5))
    camera, pattern = (control_groups(own)[0].controls[number].named for number in (0, 1))
    names = [each.text for each in camera]
    assert (names[0], names[-1], pattern[-1].text) == ("Logitech C920", "mine", "ring5")
    assert sorted(names[:-1]) == sorted(profile.name for profile in library().values() if profile.optics)


def test_a_camera_of_the_library_is_offered_once() -> None:
    camera = control_groups(DesignSpec(camera=read_camera("d435")))[0].controls[0].named
    assert [each.key for each in camera].count("d435") == 1
    assert len(camera) == len({each.text for each in camera})


def test_an_atlas_snaps_to_its_values() -> None:
    axes = {"rows": [1.0, 2.0], "cols": [2.0, 3.0], "scale_mm": [60.0, 80.0], "tradeoff": [0.3]}
    (group,) = snapping_groups(axes)
    assert {control.name: list(control.values) for control in group.controls} == axes
