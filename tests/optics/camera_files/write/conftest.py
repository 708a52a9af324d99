"""Layouts to export, points that their mirrors show, and where those appear in the flipped frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write import VirtualCamera, virtual_cameras, write_exports
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane

TOLERANCE_PX = 1e-6


@dataclass(frozen=True)
class Case:
    """A layout, its exported cameras, and per mirror points (n, 3) in rig, mm, with their flipped pixels (n, 2)."""

    layout: Layout
    views: tuple[VirtualCamera, ...]
    points_in_rig: tuple[FloatArray, ...]
    flipped_px: tuple[FloatArray, ...]


def seen_through(layout: Layout, number: int, count: int = 40) -> FloatArray:
    """Points (n, 3) in rig, mm, that a mirror shows, 250 mm to 3 m from its virtual centre."""
    random = np.random.default_rng(number)
    weights = random.dirichlet(np.ones(len(layout.mirrors[number].outline_in_rig_mm)), count)
    on_mirror = weights @ layout.mirrors[number].apparent.outline_in_rig_mm
    rays = on_mirror / np.linalg.norm(on_mirror, axis=1, keepdims=True)
    return layout.mirrors[number].apparent.reflect(rays * random.uniform(250.0, 3000.0, (count, 1)))


def sideways_layout() -> Layout:
    """Two mirrors at the sides of a camera that looks past them at the scene: frames are flipped left-right."""
    camera = Camera(
        width_px=640,
        height_px=480,
        fx_px=500.0,
        fy_px=498.0,
        cx_px=322.2,
        cy_px=236.1,
        distortion=[-0.05, 0.02, 8e-4, -1.5e-3, 0.0],
    )
    corners = np.array([[0.3, -0.3], [0.55, -0.3], [0.55, 0.3], [0.3, 0.3]])
    mirrors = []
    for side in (-1.0, 1.0):
        centre = np.array([side * 160.0, 5.0, 20.0])
        mirrors.append(
            Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=intersect_plane(corners * [side, 1.0], centre))
        )
    return Layout(rows=1, cols=2, camera=camera, mirrors=tuple(mirrors), view_from_rig=np.eye(3))


def without_k3(layout: Layout) -> Layout:
    return layout.replaced(camera=layout.camera.replaced(distortion=[*layout.camera.distortion[:4], 0.0]))


@pytest.fixture(scope="session", params=["parabola", "crooked", "sideways"])
def case(request: pytest.FixtureRequest, parabola_layout: Layout, crooked_layout: Layout) -> Case:
    layout = {"parabola": parabola_layout, "crooked": crooked_layout, "sideways": sideways_layout()}[request.param]
    points = tuple(seen_through(layout, number) for number in range(len(layout.mirrors)))
    flipped = []
    for number, points_in_rig in enumerate(points):
        pixels = layout.project(points_in_rig, number)
        assert np.isfinite(pixels).all()
        if request.param == "sideways":
            flipped.append(np.column_stack([layout.camera.width_px - 1 - pixels[:, 0], pixels[:, 1]]))
        else:
            flipped.append(np.column_stack([pixels[:, 0], layout.camera.height_px - 1 - pixels[:, 1]]))
    return Case(layout, virtual_cameras(layout), points, tuple(flipped))


@pytest.fixture(scope="session")
def folder(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The exports of a layout, with two pictures."""
    out = tmp_path_factory.mktemp("exports")
    camera = case.layout.camera
    frame = np.random.default_rng(0).integers(1, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    for name in ("a", "b"):
        write_image(out / f"{name}.png", frame)
    write_exports(case.layout, out / "exports", [out / "a.png", out / "b.png"])
    return out / "exports"
