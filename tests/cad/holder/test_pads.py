"""Three pads under every mirror: far apart, clear of grooves, cuts and light, with the mirror's centre between them."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import LineString, Point, Polygon, box

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.glue import Groove
from mirrorcam.cad.holder.pads import GAP_MM, min_altitude_mm, pad_shapes, pad_solid, plan_pads
from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import seat_height_mm
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

RADIUS = HARDWARE.holder.pad_mm / 2.0
NO_CUTS: Cuts = ((), ())


def rectangle(width_mm: float, height_mm: float) -> Mirror:
    """A mirror normal to the rig's z, 50 mm from the pupil: its plane's x is the rig's."""
    corners = [(-width_mm, -height_mm), (width_mm, -height_mm), (width_mm, height_mm), (-width_mm, height_mm)]
    outline = np.array([(x / 2.0, y / 2.0, 50.0) for x, y in corners])
    return Mirror(virtual_centre_in_rig_mm=np.array([0.0, 0.0, 100.0]), outline_in_rig_mm=outline)


def pads_of(mirror: Mirror, grooves: tuple[Groove, ...] = (), cuts: Cuts = NO_CUTS) -> FloatArray:
    free = Polygon(mirror.outline_in_plane_mm)
    return plan_pads("0-1", mirror, free, grooves, np.eye(3), cuts, HARDWARE)


def test_pads_of_a_rectangle_are_at_two_corners_and_the_middle_of_the_far_side() -> None:
    """No triangle about a rectangle's centre has a smallest altitude above the rectangle's shorter side."""
    mirror = rectangle(40.0, 20.0)
    pads = pads_of(mirror)
    inset = 20.0 - 2.0 * (RADIUS + HARDWARE.fit.free_mm)
    assert min_altitude_mm(pads[None])[0] == pytest.approx(inset, abs=0.05)
    room = Polygon(mirror.outline_in_plane_mm).buffer(-HARDWARE.fit.free_mm + 1e-6)
    assert all(room.contains(Polygon(shape)) for shape in pad_shapes(pads, HARDWARE))
    assert Polygon(pads).contains(Point(0.0, 0.0))


def test_the_smallest_altitude_is_on_the_longest_side() -> None:
    triangles = np.array([[(0.0, 0.0), (4.0, 0.0), (0.0, 3.0)], [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]])
    np.testing.assert_allclose(min_altitude_mm(triangles), [12.0 / 5.0, 0.0])


def test_pads_keep_away_from_grooves_and_cuts() -> None:
    mirror = rectangle(40.0, 20.0)
    bare = pads_of(mirror)
    at = float(bare[np.argmax(bare[:, 0]), 0])
    groove = Groove(at, np.array([(at - 0.5, -15.0), (at + 0.5, -15.0), (at + 0.5, 15.0), (at - 0.5, 15.0)]))
    cut = float(bare[np.argmin(bare[:, 0]), 0])
    pads = pads_of(mirror, (groove,), ((cut,), ()))
    frame = mirror.rig_from_plane
    across = np.column_stack([pads, np.zeros(3)]) @ frame[:3, :3].T + frame[:3, 3]
    assert np.abs(across[:, 0] - cut).min() >= RADIUS + HARDWARE.printer.wall_mm - 1e-6
    slot = Polygon(groove.shape)
    assert min(Polygon(shape).distance(slot) for shape in pad_shapes(pads, HARDWARE)) >= GAP_MM - 1e-6
    assert LineString(bare).distance(slot) == 0.0


def test_pads_of_a_device_reach_from_inside_the_seat_to_the_mirrors_back(
    default_layout: Layout, device: Device
) -> None:
    assert len(device.holder.pads) == 3 * len(default_layout.mirrors)
    for mirror, pads in zip(default_layout.mirrors, device.holder.pads_of_mirrors, strict=True):
        for pad in pads:
            heights = np.vstack([pad.base, pad.top]) @ mirror.normal_in_rig + mirror.distance_mm
            assert heights.min() == pytest.approx(seat_height_mm(mirror, HARDWARE) - GAP_MM)
            assert heights.max() == pytest.approx(mirror.back_mm)
            others = [
                v
                for index, group in enumerate(device.holder.keep_outs)
                for v in group
                if default_layout.mirrors[index] is not mirror
            ]
            assert not any(volume.contains(np.vstack([pad.base, pad.top])).any() for volume in others)


def test_a_pad_is_as_wide_as_the_table_says() -> None:
    (shape,) = pad_shapes(np.array([(3.0, 4.0)]), HARDWARE)
    np.testing.assert_allclose(np.linalg.norm(shape - (3.0, 4.0), axis=1), RADIUS)
    assert pad_solid(rectangle(10.0, 10.0), shape, HARDWARE).base.shape == (8, 3)


def test_a_mirror_without_space_for_three_pads_is_refused_by_its_name() -> None:
    with pytest.raises(InputError, match=r"mirror 0-1 of 5\.0 x 4\.0 mm has no space for three pads of 2 mm"):
        pads_of(rectangle(5.0, 4.0))
    with pytest.raises(InputError, match=r"smaller holder\.glue_pad_mm"):
        mirror = rectangle(40.0, 20.0)
        plan_pads("0-1", mirror, box(5.0, -10.0, 20.0, 10.0), (), np.eye(3), NO_CUTS, HARDWARE)
