"""Errors of known motions in degrees and pixels, and the robot's table of these motions.

The files of `cad --elastic`: a table of plastics with a recommendation, and the robot's table.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.elasticity import elasticity_report
from mirrorcam.cad.checks.elasticity.device_motions import PLASTICS, DeviceMotions, Plastic
from mirrorcam.cad.checks.elasticity.elasticity_report import (
    RESIDUAL_FRACTION,
    TEMPERATURE_RISE_K,
    all_errors,
    errors_of,
    figures,
    gravity_table,
    largest_ratio_to_limit,
    recommended,
    require_solvable,
    write_elasticity,
)
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import GravityTable, layout_in_pose

PLAIN = Plastic("plain", 1000.0, 1.0, 50e-6, 60.0, 0.5, 0.0, "of this test")


def test_a_turn_of_all_mirrors_moves_all_images_alike(default_layout: Layout, turning: DeviceMotions) -> None:
    errors = errors_of(default_layout, turning, 500.0, PLAIN)
    assert errors.gravity.deg == pytest.approx(np.degrees(1e-3))
    # A mirror doubles a rotation; pixels are larger in angle at the edges of the picture.
    straight = 2e-3 * default_layout.camera.fy_px
    assert 0.8 * straight < errors.gravity.px < 1.8 * straight
    assert errors.gravity.residual_px < 0.02 * errors.gravity.px
    assert errors.creep == errors.gravity.times(0.5)
    assert errors.corrected == errors.gravity.times(RESIDUAL_FRACTION)


def test_modulus_and_density_act_as_in_closed_form(default_layout: Layout, turning: DeviceMotions) -> None:
    plain, dense, stiff = (
        errors_of(default_layout, turning, 500.0, plastic)
        for plastic in (PLAIN, replace(PLAIN, density_g_per_cm3=3.0), replace(PLAIN, modulus_mpa=4000.0))
    )
    assert dense.gravity.deg == pytest.approx(2.0 * plain.gravity.deg)
    assert stiff.gravity.deg == pytest.approx(plain.gravity.deg / 4.0)
    assert stiff.heating == plain.heating


def test_warmth_scales_the_device_and_turns_nothing(default_layout: Layout, turning: DeviceMotions) -> None:
    """A point at a depth appears nearer by the strain, through its parallax."""
    heating = errors_of(default_layout, turning, 500.0, PLAIN).heating
    assert heating.deg == 0.0
    centres = default_layout.virtual_centres_in_rig_mm
    farthest = np.linalg.norm(centres, axis=1).max()
    assert 0.0 < heating.px < 3.0 * TEMPERATURE_RISE_K * 50e-6 * farthest / 400.0 * default_layout.camera.fx_px


def test_the_robots_table_moves_a_layout_as_the_motions_say(default_layout: Layout, turning: DeviceMotions) -> None:
    table = gravity_table(default_layout, turning, PLASTICS[0])
    gravity = np.array([0.1, -0.3, 0.9])
    bent = layout_in_pose(default_layout, table, gravity)
    for name, before, after in zip(default_layout.mirror_names, default_layout.mirrors, bent.mirrors, strict=True):
        moved = after.virtual_centre_in_rig_mm - before.virtual_centre_in_rig_mm
        np.testing.assert_allclose(moved, table.mirrors[name].plane_mm @ gravity, atol=2e-4)
        assert np.linalg.norm(moved) > 1e-2


def test_files_state_every_plastic_and_what_a_robot_needs(
    device: Device, turning: DeviceMotions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(elasticity_report, "device_motions", lambda *_: turning)
    checks = write_elasticity(tmp_path, device)
    text = (tmp_path / "elasticity.md").read_text(encoding="utf-8")
    assert [line.split()[1] for line in text.splitlines() if line.startswith("| P") or line.startswith("| A")] == [
        plastic.name for plastic in PLASTICS
    ]
    assert "Recommended: " in text
    assert set(GravityTable.load(tmp_path / "robot" / "gravity.json").mirrors) == set(device.layout.mirror_names)
    assert {name for name, check in checks.items() if check.limit is not None} == {
        f"elastic.{name}_{figure}" for name in ("gravity", "10_k", "creep") for figure in ("deg", "apart_px")
    }
    stated = json.loads((tmp_path / "elasticity.json").read_text(encoding="utf-8"))
    assert list(stated["plastics"]) == [plastic.name for plastic in PLASTICS]
    assert stated["recommended"] in text
    assert set(stated["mirrors_10_k_deg"]) == set(device.layout.mirror_names)
    for name in ("gravity", "10_k", "creep"):
        assert stated["device"][name]["deg"] == checks[f"elastic.{name}_deg"].value
        assert stated["device"][name]["apart_px"] == checks[f"elastic.{name}_apart_px"].value
    assert stated["device"]["passed"] == all(check.passed for check in checks.values())


def test_figures_fail_past_their_limits(default_layout: Layout, turning: DeviceMotions) -> None:
    errors = errors_of(default_layout, turning, 500.0, PLASTICS[0])
    errors = replace(errors, gravity=replace(errors.gravity, deg=0.04))
    large = replace(errors, gravity=replace(errors.gravity, residual_px=0.11))
    assert not figures(large)["elastic.gravity_apart_px"].passed
    small = replace(errors, gravity=replace(errors.gravity, residual_px=0.09))
    assert figures(small)["elastic.gravity_apart_px"].passed
    assert largest_ratio_to_limit(large) == pytest.approx(1.1)
    for name in ("gravity", "heating", "creep"):
        turned = replace(small, **{name: replace(getattr(small, name), deg=0.051)})
        failed = {name for name, figure in figures(turned).items() if not figure.passed}
        assert failed == {f"elastic.{'10_k' if name == 'heating' else name}_deg"}
        assert largest_ratio_to_limit(turned) == pytest.approx(1.02)


def test_the_plastic_that_moves_images_least_is_recommended_unless_it_swells(
    default_layout: Layout, turning: DeviceMotions
) -> None:
    errors = all_errors(default_layout, turning, 500.0)
    named = {each.plastic.name: largest_ratio_to_limit(each) for each in errors}
    chosen = recommended(errors)
    assert chosen != "PA-CF"
    assert named[chosen] == min(share for name, share in named.items() if name != "PA-CF")
    assert np.isfinite(list(named.values())).all()


def test_unsolvable_hardware_is_refused_before_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elasticity_report, "gmsh_program", lambda: "gmsh")
    require_solvable(HARDWARE)
    wooden = HARDWARE.replaced(printer=HARDWARE.printer.replaced(plastic="wood"))
    with pytest.raises(InputError, match=r"printer\.plastic = wood"):
        require_solvable(wooden)
    monkeypatch.setattr(elasticity_report, "gmsh_program", lambda: None)
    with pytest.raises(InputError, match=r"gmsh is not installed"):
        require_solvable(HARDWARE)
