"""Boards on posts: every screw in its post, the board clear of the wall, and no slope beyond the slide."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.bought_solids import camera_solid
from mirrorcam.cad.assembly.catalogue import Y_UP, standing
from mirrorcam.cad.assembly.pieces import tessellated
from mirrorcam.cad.checks.clashes import common_mm3
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.overhangs import overhangs
from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.camera_library import camera_names, read_body

BOARDS = [name for name in camera_names() if read_body(name).held_by.kind == "board"]


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_a_board_rests_on_its_posts_and_its_clip_prints_on_its_slide(name: str, kind: str) -> None:
    hardware = HARDWARE.replaced(camera=read_body(name), screw=HARDWARE.screw.replaced(kind=kind))
    plan = plan_clip(hardware)
    mesh, camera = tessellated(make_clip(plan)), solid_of(tessellated(camera_solid(hardware.camera)))
    clip = solid_of(mesh)
    assert common_mm3(clip, camera) == 0.0
    assert clip.min_gap(camera, 1.0) < 1e-4
    mesh.apply_transform(standing(Y_UP, plan.slide_y_mm))
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-6)
    hanging, _, longest = overhangs(mesh, solid_of(mesh), hardware.printer)
    assert (hanging, longest <= hardware.printer.bridge_mm) == (0.0, True)


def test_every_hole_of_the_board_has_its_own_in_a_post() -> None:
    hardware = HARDWARE.replaced(camera=read_body("board_38"))
    plan, body = plan_clip(hardware), body_box(hardware.camera)
    assert hardware.camera.held_by.kind == "board"
    pilots = [cut for cut in plan.cuts if isinstance(cut, Bore) and cut.radius_mm == pytest.approx(0.8)]
    np.testing.assert_allclose([cut.mouth[:2] for cut in pilots], hardware.camera.held_by.holes_mm)
    np.testing.assert_allclose(plan.board_screws[:, 2], body.high[2])
    assert plan.nest is None
