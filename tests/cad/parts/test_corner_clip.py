"""The corner for bodies that no tray holds: six points on the body, ties or screws that hold it, and its refusals."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import Y_UP, with_base_at
from mirrorcam.cad.assembly.components import camera_solid, tessellated
from mirrorcam.cad.checks.clashes import overlap_mm3
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.load_checks import check_nest
from mirrorcam.cad.checks.part_checks import check_overhangs
from mirrorcam.cad.parts.camera_box import body_box, error_jacobian
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.corner_clip import MIN_ENGAGED
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening, Hardware
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.camera_body import CameraBody
from mirrorcam.optics.geometry.layout import Layout

LIPS = {"kind": "lips", "lip_mm": 1.0}
TWO_M3 = {"kind": "threads", "thread": "M3", "thread_depth_mm": 4.0, "threads_mm": ((-10.0, 8.0), (10.0, 8.0))}


def cube(side_mm: float, held_by: dict[str, Any] = LIPS, **changes: Any) -> Hardware:
    """The hardware of a cube camera with a lens barrel."""
    values = {
        "name": f"cube of {side_mm:g} mm",
        **dict.fromkeys(("width_mm", "height_mm", "depth_mm"), side_mm),
        "pupil_behind_front_mm": 1.0,
        "lens_ring_mm": 0.6 * side_mm,
        "lens_protrusion_mm": 2.0,
        "cable_mm": 2.0,
        "mass_g": 3.0 * (side_mm / 10.0) ** 3,
        "held_by": held_by,
    }
    return HARDWARE.replaced(camera=CameraBody.model_validate(values | changes))


def dslr(held_by: dict[str, Any] = LIPS) -> Hardware:
    """A body of 130 x 100 x 75 mm and 700 g, which a tray's leaves would have to be thicker than long to hold."""
    sizes = {"width_mm": 130.0, "height_mm": 100.0, "depth_mm": 75.0, "lens_ring_mm": 65.0, "lens_protrusion_mm": 60.0}
    return cube(100.0, held_by, pupil_behind_front_mm=-30.0, cable_mm=5.0, mass_g=700.0, **sizes)


THREADED = [
    cube(29.0, TWO_M3),
    cube(29.0, TWO_M3 | {"thread": "M2", "thread_depth_mm": 3.0}),
    dslr({"kind": "threads", "thread": "1/4-20 UNC", "thread_depth_mm": 6.0, "threads_mm": ((0.0, 37.0),)}),
]
# Leaves for M4 screws would be strained too far, so that ties hold this body.
WIDE_M4 = HARDWARE.replaced(screw=Fastening(thread="M4"))
STRAPPED = [*(cube(side) for side in (10.0, 15.0, 20.0, 25.0, 30.0)), dslr(), WIDE_M4]


@pytest.mark.parametrize("hardware", [*STRAPPED, *THREADED], ids=lambda hardware: hardware.camera.name)
def test_six_points_locate_the_body_and_the_clip_prints_without_support(hardware: Hardware) -> None:
    plan, body = plan_clip(hardware), body_box(hardware.camera)
    assert plan.nest is not None
    assert plan.tray is None
    # Every point is on a face of the body, and the six of them fix it.
    inside = np.clip(plan.nest.points, body.low, body.high)
    np.testing.assert_allclose(plan.nest.points, inside, atol=1e-9)
    assert np.linalg.cond(error_jacobian(plan.nest)) < 1e4
    mesh = tessellated(make_clip(plan))
    clip, camera = solid_of(mesh), solid_of(tessellated(camera_solid(hardware.camera)))
    assert overlap_mm3(clip, camera) == 0.0
    assert clip.min_gap(camera, 1.0) < 1e-3
    mesh.apply_transform(with_base_at(Y_UP, plan.slide_y_mm))
    checks = check_overhangs(mesh, solid_of(mesh), hardware.printer)
    assert [name for name, check in checks.items() if not check.passed and name != "bridged_mm2"] == []


@pytest.mark.parametrize("hardware", STRAPPED, ids=lambda hardware: hardware.camera.name)
def test_ties_pass_beside_the_body_and_clear_the_slides_screws(hardware: Hardware) -> None:
    plan, body = plan_clip(hardware), body_box(hardware.camera)
    clip = solid_of(tessellated(make_clip(plan)))
    assert len(plan.straps_mm) >= 1
    for left, right, z in plan.straps_mm:
        assert left < body.low[0] and right > body.high[0]
        assert body.low[2] < z < body.high[2]
        for x in (left, right):
            tie = manifold3d.Manifold.cube((1.2, 40.0, 2.5), center=True).translate((x, plan.slide_y_mm, z))
            assert (clip ^ tie).is_empty()
            assert np.abs(np.abs(x) - plan.slide_x_mm) > hardware.screw.insert_hole_mm / 2.0 + 1.0


@pytest.mark.parametrize("hardware", THREADED, ids=lambda hardware: hardware.camera.held_by.thread)
def test_screws_engage_in_the_bodys_threads_with_their_heads_in_the_wall(
    hardware: Hardware, default_layout: Layout
) -> None:
    plan, held_by = plan_clip(hardware), hardware.camera.held_by
    assert held_by.kind == "threads"
    assert len(plan.screws) == len(held_by.threads_mm)
    side = float(body_box(hardware.camera).low[1])
    for screw in plan.screws:
        tip = screw.head[1] + screw.length_mm
        assert screw.head[1] > plan.slide_y_mm
        if abs(screw.head[0]) < 2.0:
            assert screw.head[1] > plan.slide_y_mm + plan.rib_mm
        assert tip - side == pytest.approx(screw.engaged_mm)
        assert MIN_ENGAGED * thread_of(held_by.thread).diameter_mm <= screw.engaged_mm < held_by.thread_depth_mm
    assert check_nest(plan, default_layout, hardware)["camera_clip.camera_thread"].passed


@pytest.mark.parametrize(
    ("hardware", "message"),
    [
        (cube(100.0, mass_g=9000.0), r"ties round the body would hold .*held_by[.]kind = .threads."),
        (cube(29.0, TWO_M3 | {"thread_depth_mm": 1.0}), r"M3 thread is 1 mm deep, .* expected at least 2\.7 mm"),
        (cube(29.0, TWO_M3 | {"threads_mm": ((0.0, 40.0),)}), r"thread at 0 mm .* 40 mm behind the front, expected it"),
        (cube(10.0, cable_mm=9.0), r"cable leaves -?0\.\d mm for the fence .* upside down, or give cable_y_mm"),
    ],
)
def test_a_body_that_the_corner_cannot_hold_is_refused_with_the_remedy(hardware: Hardware, message: str) -> None:
    with pytest.raises(InputError, match=message):
        plan_clip(hardware)
