"""Taking a device apart: a foot at right angles to the lens axis covers the key of the camera's screw."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mirrorcam.cad.assembly.build_steps import STEPS
from mirrorcam.cad.checks.taking_apart import check_taking_apart
from mirrorcam.cad.plan.back_table import DeskBack
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.guide.conftest import Made, guide_of, make

NUMBERS = {step.name: number for number, step in enumerate(STEPS, start=1)}


@pytest.fixture(scope="module")
def by_look_deg(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> dict[float, Made]:
    """Devices on a foot that leans so that the views are level, and on one at right angles to the lens axis."""
    return {
        look: make(default_layout, HARDWARE.replaced(back=DeskBack(look_deg=look)), tmp_path_factory.mktemp("apart"))
        for look in (0.0, -30.0)
    }


@pytest.mark.parametrize("look_deg", [0.0, -30.0])
def test_the_foot_comes_off_first_where_it_covers_the_camera_screws(
    by_look_deg: dict[float, Made], look_deg: float
) -> None:
    built = by_look_deg[look_deg]
    undone, checks = check_taking_apart(built.device, built.components)
    assert checks["device.steps_not_undone"].value == 0
    covered = look_deg < 0.0
    assert undone["camera"] == (("back",) if covered else ())
    assert undone["back"] == undone["clip"] == undone["holder"] == ()
    (built.folder / "mirrors").mkdir(exist_ok=True)
    guide_of(built.folder, built.device, built.parts, built.components, undone_first=undone)
    text = (built.folder / "guide.md").read_text(encoding="utf-8")
    sentence = f"first take off the desk foot (step {NUMBERS['back']})"
    assert text.count(sentence) == (2 if covered else 0)


def test_where_the_foot_cannot_come_off_the_clip_does(by_look_deg: dict[float, Made]) -> None:
    """A plate below the foot covers its screws: one step cannot be undone, and the camera leaves with its clip."""
    built = by_look_deg[-30.0]
    foot = next(component for component in built.components if component.name == "adapter_desk")
    below = foot.mesh.copy()
    below.apply_translation(-8.0 * built.device.mount.foot.up_in_rig)
    cover = replace(foot, name="adapter_cover", mesh=below)
    undone, checks = check_taking_apart(built.device, (*built.components, cover))
    assert "back" not in undone
    assert undone["camera"] == ("clip",)
    assert checks["device.steps_not_undone"].value == 1
