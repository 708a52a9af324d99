"""Hollows behind a plain block, with known floor and number."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import Manifold
from scipy.spatial.transform import Rotation
from shapely import Polygon, box, get_coordinates

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.holder_body import HolderPlan, body_of, one_piece
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.webs import plan_hollows
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_hollows_of_a_block_leave_floor_and_walls_in_any_orientation(seed: int) -> None:
    """60 x 40 x 20 mm: as many hollows at most 12 mm wide as fit; rounding omits none along its sides."""
    length, width, height = 60.0, 40.0, 20.0
    floor, web, widest = HARDWARE.holder.floor_mm, HARDWARE.holder.web_mm, 12.0
    turn = Rotation.random(random_state=seed).as_matrix()
    rig_from_mount = rigid(turn, np.random.default_rng(seed).uniform(-200.0, 200.0, 3))
    block = Manifold.cube((length, width, height)).translate((-length / 2.0, -width / 2.0, -height))
    hollows = plan_hollows(
        block.transform(rig_from_mount[:3]),
        rig_from_mount,
        box(-length / 2.0, -width / 2.0, length / 2.0, width / 2.0),
        np.zeros((0, 2)),
        ((), ()),
        HARDWARE.replaced(holder=HARDWARE.holder.replaced(cell_mm=widest)),
    )
    across, along = (int(np.ceil((side - web) / (widest + web))) for side in (length, width))
    assert len(hollows) == across * along
    mount_from_rig = np.asarray(np.linalg.inv(rig_from_mount), dtype=np.float64)
    for hollow in hollows:
        top, eaves = transform(mount_from_rig, hollow.top), transform(mount_from_rig, hollow.eaves)
        assert top[:, 2] == pytest.approx(floor - height, abs=1e-9)
        assert (np.abs(eaves[:, :2]).max(axis=0) < np.array([length, width]) / 2.0 - web + 1e-9).all()


def on_back(plan: HolderPlan, loop: FloatArray) -> Polygon:
    """A loop (n, 3) projected along the back's normal."""
    return Polygon(loop @ plan.rig_from_mount[:3, :2])


def test_hollows_keep_the_floor_and_webs(device: Device) -> None:
    """No air within the thinnest floor of any hollow, except below the back, and a web between any two."""
    plan = device.holder
    solid = one_piece(body_of(PlanarCsg(), plan), HARDWARE.printer.wall_mm)
    assert len(plan.hollows) > 4
    away = plan.rig_from_mount[:3, 2]
    hollows = [Manifold.hull_points(np.vstack([hollow.eaves, hollow.top])) for hollow in plan.hollows]
    for hollow, body in zip(plan.hollows, hollows, strict=True):
        block = np.vstack([hollow.eaves + 8.0 * (hollow.eaves - hollow.eaves.mean(axis=0)), hollow.top - 9.0 * away])
        air = Manifold.hull_points(block) - solid
        assert air.min_gap(body, 9.0) >= HARDWARE.holder.web_mm - 1e-6
        above = (
            Manifold.hull_points(np.vstack([hollow.eaves, hollow.top - 9.0 * away, hollow.eaves - 9.0 * away])) - solid
        )
        assert above.min_gap(body, 9.0) >= HARDWARE.holder.floor_mm - 1e-6
    for first, second in combinations(hollows, 2):
        assert first.min_gap(second, 5.0) >= HARDWARE.holder.web_mm - 1e-6


def test_a_roof_prints_without_support(device: Device) -> None:
    plan = device.holder
    for hollow in plan.hollows:
        normals, _ = hollow.half_spaces
        # A hollow's roof faces up on the bed, opposite to the mount's z: at most 45 deg from vertical.
        roofs = [normal for normal in normals if -0.99 < normal @ plan.rig_from_mount[:3, 2] < -1e-9]
        assert len(roofs) == len(hollow.eaves)
        assert max(-normal @ plan.rig_from_mount[:3, 2] for normal in roofs) <= np.sin(np.radians(45.0))
        rectangle = get_coordinates(on_back(plan, hollow.top).minimum_rotated_rectangle)
        spans = np.linalg.norm(np.diff(rectangle[:3], axis=0), axis=1)
        assert spans.min() <= HARDWARE.printer.bridge_mm


def floor_sag_um(load_n: float, floor_mm: float) -> float:
    """Sag of the floor over the widest hollow under a distributed force: a square plate with clamped edges.

    w = 0.00126 q a^4 / D, D = E t^3 / (12 (1 - nu^2)), nu = 0.35 (Timoshenko, Theory of Plates and Shells, table 35).
    The roof is thicker than the floor everywhere except at its apex.
    """
    stiffness = HARDWARE.printer.plastic_mpa * floor_mm**3 / (12.0 * (1.0 - 0.35**2))
    return 0.00126 * load_n * HARDWARE.holder.cell_mm**2 / stiffness * 1000.0


def test_the_floor_over_a_hollow_is_stiff() -> None:
    """A thumb (10 N) bends it by less than 3 um, an eighth of a pixel; a floor twice as thick, by an eighth of that."""
    sag = floor_sag_um(10.0, HARDWARE.holder.floor_mm)
    assert sag < 3.0
    assert floor_sag_um(10.0, 2.0 * HARDWARE.holder.floor_mm) == pytest.approx(sag / 8.0)
