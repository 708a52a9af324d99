"""The measuring drawing of a camera: every letter and value, without overlaps, within the sheet."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.guide.camera_measures import MEASUREMENTS, draw_camera
from mirrorcam.optics.geometry.camera_body import CameraBody
from mirrorcam.optics.geometry.camera_library import camera_names, read_body
from tests.cad.guide.test_drawing import overlaps


@pytest.mark.parametrize("name", camera_names())
def test_every_camera_of_the_library_has_its_drawing(name: str) -> None:
    body = read_body(name)
    sheet = draw_camera(body)
    assert overlaps(sheet) == []
    border = np.array([(10.0, 10.0), np.array(sheet.size_mm) - 10.0])
    assert all(((box.corners > border[0]) & (box.corners < border[1])).all() for box in sheet.text_boxes)
    texts = [box.text for box in sheet.text_boxes]
    for measurement in MEASUREMENTS:
        assert measurement.letter in texts
        assert f"{getattr(body, measurement.field):g}{' ?' if measurement.field in body.guessed else ''}" in texts
    for letter, value in (("A", body.width_mm), ("B", body.height_mm), ("C", body.depth_mm)):
        assert f"{letter} {value:g}" in texts


def test_letters_and_fields_are_named_once() -> None:
    assert len({measurement.letter for measurement in MEASUREMENTS}) == len(MEASUREMENTS)
    assert len({measurement.field for measurement in MEASUREMENTS}) == len(MEASUREMENTS)
    assert {measurement.field for measurement in MEASUREMENTS} <= set(CameraBody.model_fields)


def test_views_are_to_scale() -> None:
    body = read_body("c920")
    sheet = draw_camera(body)
    (side,) = (line for line, _ in sheet.drawn_lines if len(line) == 5 and np.allclose(line[0], line[-1]))
    outline = max((line for line, _ in sheet.drawn_lines if len(line) > 70), key=lambda line: float(np.ptp(line[:, 0])))
    scale = np.ptp(outline[:, 0]) / body.width_mm
    assert np.ptp(outline[:, 1]) / body.height_mm == pytest.approx(scale)
    assert np.ptp(side, axis=0) / scale == pytest.approx([body.depth_mm, body.height_mm])
