"""Adjustable mirrors: the check finds an obstacle to a tilted mirror, a weak spring, and a covered screw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.checks.adjustment import check_adjustment, poses
from mirrorcam.cad.checks.clashes import check_clashes
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.reach import check_insertion, check_tool_reach
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.seats import Frustum, mirror_prism
from mirrorcam.core.figures.figure_texts import TIMES
from mirrorcam.optics.geometry.transforms import transform
from tests.cad.guide.conftest import guide_of, make
from tests.cad.holder.screwed import pair, planned, with_screws

Solids = dict[str, Manifold]


def hull(frustum: Frustum) -> Manifold:
    return Manifold.hull_points(np.vstack([frustum.base, frustum.top]))


def device() -> Any:
    """The parts of a device that the check reads."""
    return SimpleNamespace(layout=pair(), hardware=with_screws(), holder=planned())


def solids() -> Solids:
    """Plate, carriers and mirrors in place."""
    layout, plan = pair(), planned()
    frame = np.array(plan.rig_from_mount)
    plate = hull(plan.slab)
    for head in plan.heads:
        frame[:3, 3] = head - 2.0 * frame[:3, 2]
        plate -= Manifold.cylinder(3.0, 3.8).transform(frame[:3])
    parts = {"mirror_holder": plate}
    for name, mirror, carrier in zip(layout.mirror_names, layout.mirrors, plan.carriers, strict=True):
        parts |= {f"mirror_{name}": hull(mirror_prism(mirror)), f"carrier_{name}": hull(carrier.body)}
    return parts


def block_at(point: np.ndarray, size_mm: float) -> Manifold:
    return Manifold.cube((size_mm, size_mm, size_mm), True).translate(tuple(point.tolist()))


def test_a_device_as_planned_passes_and_a_glued_one_has_no_such_checks() -> None:
    checks = check_adjustment(device(), solids(), {})
    assert all(check.passed for check in checks.values())
    assert 0.0 < checks["mirrors.adjust_gap_mm"].value < 1.0
    glued = device()
    glued.holder = None
    assert check_adjustment(glued, solids(), {}) == {}


def beside_mirror(parts: Solids) -> Solids:
    """A block that only the tilted mirror meets."""
    mirror = pair().mirrors[0]
    corner = mirror.outline_in_rig_mm[0] + (mirror.front_mm + 0.3) * mirror.normal_in_rig
    return parts | {"block": block_at(corner + 1.0 * mirror.normal_in_rig, 1.6)}


def over_a_screw(parts: Solids) -> Solids:
    plan = planned()
    return parts | {"block": block_at(plan.heads[2] + 12.0 * plan.rig_from_mount[:3, 2], 8.0)}


@pytest.mark.parametrize(
    ("spoilt", "check"),
    [(beside_mirror, "mirrors.adjust_clash_mm3"), (over_a_screw, "mirrors.adjust_tool_clash_mm3")],
)
def test_an_obstacle_to_a_tilted_mirror_or_the_driver_fails(spoilt: Callable[[Solids], Solids], check: str) -> None:
    parts = spoilt(solids())
    failed = {name for name, each in check_adjustment(device(), parts, {}).items() if not each.passed}
    assert failed == {check}


def test_supports_can_block_the_driver_too() -> None:
    extra = {"wrist": over_a_screw({})["block"]}
    assert check_adjustment(device(), solids(), extra)["mirrors.adjust_tool_clash_mm3"].value > 1.0


def test_a_larger_tilt_fails_and_a_weak_spring_does() -> None:
    far = device()
    far.hardware = far.hardware.replaced(holder=far.hardware.holder.replaced(adjust_deg=3.0))
    assert not check_adjustment(far, solids(), {})["mirrors.adjust_clash_mm3"].passed
    weak = device()
    weak.holder = replace(planned(), adjuster=replace(planned().adjuster, min_force_n=0.1))
    failed = {name for name, each in check_adjustment(weak, solids(), {}).items() if not each.passed}
    assert failed == {"mirrors.spring_least_n"}


def test_poses_tilt_by_the_angle_about_axes_in_the_back() -> None:
    carrier = planned().carriers[0]
    frame = carrier.rig_from_back
    motions = list(poses(carrier, 1.0, 0.3))
    assert len(motions) == 16
    for motion in motions:
        turned = motion[:3, :3] @ frame[:3, 2]
        assert np.degrees(np.arccos(turned @ frame[:3, 2])) == pytest.approx(1.0)
        moved = transform(motion, frame[:3, 3]) - frame[:3, 3]
        assert abs(moved @ frame[:3, 2]) == pytest.approx(0.3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_a_small_device_on_screws_passes_the_checks_of_its_parts_together(kind: str, tmp_path: Path) -> None:
    made = make(pair(), with_screws(kind), tmp_path)
    items = purchased_items(made.device)
    parts = {component.name: solid_of(component.mesh) for component in made.components}
    assert {part.name for part in made.parts if part.name.startswith("carrier")} == {"carrier_0-0", "carrier_0-1"}
    assert [part.number for part in made.parts if part.name.startswith("carrier")] == ["MC-08", "MC-09"]
    checks = {
        **check_adjustment(made.device, parts, {}),
        **check_tool_reach(items, parts),
        **check_insertion(items, parts),
        **check_clashes(parts, made.device.hardware.fit.press_mm),
    }
    assert {name: check for name, check in checks.items() if not check.passed} == {}
    guide_of(tmp_path, made.device, made.parts, made.components)
    guide = (tmp_path / "guide.md").read_text(encoding="utf-8")
    size = made.device.hardware.holder.spring.size
    assert f"6 {TIMES} [M3 x" in guide
    assert f"6 {TIMES} [{size} compression springs" in guide
    assert isinstance(made.device.holder, ScrewedHolderPlan)
    assert f"strip {made.device.holder.adjuster.gap_mm:.1f} mm thick" in guide
