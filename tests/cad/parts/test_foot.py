"""The foot of the mount: below the clip at its lowest, thick enough for what is screwed into it."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.foot import FOOT_DEPTH_MM, foot_plate_mm, foot_screws, foot_stack, foot_z_mm
from mirrorcam.cad.plan.fasteners import stack
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import InputError


def test_the_clip_at_its_lowest_leaves_the_window_for_the_cable_over_the_foots_plate() -> None:
    clip = plan_clip(HARDWARE)
    top_of_plate = foot_z_mm(clip, FOOT_DEPTH_MM, HARDWARE) + foot_plate_mm(FOOT_DEPTH_MM, HARDWARE)
    assert clip.bottom_mm - clip.travel_mm - top_of_plate > HARDWARE.mount.cable_window_mm[1]


@pytest.mark.parametrize("kind", ["insert", "nut"])
@pytest.mark.parametrize("grip_mm", [1.6, 5.5])
def test_the_screws_of_a_back_hold_in_the_threads_of_the_plate(kind: str, grip_mm: float) -> None:
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    held = foot_stack(grip_mm, hardware)
    assert held.wall_mm == stack(hardware.mount.skin_mm, hardware).wall_mm <= foot_plate_mm(FOOT_DEPTH_MM, hardware)
    least = hardware.screw.engaged_mm if kind == "insert" else hardware.screw.nut_height_mm
    assert held.engaged_mm >= least - 1e-9
    # Under an insert there is plastic, over a nut the hollow of the truss.
    assert held.length_mm - grip_mm < (hardware.screw.insert_depth_mm if kind == "insert" else held.wall_mm + 1.0)


def test_screws_that_no_length_holds_are_refused() -> None:
    with pytest.raises(InputError, match=r"M3 screws through 40 mm hold by 0\.0 mm of thread"):
        foot_stack(40.0, HARDWARE)


def test_four_screws_enter_the_foots_lower_face_mirror_images_in_x() -> None:
    clip = plan_clip(HARDWARE)
    screws = foot_screws(clip, 30.0, HARDWARE)
    assert screws.shape == (4, 3)
    np.testing.assert_array_equal(screws[:, 2], np.full(4, foot_z_mm(clip, 30.0, HARDWARE)))
    assert {tuple(screw) for screw in screws} == {tuple(screw * [-1.0, 1.0, 1.0]) for screw in screws}
    assert (clip.slide_y_mm - screws[:, 1] > 0.0).all()
    assert (clip.slide_y_mm - screws[:, 1] < FOOT_DEPTH_MM).all()


def test_a_deep_mount_has_a_thick_plate_that_reaches_further_down() -> None:
    clip, depths = plan_clip(HARDWARE), (FOOT_DEPTH_MM, 45.0, 60.0)
    plates = [foot_plate_mm(depth, HARDWARE) for depth in depths]
    assert plates == pytest.approx([stack(HARDWARE.mount.skin_mm, HARDWARE).wall_mm, 15.0, 20.0])
    tops = [foot_z_mm(clip, depth, HARDWARE) + plate for depth, plate in zip(depths, plates, strict=True)]
    assert tops == pytest.approx([tops[0]] * 3)
