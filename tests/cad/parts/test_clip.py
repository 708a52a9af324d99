"""The clip: the pupil at the origin, the body in reach of its end, and bodies that it cannot hold."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.parts.clip import ClipPlan, body_box, plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.prisms import box, corners_of, moved, overlap_mm
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_body

THIRD = """
name = "Some webcam"
width_mm = 72.0
height_mm = 31.0
depth_mm = 20.0
lens_x_mm = 6.0
lens_y_mm = -1.5
pupil_behind_front_mm = 5.5
lens_ring_mm = 14.0
lens_protrusion_mm = 0.5
cable_mm = 3.5
cable_x_mm = 10.0
mass_g = 60.0

[held_by]
kind = "lips"
lip_mm = 2.5
"""


def test_the_body_of_the_c920_is_that_of_its_camera() -> None:
    box = body_box(read_body("c920"))
    np.testing.assert_allclose(np.array(Camera.c920().body_mm), [box.low, box.high])


@pytest.fixture(params=["c920", "board_38", "third"])
def hardware(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Hardware]:
    name = request.param
    if name == "third":
        name = str(tmp_path / "third.toml")
        Path(name).write_text(THIRD)
    yield HARDWARE.replaced(camera=read_body(name))


def deepest(plan: ClipPlan, solid: Frustum) -> float:
    return max(overlap_mm(piece, solid) for piece in plan.pieces)


def test_the_body_stands_with_the_pupil_in_the_origin(hardware: Hardware) -> None:
    camera, body = hardware.camera, body_box(hardware.camera)
    lens_from_middle = np.array([camera.lens_x_mm, camera.lens_y_mm, camera.depth_mm / 2.0])
    pupil = (body.low + body.high) / 2.0 + lens_from_middle - np.array([0.0, 0.0, camera.pupil_behind_front_mm])
    np.testing.assert_allclose(pupil, 0.0, atol=1e-12)


def test_the_clip_touches_the_body_and_does_not_cross_it(hardware: Hardware) -> None:
    plan, body = plan_clip(hardware), body_box(hardware.camera)
    assert deepest(plan, body.solid) == pytest.approx(0.0, abs=1e-9)
    # Nothing holds it back but what should: moved against a datum face it would enter that.
    datums = [(0.0, 0.0, -0.1)] if hardware.camera.name.startswith("38") else [(0, 0, 0.1), (0, -0.1, 0), (-0.1, 0, 0)]
    for way in datums:
        assert deepest(plan, moved(body.solid, np.array(way, dtype=float))) == pytest.approx(0.1)


def test_the_body_slides_in_from_the_open_end(hardware: Hardware) -> None:
    camera, plan, body = hardware.camera, plan_clip(hardware), body_box(hardware.camera)
    if camera.held_by.kind == "board":
        pytest.skip("a board is screwed onto its posts from the lens side")
    way = 1.0 + float(np.ptp(corners_of(plan.pieces)[:, 0]))
    assert deepest(plan, box(tuple(body.low), (float(body.high[0]) + way, *body.high[1:]))) < 1e-9
    if camera.hinge_mm:
        high = (camera.hinge_mm / 2.0 + way, 60.0, float(body.low[2]) + camera.hinge_from_back_mm)
        assert deepest(plan, box((-camera.hinge_mm / 2.0, float(body.high[1]), float(body.low[2])), high)) < 1e-9
    half, x = camera.cable_mm / 2.0, camera.cable_x_mm
    cable = box((x - half, -half, plan.bottom_mm - 5.0), (x + half + way, half, float(body.low[2])))
    assert deepest(plan, cable) < 1e-9


def test_the_made_clip_is_one_solid_as_wide_as_planned(hardware: Hardware) -> None:
    plan = plan_clip(hardware)
    part = make_clip(plan)
    assert part.is_valid
    assert len(part.solids()) == 1
    bounds = part.bounding_box()
    assert pytest.approx(plan.from_x_mm) == bounds.min.X
    assert pytest.approx(corners_of(plan.pieces)[:, 0].max()) == bounds.max.X
    assert pytest.approx(plan.slide_y_mm) == bounds.min.Y
    assert pytest.approx(plan.bottom_mm) == bounds.min.Z


def test_set_screws_press_between_what_they_press_against() -> None:
    """Three tips on the back, within the lips' hull in x and within the body in y; each has a hole at its place."""
    plan, body = plan_clip(HARDWARE), body_box(HARDWARE.camera)
    assert len(plan.set_screw_tips) == 3
    assert np.allclose(plan.set_screw_tips[:, 2], body.low[2])
    assert ((plan.set_screw_tips > body.low - 1e-9) & (plan.set_screw_tips < body.high)).all()
    assert np.linalg.matrix_rank(plan.set_screw_tips[1:, :2] - plan.set_screw_tips[0, :2]) == 2
    holes = [cut.mouth[:2] for cut in plan.cuts if isinstance(cut, Bore) and abs(cut.axis[2]) == 1.0]
    for tip in plan.set_screw_tips:
        assert min(float(np.linalg.norm(hole - tip[:2])) for hole in holes) < 1e-9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens_ring_mm": 26.0}, r"lips reach 1\.5 mm over the lens ring \(26 mm across\).*lip_mm at most 1\.5"),
        ({"hinge_mm": 80.0}, r"holds 6\.7 mm of the body beside its hinge, expected at least 10 mm"),
        ({"hinge_from_back_mm": 22.0}, r"wall over the hinge is 1\.7 mm, expected 5\.6 mm"),
        (
            {"height_mm": 18.0, "end_radius_mm": 0.0, "lens_ring_mm": 8.0},
            r"floor beside the cable is 6\.5 mm wide, expected 8 mm",
        ),
    ],
)
def test_a_body_that_cannot_be_held_is_refused_with_the_measure(changes: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plan_clip(HARDWARE.replaced(camera=HARDWARE.camera.replaced(**changes)))
