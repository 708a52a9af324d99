"""Glue grooves: narrow, through notches of the rims, and clear of parallel cuts."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold
from shapely import box

from mirrorcam.cad.holder.back import mount_axes
from mirrorcam.cad.holder.glue import bead_mm, glue_amount, glue_mm3, groove_solid, grooves_of, runs_along_cut
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout


def test_a_groove_may_cross_a_cut_but_is_not_beside_a_parallel_one(default_layout: Layout) -> None:
    axes = mount_axes(default_layout)
    mirror = default_layout.mirrors[4]
    groove = grooves_of(4, default_layout.mirrors, -mirror.normal_in_rig, HARDWARE)[0]
    volume = groove_solid(mirror, groove, HARDWARE)
    corners = np.vstack([volume.base, volume.top])
    low, high = float((corners @ axes[0]).min()), float((corners @ axes[0]).max())
    wall = HARDWARE.printer.wall_mm
    for place, near in (
        (low - wall - 0.01, False),
        (low - wall + 0.01, True),
        (high + wall - 0.01, True),
        (high + wall + 0.01, False),
    ):
        assert runs_along_cut(mirror, groove, axes, ((place,), ()), HARDWARE) == near
    assert not runs_along_cut(mirror, groove, axes, ((), (float((corners @ axes[1]).mean()),)), HARDWARE)


def test_grooves_are_narrow_and_pass_through_notches_in_the_rims(default_layout: Layout) -> None:
    """No point of a mirror's back is further from a land than half a groove, and no rim is over a groove."""
    plan = plan_holder(default_layout, HARDWARE)
    assert len(plan.grooves) > 2 * len(default_layout.mirrors)
    rims = [Manifold.hull_points(np.vstack([rim.base, rim.top])) for rim in plan.rims[::2]]
    for groove in plan.grooves:
        widths = np.linalg.norm(groove.base - np.roll(groove.base, 1, axis=0), axis=1)
        area = np.linalg.norm(np.cross(groove.base, np.roll(groove.base, 1, axis=0)).sum(axis=0)) / 2.0
        assert area / widths.max() <= HARDWARE.holder.groove_mm + 1e-9
        hull = Manifold.hull_points(np.vstack([groove.base, groove.top]))
        # A stub of a rim would be thinner than a wall.
        assert not any((hull ^ rim).volume() > 0.0 for rim in rims)


def test_the_glue_fills_the_gap_but_for_the_pads() -> None:
    """A seat of 30 x 20 mm and two pads of 2 x 3 mm, one of them half outside it."""
    bond = HARDWARE.holder.bond_mm
    pads = [np.array([(x, 4.0), (x + 2.0, 4.0), (x + 2.0, 7.0), (x, 7.0)]) for x in (9.0, 29.0)]
    assert glue_mm3(box(0.0, 0.0, 30.0, 20.0), pads, HARDWARE) == pytest.approx((600.0 - 9.0) * bond)
    assert glue_amount((600.0, 756.0)) == "1.4 ml"
    assert glue_amount((31.0,)) == "0.031 ml"


def test_a_bead_pressed_to_the_bond_is_as_wide_as_the_land_of_a_groove() -> None:
    assert np.pi / 4.0 * bead_mm(HARDWARE) ** 2 / HARDWARE.holder.bond_mm == pytest.approx(
        HARDWARE.holder.groove_pitch_mm
    )


@pytest.mark.parametrize(
    ("gap_mm", "end_mm"),
    [(0.3, 0.3 - 0.12), (1.9, 1.9 - 0.24), (2.15, (2.15 - 0.9) / 2), (2.5, (2.5 - 0.9) / 2), (4.0, 2.3)],
)
def test_a_groove_leaves_no_fin_between_its_end_and_the_slit_before_a_column(
    default_layout: Layout, gap_mm: float, end_mm: float
) -> None:
    """The filler round a mirror ends 2.1 mm outside its outline: it adjoins a nearer column, or leaves a slit.

    The other mirror has grooves likewise: the two meet, or leave a wall.
    """
    assert not 0.0 < gap_mm - 2.0 * end_mm < HARDWARE.printer.wall_mm - 1e-9
    mirror, normal = default_layout.mirrors[4], -default_layout.mirrors[4].normal_in_rig
    frame = mirror.rig_from_plane
    square = np.array([(-12.0, -12.0), (12.0, -12.0), (12.0, 12.0), (-12.0, 12.0)]) @ frame[:3, :2].T + frame[:3, 3]
    first, second = (mirror.replaced(outline_in_rig_mm=square + shift * frame[:3, 1]) for shift in (0.0, 24.0 + gap_mm))
    np.testing.assert_allclose(first.rig_from_plane, frame, atol=1e-9)
    grooves = grooves_of(0, [first, second], normal, HARDWARE)
    assert len(grooves) > 0
    for groove in grooves:
        assert groove.shape[:, 1].max() - 12.0 == pytest.approx(end_mm, abs=1e-6)
        assert groove.shape[:, 1].min() + 12.0 == pytest.approx(-2.3, abs=1e-6)
