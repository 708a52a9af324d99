"""Rays cast from the pupil, against brute force and small steps along rays."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess import chief_rays
from mirrorcam.optics.design.assess.chief_rays import blocked_light, sampled, traced
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

COARSE = 12


def crowded(layout: Layout, seed: int, *, surface: str = "first") -> tuple[Mirror, ...]:
    """The mirrors of a layout with random distances and thicknesses."""
    random = np.random.default_rng(seed)
    mirrors = []
    for mirror in layout.mirrors:
        along, thickness_mm = random.uniform(0.75, 1.2), random.uniform(0.5, 6.0)
        centre, outline = mirror.virtual_centre_in_rig_mm * along, mirror.outline_in_rig_mm * along
        if surface == "first":
            mirrors.append(
                Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=outline, thickness_mm=thickness_mm)
            )
        else:
            mirrors.append(Mirror.second_surface(centre, outline, thickness_mm=thickness_mm, refractive_index=1.49))
    return tuple(mirrors)


def walked(mirrors: tuple[Mirror, ...], lit: int, occluder: int, depth_mm: float) -> dict[str, float]:
    """Part of the light that a mirror blocks, found by walking along rays and asking at each step which side of it
    the point is on: from its corners, not from its faces."""
    mirror, other = mirrors[lit], mirrors[occluder]
    met, leaving, directions = traced(mirror, sampled(mirror.usable_normalized, COARSE))
    forward = directions[:, 1] > 1e-9
    met, leaving, directions = met[forward], leaving[forward], directions[forward]
    end = leaving + directions * ((depth_mm - leaving[:, 1]) / directions[:, 1])[:, None]
    # There are no mirrors beyond the first third of the outgoing ray.
    steps = np.linspace(0.0, 1.0, 2001)[:, None, None]
    frame, flat = other.rig_from_plane, other.outline_in_plane_mm
    turns = 1.0 if Polygon(flat).exterior.is_ccw else -1.0
    below, above = other.back_mm, other.front_mm
    found = {}
    for leg, starts, ends in (("in", np.zeros_like(met), met), ("out", leaving, leaving + (end - leaving) / 3.0)):
        points = (starts + steps * (ends - starts) - frame[:3, 3]) @ frame[:3, :3]
        inside = (points[..., 2] > below) & (points[..., 2] < above)
        for a, b in zip(flat, np.roll(flat, -1, axis=0), strict=True):
            edge, to = b - a, points[..., :2] - a
            inside &= turns * (edge[0] * to[..., 1] - edge[1] * to[..., 0]) > 0
        found[leg] = float(inside.any(axis=0).mean())
    return found


@pytest.mark.parametrize("surface", ["first", "second"])
def test_what_is_stopped_is_what_a_walk_along_the_rays_meets(free_layout: Layout, surface: str) -> None:
    mirrors = crowded(free_layout, 5, surface=surface)
    found: dict[tuple[int, int, str], float] = {
        (b.mirror, b.occluder, b.leg): b.fraction for b in blocked_light(mirrors, 500.0, COARSE)
    }
    pairs = [(i, j) for i, j in ((0, 1), (1, 0), (4, 1), (1, 4), (4, 7), (7, 4), (3, 4), (4, 5), (6, 3), (2, 6))]
    met = 0
    for lit, occluder in pairs:
        for leg, fraction in walked(mirrors, lit, occluder, 500.0).items():
            assert found.get((lit, occluder, leg), 0.0) == pytest.approx(fraction, abs=0.02)
            met += fraction > 0
    assert met >= 3


@pytest.mark.parametrize("surface", ["first", "second"])
def test_culling_loses_nothing(default_layout: Layout, surface: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mirrors = crowded(default_layout, 8, surface=surface)
    culled = blocked_light(mirrors, 500.0)
    seen = []

    def everything(points: FloatArray, planes: FloatArray, bodies: FloatArray) -> FloatArray:
        seen.append(len(bodies))
        return np.ones(len(bodies), dtype=bool)

    monkeypatch.setattr(chief_rays, "_may_meet", everything)
    assert blocked_light(mirrors, 500.0) == culled
    assert len(seen) == 2 * len(mirrors)
    assert culled


def test_light_reflected_away_from_the_scene_is_ignored(default_layout: Layout) -> None:
    # Rotated by 180 degrees about the vertical, the central mirror reflects light away from the scene.
    centre = default_layout.mirrors[4]
    flip = np.diag([-1.0, -1.0, 1.0])
    away = Mirror(
        virtual_centre_in_rig_mm=centre.virtual_centre_in_rig_mm @ flip,
        outline_in_rig_mm=centre.outline_in_rig_mm @ flip,
    )
    # Its light, extended backwards to the depth of the scene, would meet this mirror.
    beyond = centre.moved(np.eye(3), np.array([0.0, 60.0, 0.0]))
    assert all(found.leg == "in" for found in blocked_light((away, beyond), 500.0) if found.mirror == 0)


def test_light_goes_as_far_as_the_depth_along_the_view_axis() -> None:
    # A small mirror across the chief ray of the central mirror, 200 mm from the pupil along another axis than +y.
    mirror = faceted_parabola(DesignSpec(fold_deg=90.0)).mirrors[4]
    axis = np.array([0.0, np.sin(np.radians(110.0)), np.cos(np.radians(110.0))])
    _, (leaving,), (direction,) = traced(mirror, mirror.outline_normalized.mean(axis=0, keepdims=True))
    middle = leaving + direction * (200.0 - leaving @ axis) / (direction @ axis)
    across, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, axis[2], -axis[1]])
    corners = middle + 15.0 * np.array([-across - down, across - down, across + down, -across + down])
    screen = Mirror.from_plane(middle, axis, outline_in_rig_mm=corners)
    legs = [
        {found.leg for found in blocked_light((mirror, screen), depth_mm, view_axis=axis) if found.mirror == 0}
        for depth_mm in (199.0, 202.0)
    ]
    assert legs == [set(), {"out"}]
