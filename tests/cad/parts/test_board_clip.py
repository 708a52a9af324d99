"""Boards on posts: every screw in its post, the board clear of the wall, and no slope beyond the slide."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import Y_UP, standing
from mirrorcam.cad.assembly.pieces import camera_solid, tessellated
from mirrorcam.cad.checks.clashes import common_mm3
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.overhangs import overhangs
from mirrorcam.cad.parts.board_clip import REST_DEG, REST_TO_MM
from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.values import InputError
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


def test_a_heavy_lens_rests_on_two_faces_that_its_tie_draws_it_onto() -> None:
    """Both faces are half the play of the board's holes off the barrel, and keep off the board and its screws."""
    hardware = HARDWARE.replaced(camera=read_body("pi_hq_cs"))
    body, plan = hardware.camera, plan_clip(hardware)
    assert body.held_by.kind == "board"
    assert body.rest_mm is not None
    assert len(plan.pieces) == len(plan_clip(without_rest()).pieces) + 2
    left, right = plan.pieces[-2:]
    for piece, side in ((left, -1.0), (right, 1.0)):
        normals, offsets = piece.half_spaces
        towards = np.array([-side * np.sin(np.deg2rad(REST_DEG)), np.cos(np.deg2rad(REST_DEG)), 0.0])
        (face,) = np.flatnonzero(normals @ towards > 1.0 - 1e-9)
        assert -offsets[face] == pytest.approx(body.lens_ring_mm / 2.0 + body.held_by.play_mm / 2.0)
        corners = np.vstack([piece.base, piece.top])
        assert corners[:, 2].min() - body.pupil_behind_front_mm == pytest.approx(body.rest_mm[0])
        assert corners[:, 2].max() == pytest.approx(plan.top_mm)
        heads = np.array(body.held_by.holes_mm) - [side * REST_TO_MM, 0.0]
        assert np.abs(heads[:, 0]).min() > 0.95 * body.held_by.screw_mm


def without_rest() -> Hardware:
    return HARDWARE.replaced(camera=read_body("pi_hq_cs").replaced(rest_mm=None))


def test_a_barrel_that_would_be_inside_the_wall_is_refused() -> None:
    wide = read_body("pi_hq_cs").replaced(lens_ring_mm=40.0)
    with pytest.raises(InputError, match=r"rest for the lens would begin \d+\.\d mm inside its wall"):
        plan_clip(HARDWARE.replaced(camera=wide))
