"""Layouts that gravity deforms: the table's motions of mirrors, and the resulting shifts of images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import GravityTable, MirrorMotion, image_shifts_px, layout_in_pose

DOWN = np.array([0.0, 1.0, 0.0])


@pytest.fixture
def table(default_layout: Layout) -> GravityTable:
    """Along the camera's axis by 10 um for gravity along it, and a rotation by 0.2 mrad about x for gravity along y."""
    shift, turn = np.zeros((3, 3)), np.zeros((3, 3))
    shift[2, 2], turn[0, 1] = 0.01, 2e-4
    motion = MirrorMotion(shift_mm=shift, turn_rad=turn, plane_mm=np.zeros((3, 3)))
    return GravityTable(mirrors=dict.fromkeys(default_layout.mirror_names, motion), plastic="PLA")


def test_mirrors_move_by_the_difference_of_gravities(default_layout: Layout, table: GravityTable) -> None:
    gravity = np.array([0.3, 0.5, -0.8])
    bent = layout_in_pose(default_layout, table, gravity)
    for before, after in zip(default_layout.mirrors, bent.mirrors, strict=True):
        moved = after.outline_in_rig_mm.mean(axis=0) - before.outline_in_rig_mm.mean(axis=0)
        np.testing.assert_allclose(moved, [0.0, 0.0, -0.008], atol=1e-9)
        turned = np.cross([1e-4, 0.0, 0.0], before.normal_in_rig)
        np.testing.assert_allclose(after.normal_in_rig - before.normal_in_rig, turned, atol=1e-8)
    same = layout_in_pose(default_layout, table, gravity, gravity)
    for before, after in zip(default_layout.mirrors, same.mirrors, strict=True):
        np.testing.assert_allclose(after.virtual_centre_in_rig_mm, before.virtual_centre_in_rig_mm, atol=1e-9)
    back = layout_in_pose(bent, table, np.zeros(3), gravity)
    for before, after in zip(default_layout.mirrors, back.mirrors, strict=True):
        np.testing.assert_allclose(after.virtual_centre_in_rig_mm, before.virtual_centre_in_rig_mm, atol=1e-5)


def test_a_bent_layout_keeps_no_figures_of_the_one_before(default_layout: Layout, table: GravityTable) -> None:
    bent = layout_in_pose(default_layout, table, DOWN)
    assert (bent.kind, bent.metrics, bent.verdict) == ("as-built", {}, {})
    assert bent.camera == default_layout.camera


def test_images_rotate_by_twice_the_mirrors_rotation(default_layout: Layout, table: GravityTable) -> None:
    bent = layout_in_pose(default_layout, table, DOWN)
    shifts = image_shifts_px(default_layout, bent, 500.0)
    assert len(shifts) == len(default_layout.mirrors)
    middle = shifts[default_layout.central_index][-1]
    assert np.linalg.norm(middle) == pytest.approx(4e-4 * default_layout.camera.fy_px, rel=0.3)
    for still in image_shifts_px(default_layout, default_layout, 500.0):
        np.testing.assert_array_equal(still, 0.0)


def test_a_table_is_the_same_from_its_file(table: GravityTable, tmp_path: Path) -> None:
    table.save(tmp_path / "gravity.json")
    loaded = GravityTable.load(tmp_path / "gravity.json")
    assert loaded.text() == table.text()
    (tmp_path / "gravity.json").write_text('{"schema": "mirrorcam.gravity/1"}')
    with pytest.raises(InputError, match="mirrors"):
        GravityTable.load(tmp_path / "gravity.json")


def test_other_mirrors_and_impossible_gravities_are_refused(default_layout: Layout, table: GravityTable) -> None:
    one = table.replaced(mirrors={"0-0": table.mirrors["0-0"]})
    with pytest.raises(InputError, match=r"gravity table: mirrors 0-0, .* 0-0, 0-1"):
        layout_in_pose(default_layout, one, DOWN)
    for gravity in (np.zeros(2), np.array([0.0, np.nan, 0.0]), 9.81 * DOWN):
        with pytest.raises(InputError, match="expected a vector of 3 numbers"):
            layout_in_pose(default_layout, table, gravity)
