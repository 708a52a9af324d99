"""Glue grooves: narrow, through notches of the rims, and off cuts that they run along."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.back import mount_axes
from mirrorcam.cad.holder.glue import groove_volume, grooves_of, runs_along_cut
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout


def test_a_groove_keeps_away_from_a_cut_that_it_runs_along_and_may_cross_one(default_layout: Layout) -> None:
    axes = mount_axes(default_layout)
    mirror = default_layout.mirrors[4]
    groove = grooves_of(4, default_layout.mirrors, -mirror.normal_in_rig, HARDWARE)[0]
    volume = groove_volume(mirror, groove, HARDWARE)
    corners = np.vstack([volume.base, volume.top])
    low, high = float((corners @ axes[0]).min()), float((corners @ axes[0]).max())
    wall = HARDWARE.printer.wall_mm
    for place, near in ((low - wall - 0.01, False), (low - wall + 0.01, True), (high + 0.9, True), (high + 1.3, False)):
        assert runs_along_cut(mirror, groove, axes, ((place,), ()), HARDWARE) == near
    assert not runs_along_cut(mirror, groove, axes, ((), (float((corners @ axes[1]).mean()),)), HARDWARE)


def test_grooves_are_narrow_and_pass_through_notches_in_the_rims(default_layout: Layout, device: Device) -> None:
    """No point of a mirror's back is further from a land than half a groove, and no rim stands over a groove."""
    plan = device.holder
    assert len(plan.grooves) > 2 * len(default_layout.mirrors)
    rims = [Manifold.hull_points(np.vstack([rim.base, rim.top])) for rim in plan.rims[::2]]
    for groove in plan.grooves:
        widths = np.linalg.norm(groove.base - np.roll(groove.base, 1, axis=0), axis=1)
        area = np.linalg.norm(np.cross(groove.base, np.roll(groove.base, 1, axis=0)).sum(axis=0)) / 2.0
        assert area / widths.max() <= HARDWARE.holder.groove_mm + 1e-9
        hull = Manifold.hull_points(np.vstack([groove.base, groove.top]))
        # A stub of a rim would be thinner than a wall.
        assert not any((hull ^ rim).volume() > 0.0 for rim in rims)
