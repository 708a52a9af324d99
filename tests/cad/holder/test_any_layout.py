"""Properties of every holder, over random layouts: one closed solid, seats in place, no light blocked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from build123d import GeomType, Part
from manifold3d import Error, Manifold, Mesh64
from shapely import LineString, Polygon, build_area, multilinestrings, set_precision

from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.holder.holder_solid import make_holder
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import camera_cone, reflected_beam
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror


def random_layout(seed: int, make_parabola: Callable[..., Layout]) -> Layout:
    """A faceted parabola of random size; the sheet is thin enough for its mirrors and gaps."""
    random = np.random.default_rng(seed)
    rows, cols = random.integers(1, 4, 2)
    thickness = float(random.choice([1.0, 2.0, 3.0]))
    return make_parabola(
        int(rows),
        int(max(cols, 2 if rows == 1 else 1)),
        scale_mm=float(random.uniform(60.0, 120.0)),
        gap_mm=float(random.uniform(1.0, 2.0)) + 0.6 * thickness,
        surface=str(random.choice(["first", "second"])),
        thickness_mm=thickness,
    )


def seat_area_mm2(part: Part, mirror: Mirror, behind_mm: float) -> float:
    """Area of a mirror's outline on all faces of a part at a depth behind its back, within 1 um and 0.001 deg."""
    frame, height_mm = mirror.rig_from_plane, mirror.back_mm - behind_mm
    outline = Polygon(mirror.outline_in_plane_mm)
    area = 0.0
    for face in part.faces().filter_by(GeomType.PLANE):
        if np.array(tuple(face.normal_at())) @ frame[:3, 2] < np.cos(np.radians(0.001)):
            continue
        edges = (np.array([tuple(edge @ 0), tuple(edge @ 1)]) for edge in face.edges())
        lines = np.array([(edge - frame[:3, 3]) @ frame[:3, :3] for edge in edges])
        if np.abs(lines[:, :, 2] - height_mm).max() < 1e-3:
            # Ends meet up to rounding; loops inside loops are holes.
            area += (
                build_area(set_precision(multilinestrings([LineString(line[:, :2]) for line in lines]), 1e-9))
                .intersection(outline)
                .area
            )
    return area


def assert_sound(layout: Layout, plan: HolderPlan, part: Part, folder: Path) -> None:
    assert len(part.solids()) == 1
    assert part.is_valid
    write_stl(folder / "holder.stl", part)
    mesh = trimesh.load_mesh(folder / "holder.stl")
    assert mesh.is_volume
    body = Manifold(Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64)))
    assert body.status() == Error.NoError
    assert len(body.decompose()) == 1
    # An STL rounds to 32 bits; a B-rep's cylinders are round.
    assert body.volume() == pytest.approx(part.volume, rel=1e-4)
    dark = HARDWARE.replaced(fit=HARDWARE.fit.replaced(light_mm=0.1))
    for index, mirror in enumerate(layout.mirrors):
        for light in (camera_cone(mirror, layout.camera.pupil, dark), reflected_beam(layout, index, dark)):
            assert (body ^ Manifold.hull_points(np.vstack([light.base, light.top]))).volume() < 1e-3
        floor = seat_area_mm2(part, mirror, HARDWARE.holder.bond_mm)
        outline = Polygon(mirror.outline_in_plane_mm).area
        assert floor == pytest.approx(plan.planned_cover[index] * outline, rel=1e-6)
        octagon = np.sqrt(8.0) * (HARDWARE.holder.pad_mm / 2.0) ** 2
        assert seat_area_mm2(part, mirror, 0.0) == pytest.approx(3.0 * octagon, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_random_layout(make_parabola: Callable[..., Layout], tmp_path: Path, seed: int) -> None:
    layout = random_layout(seed, make_parabola)
    plan = plan_holder(layout, HARDWARE)
    assert_sound(layout, plan, make_holder(plan), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *range(3, 30)])
def test_many_random_layouts(make_parabola: Callable[..., Layout], tmp_path: Path, seed: int) -> None:
    layout = random_layout(seed, make_parabola)
    plan = plan_holder(layout, HARDWARE)
    assert_sound(layout, plan, make_holder(plan), tmp_path)
