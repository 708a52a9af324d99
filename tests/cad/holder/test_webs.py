"""Hollows behind a plain block, whose floor and number are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import Manifold
from scipy.spatial.transform import Rotation
from shapely import box

from mirrorcam.cad.holder.webs import plan_hollows
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.transforms import rigid, transform


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_hollows_of_a_block_leave_its_floor_and_walls_however_it_lies(seed: int) -> None:
    """60 x 40 x 20 mm: hollows at most 12 mm wide are as many as fit; rounding leaves out none along its sides."""
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
