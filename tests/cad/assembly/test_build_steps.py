"""Steps of building a device: what hangs together with the camera when each is done."""

from __future__ import annotations

import pytest

from mirrorcam.cad.assembly.build_steps import STEPS, parts_when_joined, with_camera

PIECES = ("mirror_holder_1", "mirror_holder_2", "mount", "camera_clip", "adapter_cap", "mirror_0-0", "camera")
FASTENED = {
    "screw_01": ("mount", "mirror_holder"),
    "screw_02": ("mount", "camera_clip"),
    "screw_03": ("camera_clip",),
    "insert_01": ("mirror_holder",),
    "pin_01": ("mirror_holder_1", "mirror_holder_2"),
}


def together(name: str) -> set[str]:
    (last,) = (step for step in STEPS if step.name == name)
    return with_camera(STEPS, last, PIECES, FASTENED)


def test_the_camera_is_alone_until_it_is_in_its_clip() -> None:
    assert together("holder") == set()
    assert together("camera") == {"camera_clip", "screw_03"}


def test_the_clip_brings_the_mount_and_all_that_is_on_it() -> None:
    assert together("clip") == (set(PIECES) | set(FASTENED)) - {"camera", "adapter_cap"}
    assert together("calibrate") == (set(PIECES) | set(FASTENED)) - {"camera"}


def test_pictures_go_to_folders_of_their_own() -> None:
    assert [step.pictures for step in STEPS if step.pictures] == ["base", "frames"]


def test_names_of_steps_differ() -> None:
    assert len({step.name for step in STEPS}) == len(STEPS)


SPLIT = {"mirror_holder", "mirror_0-0", "mount_1", "mount_2", "camera_clip", "camera", "adapter_saddle", "adapter_cap"}


@pytest.mark.parametrize(
    ("joins", "there"),
    [
        (("mount", "mirror_holder"), {"mirror_holder", "mirror_0-0", "mount_1", "mount_2"}),
        (("camera_clip",), {"camera", "camera_clip"}),
        (("mount", "camera_clip"), SPLIT - {"adapter_saddle", "adapter_cap"}),
        (("adapter_saddle", "mount"), SPLIT),
        (("adapter_cap", "adapter_saddle"), SPLIT),
        (("something", "else"), set()),
    ],
)
def test_at_a_screw_there_is_what_hangs_together_with_its_parts_by_then(
    joins: tuple[str, ...], there: set[str]
) -> None:
    assert parts_when_joined(joins, SPLIT) == there
