"""Layouts and built holders for the CAD tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from build123d import Box, BuildPart, Locations, Part

from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.part_export import mass_properties, write_step, write_stl
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.cad.parabolas import parabola
from tests.shared import built_once, no_slicer

Built = tuple[Layout, Path, dict[str, Metric]]
COVERED = HARDWARE.replaced(holder=HARDWARE.holder.replaced(dust_cover=True))


def flat_pair(*, gap_mm: float, width_mm: float = 30.0, height_mm: float = 20.0, thickness_mm: float = 1.0) -> Layout:
    """Two rectangular mirrors side by side in the one plane y = z - 80, which folds the view by 90 deg."""
    point, right, up = np.array([0.0, 0.0, 80.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)

    def mirror(left_mm: float) -> Mirror:
        corners = [(left_mm, 0.0), (left_mm + width_mm, 0.0), (left_mm + width_mm, height_mm), (left_mm, height_mm)]
        outline: FloatArray = np.array([point + a * right + (b - height_mm / 2.0) * up for a, b in corners])
        return Mirror.from_plane(
            point, np.array([0.0, 1.0, -1.0]), outline_in_rig_mm=outline, thickness_mm=thickness_mm
        )

    mirrors = (mirror(-gap_mm / 2.0 - width_mm), mirror(gap_mm / 2.0))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=mirrors)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests of a complete device as slow: its parts are built, sliced and checked for a minute."""
    for item in items:
        if "built_default" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def make_parabola() -> Callable[..., Layout]:
    return parabola


@pytest.fixture(scope="session")
def make_flat_pair() -> Callable[..., Layout]:
    return flat_pair


@pytest.fixture(scope="session")
def built_default(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The default 3x3 first-surface layout, the folder of its files, and its checks."""
    out = built_once(tmp_path_factory, "default_parts", lambda folder: build_parts(default_layout, folder, workers=2))
    return default_layout, out, read_checks(out)


def read_checks(folder: Path) -> dict[str, Metric]:
    """The checks that a build wrote."""
    checks = json.loads((folder / "checks.json").read_text(encoding="utf-8"))
    return {name: Metric(**metric) for name, metric in checks.items()}


@pytest.fixture(scope="session")
def small_layout() -> Layout:
    """2x2 second-surface mirrors, 2 mm thick, planned and built in less time than the default device."""
    return parabola(2, 2, surface="second", thickness_mm=2.0, gap_mm=2.0)


@pytest.fixture(scope="session")
def built_second_surface(small_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The small layout of second-surface mirrors with a dust cover, built by one process; its parts are not sliced.

    They are stored in the folder `kept` next to the files' folder.
    """

    def build(folder: Path) -> None:
        with no_slicer():
            build_parts(small_layout, folder / "device", hardware=COVERED, results=folder / "kept")

    out = built_once(tmp_path_factory, "second_surface_parts", build) / "device"
    return small_layout, out, read_checks(out)


@pytest.fixture(scope="session")
def device(default_layout: Layout) -> Device:
    """The plans of the default 3x3 layout's device."""
    return plan_device(default_layout, HARDWARE)


@pytest.fixture(scope="session")
def covered_device(default_layout: Layout) -> Device:
    """The plans of the default 3x3 layout's device with a dust cover."""
    return plan_device(default_layout, COVERED)


@dataclass(frozen=True)
class Block:
    """The plan of a box between two corners (3,) in the rig frame, mm."""

    low: FloatArray
    high: FloatArray


def make_box(plan: Block) -> Part:
    """The box as a solid."""
    with BuildPart() as body, Locations(tuple((plan.low + plan.high) / 2.0)):
        Box(*(plan.high - plan.low))
    solid = body.part
    assert solid is not None
    solid.label = "block"
    return solid


@pytest.fixture(scope="session")
def block() -> PartPlan:
    """A box of 60 x 30 x 10 mm with its lowest corner at (1, 2, 3), printed on its face towards -y."""
    low = np.array([1.0, 2.0, 3.0])
    return PartPlan(
        name="block",
        title="Block",
        number="MC-99",
        plan=Block(low, low + np.array([60.0, 30.0, 10.0])),
        make=make_box,
        print_from_rig=np.array(
            [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -2.0], [0.0, 0.0, 0.0, 1.0]]
        ),
        explode_mm=np.array([0.0, 0.0, 25.0]),
        rgb=(0.2, 0.4, 0.6),
    )


@pytest.fixture(scope="session")
def built_block(block: PartPlan, tmp_path_factory: pytest.TempPathFactory) -> BuiltPart:
    """The box with its files."""
    folder = tmp_path_factory.mktemp("parts")
    solid = block.make(block.plan)
    write_step(folder / "block.step", solid)
    write_stl(folder / "block.stl", solid)
    return BuiltPart.of(block, folder, mass_properties(solid, 1.24), {})
