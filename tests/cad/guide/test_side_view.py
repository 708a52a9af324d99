"""The side view: the device stands on its desk, and its rays end at the depths of the design or at the desk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.guide.side_view import DESK_MM, MIDDLE_MM, draw_side_view, look_text
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.stand import design_depths_mm
from tests.cad.guide.conftest import Made


def test_a_direction_is_named_by_its_angle() -> None:
    assert [look_text(angle) for angle in (0.0, -30.0, 12.5)] == ["level", "30° down", "12.5° up"]


def test_level_views_pass_over_the_desk_and_the_drawing_has_the_design_depths(made: Made) -> None:
    sheet = draw_side_view(made.device, made.components)
    texts = [box.text for box in sheet.text_boxes]
    assert "Where the device looks: level" in texts
    assert {f"{depth:g}" for depth in design_depths_mm(made.device.layout, made.device.hardware)} <= set(texts)
    (desk,) = (line for line, width in sheet.drawn_lines if width == DESK_MM)
    (middle,) = (line for line, width in sheet.drawn_lines if width == MIDDLE_MM)
    points = np.vstack([line for line, _ in sheet.drawn_lines])
    assert np.ptp(desk[:, 1]) == 0.0
    # From the lens to a mirror and on to the right, over the desk; only the desk's hatching is below it.
    assert len(middle) == 3
    assert middle[-1, 0] == pytest.approx(points[:, 0].max())
    assert middle[:, 1].min() > desk[0, 1]
    assert points[:, 1].min() == pytest.approx(desk[0, 1], abs=2.1)
    width, height = sheet.size_mm
    corners = np.vstack([box.corners for box in sheet.text_boxes] + [points])
    assert (corners > 0.0).all()
    assert (corners < [width, height]).all()


def test_a_device_on_an_arm_has_its_arm_and_no_desk(made: Made) -> None:
    hardware = made.device.hardware.replaced(back=back_of("iso9409"))
    back = plan_back(made.device.clip, made.device.mount, hardware)
    sheet = draw_side_view(replace(made.device, hardware=hardware, back=back), made.components)
    assert not [line for line, width in sheet.drawn_lines if width == DESK_MM]
