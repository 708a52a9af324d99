"""Light from the surroundings on a mirror, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.checks.surrounding_light import BEFORE_MM, check_surrounding_light
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror


@pytest.fixture
def layout() -> Layout:
    """One mirror across the rig's z, at z = 50 mm; its reflecting side looks along -z."""
    outline = np.array([(-5.0, -5.0, 50.0), (5.0, -5.0, 50.0), (5.0, 5.0, 50.0), (-5.0, 5.0, 50.0)])
    mirror = Mirror(virtual_centre_in_rig_mm=np.array([0.0, 0.0, 100.0]), outline_in_rig_mm=outline)
    return Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror,))


def share(layout: Layout, solid: Manifold) -> float:
    (check,) = check_surrounding_light(layout, {"solid": solid}).values()
    assert check.limit is None
    return check.value


def test_a_bare_mirror_has_all_of_it_and_a_half_shaded_one_half(layout: Layout) -> None:
    behind = Manifold.cube((300.0, 300.0, 5.0), center=True).translate((0.0, 0.0, 60.0))
    assert share(layout, behind) == 1.0
    beside = Manifold.cube((300.0, 600.0, 600.0)).translate((0.01, -300.0, -400.0))
    assert share(layout, beside + behind) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("height", [10.0, 30.0])
def test_a_hood_leaves_the_square_of_the_sine_of_its_opening(layout: Layout, height: float) -> None:
    """A tube of radius 20 mm: a Lambertian mirror's middle sees sin^2 of half its opening."""
    outer, inner = (Manifold.cylinder(height, r, circular_segments=360) for r in (22.0, 20.0))
    tube = (outer - inner).translate((0.0, 0.0, 50.0 - height))
    half = np.arctan2(20.0, height - BEFORE_MM)
    assert share(layout, tube) == pytest.approx(np.sin(half) ** 2, abs=0.01)
