"""The files of `cad --elastic`: a table of plastics with a recommendation, and the robot's table."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.elasticity import elasticity_report
from mirrorcam.cad.checks.elasticity.device_motions import DeviceMotions
from mirrorcam.cad.checks.elasticity.elasticity_report import (
    figures,
    part_of_limits,
    recommended,
    require_solvable,
    write_elasticity,
)
from mirrorcam.cad.checks.elasticity.errors import all_errors, errors_of
from mirrorcam.cad.checks.elasticity.plastics import PLASTICS
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import GravityTable


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
    large = replace(errors, gravity=replace(errors.gravity, apart_px=0.11))
    assert not figures(large)["elastic.gravity_apart_px"].passed
    small = replace(errors, gravity=replace(errors.gravity, apart_px=0.09))
    assert figures(small)["elastic.gravity_apart_px"].passed
    assert part_of_limits(large) == pytest.approx(1.1)
    for name in ("gravity", "warmth", "creep"):
        turned = replace(small, **{name: replace(getattr(small, name), deg=0.051)})
        failed = {name for name, figure in figures(turned).items() if not figure.passed}
        assert failed == {f"elastic.{'10_k' if name == 'warmth' else name}_deg"}
        assert part_of_limits(turned) == pytest.approx(1.02)


def test_the_plastic_that_moves_images_least_is_recommended_unless_it_swells(
    default_layout: Layout, turning: DeviceMotions
) -> None:
    errors = all_errors(default_layout, turning, 500.0)
    named = {each.plastic.name: part_of_limits(each) for each in errors}
    chosen = recommended(errors)
    assert chosen != "PA-CF"
    assert named[chosen] == min(share for name, share in named.items() if name != "PA-CF")
    assert np.isfinite(list(named.values())).all()


def test_what_cannot_be_solved_is_refused_before_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elasticity_report, "gmsh_program", lambda: "gmsh")
    require_solvable(HARDWARE)
    wooden = HARDWARE.replaced(printer=HARDWARE.printer.replaced(plastic="wood"))
    with pytest.raises(InputError, match=r"printer\.plastic = wood"):
        require_solvable(wooden)
    monkeypatch.setattr(elasticity_report, "gmsh_program", lambda: None)
    with pytest.raises(InputError, match=r"gmsh is not installed"):
        require_solvable(HARDWARE)
