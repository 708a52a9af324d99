"""The stand frame: views at the requested angle above the horizon, and the point at which they aim."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import box, volume_mm3
from mirrorcam.cad.plan.stand import aim_in_rig, design_depths_mm, lean_deg, rig_from_stand, rotated
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout


@pytest.mark.parametrize("look_deg", [-30.0, 0.0, 20.0])
def test_views_look_at_the_requested_angle_above_the_horizon(
    default_layout: Layout, fold_90_layout: Layout, look_deg: float
) -> None:
    hardware = HARDWARE.replaced(back=HARDWARE.back.replaced(look_deg=look_deg))
    for layout, fold_deg in ((default_layout, 120.0), (fold_90_layout, 90.0)):
        lean = lean_deg(layout, hardware)
        assert lean == pytest.approx(fold_deg - 90.0 + look_deg)
        right, forward, up = layout.view_from_rig[2] @ rig_from_stand(lean)
        assert np.degrees(np.arctan2(up, forward)) == pytest.approx(look_deg)
        assert right == pytest.approx(0.0)


def test_a_lean_too_far_is_refused_with_the_angles_that_work(default_layout: Layout) -> None:
    hardware = HARDWARE.replaced(back=HARDWARE.back.replaced(look_deg=45.0))
    with pytest.raises(
        InputError, match=r"lean by 75\.0 deg, expected at most 60 deg: set --look-deg between -90\.0 and"
    ):
        lean_deg(default_layout, hardware)


def test_a_rotated_solid_keeps_its_volume() -> None:
    solid = box((1.0, 2.0, 3.0), (4.0, 6.0, 8.0))
    turned = rotated(solid, rig_from_stand(30.0))
    assert volume_mm3(turned) == pytest.approx(volume_mm3(solid))
    # The stand's z axis leans towards the rig's y.
    np.testing.assert_allclose(rig_from_stand(30.0) @ [0.0, 0.0, 1.0], [0.0, 0.5, np.sqrt(0.75)])


def test_the_views_aim_near_their_axis_at_any_depth(default_layout: Layout) -> None:
    assert design_depths_mm(default_layout, HARDWARE) == (300.0, 500.0)
    assert design_depths_mm(default_layout.replaced(spec=None), HARDWARE) == (500.0,)
    near, far = (default_layout.view_from_rig @ aim_in_rig(default_layout, depth) for depth in (300.0, 500.0))
    assert (near[2], far[2]) == pytest.approx((300.0, 500.0))
    assert abs(far[0]) < 5.0
