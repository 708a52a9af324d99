"""Checks of the nest: the default passes, and what fails is seen to fail."""

from __future__ import annotations

from mirrorcam.cad.assembly.pieces import camera_solid, tessellated
from mirrorcam.cad.checks.camera_nest import check_nest, check_rest
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout


def test_the_default_camera_is_held_and_repeats_within_what_the_guide_says(default_layout: Layout) -> None:
    checks = check_nest(plan_clip(HARDWARE), default_layout, HARDWARE)
    assert [name for name, check in checks.items() if check.passed is False] == []
    assert 0.02 < checks["camera_clip.reclamped_mm"].value < 0.05
    assert 0.04 < checks["camera_clip.reclamped_deg"].value < 0.1
    assert 1.0 < checks["camera_clip.reclamped_px"].value < 3.0


def test_a_heavier_camera_than_planned_lets_go_and_a_brittle_plastic_is_bent_too_far(default_layout: Layout) -> None:
    clip = plan_clip(HARDWARE)
    heavy = HARDWARE.replaced(camera=HARDWARE.camera.replaced(mass_g=300.0))
    brittle = HARDWARE.replaced(printer=HARDWARE.printer.replaced(plastic_strain=0.002))
    assert not check_nest(clip, default_layout, heavy)["camera_clip.contact_n"].passed
    assert not check_nest(clip, default_layout, brittle)["camera_clip.leaf_strain"].passed


def test_a_board_has_no_points_to_check_but_repeats_as_its_holes_let_it(default_layout: Layout) -> None:
    board = HARDWARE.replaced(camera=read_body("board_38"))
    checks = check_nest(plan_clip(board), default_layout, board)
    assert {name: check for name, check in checks.items() if check.limit is not None} == {}
    assert 0.03 < checks["camera_clip.reclamped_mm"].value < 0.1
    assert checks["camera_clip.reclamped_between_views_px"].value < checks["camera_clip.reclamped_px"].value


def test_a_lens_too_far_from_its_rest_fails() -> None:
    hardware = HARDWARE.replaced(camera=read_body("pi_hq_cs"))
    clip = solid_of(tessellated(make_clip(plan_clip(hardware))))
    camera = solid_of(tessellated(camera_solid(hardware.camera)))
    check = check_rest(clip, camera, hardware)["camera_clip.rest_gap_mm"]
    assert check.passed
    assert check.value > 0.05
    assert not check_rest(clip, camera.translate((0.0, 0.2, 0.0)), hardware)["camera_clip.rest_gap_mm"].passed
    assert not check_rest(None, camera, hardware)["camera_clip.rest_gap_mm"].passed
    assert check_rest(clip, camera, HARDWARE) == {}
