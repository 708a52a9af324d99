"""The foot of the mount: below the clip at its lowest, thick enough for what is screwed into it."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.foot import FOOT_DEPTH_MM, foot_plate_mm, foot_screws, foot_z_mm
from mirrorcam.cad.plan.fasteners import stack
from mirrorcam.cad.plan.hardware import HARDWARE


def test_the_clip_at_its_lowest_leaves_the_window_for_the_cable_over_the_foots_plate() -> None:
    clip = plan_clip(HARDWARE)
    top_of_plate = foot_z_mm(clip, HARDWARE) + foot_plate_mm(HARDWARE)
    assert clip.bottom_mm - clip.travel_mm - top_of_plate > HARDWARE.mount.cable_window_mm[1]


def test_the_plate_holds_the_adapters_screws_and_a_tripod_nut() -> None:
    plate = foot_plate_mm(HARDWARE)
    assert plate >= stack(HARDWARE.mount.skin_mm, HARDWARE).wall_mm
    assert plate > HARDWARE.mount.tripod_height_mm + HARDWARE.mount.web_mm
    thick = HARDWARE.replaced(mount=HARDWARE.mount.replaced(tripod_height_mm=12.0))
    assert foot_plate_mm(thick) > 12.0 > plate


def test_four_screws_enter_the_foots_lower_face_mirror_images_in_x() -> None:
    clip = plan_clip(HARDWARE)
    screws = foot_screws(clip, HARDWARE)
    assert screws.shape == (4, 3)
    np.testing.assert_array_equal(screws[:, 2], np.full(4, foot_z_mm(clip, HARDWARE)))
    assert {tuple(screw) for screw in screws} == {tuple(screw * [-1.0, 1.0, 1.0]) for screw in screws}
    assert (clip.slide_y_mm - screws[:, 1] > 0.0).all()
    assert (clip.slide_y_mm - screws[:, 1] < FOOT_DEPTH_MM).all()
