"""Long profiles on a small bed."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.parts.bed_placement import Lay, fits, halves, joint_blocks, lay
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.core.values import FloatArray

BED = np.array(HARDWARE.printer.bed_mm[:2])


def straight(length_mm: float, depth_mm: float = 30.0) -> tuple[FloatArray, FloatArray]:
    """A post in four pieces, its outer side to the left."""
    z = np.array([0.0, 0.1, 0.9, 1.0]) * length_mm
    return np.column_stack([np.zeros(4), z]), np.column_stack([np.full(4, -depth_mm), z])


def straight_laid(length_mm: float) -> Lay:
    found = lay(*straight(length_mm), HARDWARE)
    assert found is not None
    return found


def test_what_fits_lies_as_it_is() -> None:
    assert straight_laid(200.0).turn_deg == 0.0


def test_what_is_longer_than_the_bed_lies_askew() -> None:
    inner, outer = straight(250.0)
    laid = straight_laid(250.0)
    assert laid.cut_mm is None
    assert 0.0 < laid.turn_deg < 90.0
    band = Polygon([*inner, *outer[::-1]])
    assert fits(band, laid.turn_deg, BED)
    assert not fits(band, 0.0, BED)
    # Longer than the bed's diagonal less the depth it never fits.
    assert straight_laid(300.0).cut_mm is not None


def test_what_never_fits_is_cut_where_both_halves_do() -> None:
    inner, outer = straight(400.0)
    laid = straight_laid(400.0)
    assert laid.cut_mm is not None
    assert laid.cut_mm == pytest.approx(200.0)
    band = Polygon([*inner, *outer[::-1]])
    parts = halves(band, laid.turn_deg, laid.cut_mm)
    assert [part.area for part in parts] == pytest.approx([200.0 * 30.0] * 2)
    assert all(fits(part, laid.turn_deg, BED) for part in parts)


def test_what_two_halves_do_not_help_lies_no_way() -> None:
    assert lay(*straight(600.0), HARDWARE) is None


def test_a_cut_has_blocks_on_both_sides_at_both_ends() -> None:
    laid = straight_laid(400.0)
    blocks = joint_blocks(laid, 2.4, 50.0, HARDWARE)
    assert len(blocks) == 6
    corners = np.vstack([np.vstack([block.base, block.top]) for block in blocks])
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((-50.0, 50.0))
    assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((-30.0, 0.0))
    # Pins reach half their length into both pieces.
    assert (200.0 - corners[:, 2].min(), corners[:, 2].max() - 200.0) > (HARDWARE.holder.pin_mm[1] / 2.0,) * 2
    assert all(volume_mm3(block) > 0.0 for block in blocks)
    assert joint_blocks(straight_laid(200.0), 2.4, 50.0, HARDWARE) == []


def test_blocks_stay_on_the_straight_of_a_profile_that_leans() -> None:
    """Cut level, the far side of a deep one lies by its bend: a block there once stood out of the skin."""
    lean, depth = np.deg2rad(25.0), 60.0
    along = np.array([-np.sin(lean), np.cos(lean)])
    starts = np.array([(0.0, 0.0), (-depth, -depth * np.tan(lean / 2.0))])
    inner, outer = (
        np.array([(start[0], -60.0), start, start + 90.0 * along, start + 140.0 * along]) for start in starts
    )
    small = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(150.0, 150.0, 220.0)))
    laid = lay(inner, outer, small)
    assert laid is not None
    corners = np.vstack([np.vstack([block.base, block.top])[:, 1:] for block in joint_blocks(laid, 1.6, 50.0, small)])
    reach = (corners - starts[1]) @ along
    assert reach.min() >= -1e-9
    assert reach.max() <= 90.0 + depth
