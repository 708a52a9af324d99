"""A small part with known edges, and a device with few components and its documents."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from build123d import Box, BuildPart, Cylinder, Locations, Mode, Part

from mirrorcam.cad.assembly.bill import bill_of
from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.components import Component, components_of, mass_of
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.guide.assembly_guide import write_guide
from mirrorcam.cad.guide.device_page import write_page
from mirrorcam.cad.guide.device_pictures import pictures_of
from mirrorcam.cad.guide.picture_views import DevicePicture
from mirrorcam.cad.mirrors.sheet_files import write_dxf
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.assembly_files import write_glb
from mirrorcam.cad.write.bill_of_materials import write_bom
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout


@dataclass(frozen=True)
class Made:
    folder: Path
    device: Device
    parts: tuple[BuiltPart, ...]
    components: tuple[Component, ...]
    pictures: tuple[DevicePicture, ...]
    plates: Mapping[str, Sequence[str]] = field(default_factory=dict)


CHECKS = {
    "mirror_holder.wall_mm": Metric(value=1.31, unit="mm", limit=1.2, lower_is_better=False),
    "mount.overhang_mm2": Metric(value=0.0, unit="mm2", limit=0.5),
    "device.rays_blocked": Metric(value=0.0, unit="", limit=0.0),
    "device.mass_g": Metric(value=467.0, unit="g"),
}


def make(layout: Layout, hardware: Hardware, folder: Path) -> Made:
    """All that is fast to make: parts as meshes, without solids on disk."""
    device = plan_device(layout, hardware)
    parts = []
    for part in parts_of(device):
        path = folder / "parts" / f"{part.name}.stl"
        write_stl(path, part.make(part.plan))
        parts.append(
            BuiltPart(
                name=part.name,
                title=part.title,
                number=part.number,
                folder=folder / "parts",
                rgb=part.rgb,
                print_from_rig=part.print_from_rig,
                explode_mm=part.explode_mm,
                mass=mass_of(trimesh.load_mesh(path), 1.24),
                checks={},
            )
        )
    components = components_of(device, parts)
    return Made(folder, device, tuple(parts), components, pictures_of(device, parts, components))


@pytest.fixture(scope="session")
def made(make_parabola: Callable[..., Layout], tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A small device with its model, parts list, guide and page."""
    layout = make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0)
    device = make(layout, HARDWARE, tmp_path_factory.mktemp("documents"))
    write_glb(device.folder / "assembly.glb", device.components, device.device.back.rig_from_stand)
    for sheet in plan_sheets(layout, HARDWARE.cutting):
        write_dxf(device.folder / "mirrors" / f"{sheet.stem}.dxf", sheet)
    write_bom(device.folder, bill_of(device.device, device.parts, plan_sheets(layout, HARDWARE.cutting)))
    write_documents(device)
    return device


def guide_of(
    folder: Path, device: Device, parts: Sequence[BuiltPart], components: Sequence[Component], **more: Any
) -> None:
    """Write the guide with the bill of the same device."""
    bill = bill_of(device, parts, plan_sheets(device.layout, device.hardware.cutting))
    write_guide(folder, device, parts, components, bill, **more)


def write_documents(made: Made, checks: dict[str, Metric] = CHECKS) -> None:
    guide_of(made.folder, made.device, made.parts, made.components)
    write_page(made.folder, made.device, made.parts, made.plates, made.pictures, checks)


@dataclass(frozen=True)
class BlockPlan:
    """A block with two through holes along z, and its dimensions."""

    size_mm: tuple[float, float, float]
    hole_mm: float
    apart_mm: float

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        top = self.size_mm[2] / 2.0
        x = self.apart_mm / 2.0
        holes = tuple(
            Hole(np.array([side * x, 0.0, top]), np.array([0.0, 0.0, 1.0]), self.hole_mm, "through") for side in (-1, 1)
        )
        return (*holes, Length(np.array([[-x, 0.0, top], [x, 0.0, top]])))


def make_block(plan: BlockPlan) -> Part:
    with BuildPart() as block:
        Box(*plan.size_mm)
        with Locations((-plan.apart_mm / 2.0, 0.0), (plan.apart_mm / 2.0, 0.0)):
            Cylinder(plan.hole_mm / 2.0, plan.size_mm[2], mode=Mode.SUBTRACT)
    assert block.part is not None
    return block.part


def block_part(size_mm: tuple[float, float, float] = (60.0, 30.0, 10.0), hole_mm: float = 6.0) -> PartPlan:
    return PartPlan(
        name="block",
        title="Block",
        number="MC-99",
        plan=BlockPlan(size_mm, hole_mm, 40.0),
        make=make_block,
        print_from_rig=np.eye(4),
        explode_mm=np.zeros(3),
        rgb=(0.3, 0.4, 0.5),
    )


@pytest.fixture
def block() -> Callable[..., PartPlan]:
    return block_part
