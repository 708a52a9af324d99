"""Sub-images of the whole pupil: against rays from the rim of the pupil, and of many mirrors against each alone."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import Polygon

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil, served_by
from mirrorcam.optics.geometry.whole_pupil import whole_pupil_outline, whole_pupil_outlines
from tests.optics.rim_rays import wholly_served

PUPIL = Pupil(1.8, 450.0)


def test_within_its_outline_the_whole_pupil_is_served(default_layout: Layout) -> None:
    shares = []
    for mirror in default_layout.mirrors:
        outline = whole_pupil_outline(mirror, PUPIL)
        middles = (outline + np.roll(outline, -1, axis=0)) / 2.0
        for border in (outline, middles):
            np.testing.assert_allclose(
                served_by(mirror, border, PUPIL.focus_mm).distance.min(axis=1), PUPIL.radius_mm, atol=1e-3
            )
        shares.append(Polygon(outline).area / Polygon(mirror.outline_normalized).area)
    assert 0.8 < min(shares) < max(shares) < 0.95
    np.testing.assert_array_equal(whole_pupil_outline(mirror, Pupil()), mirror.usable_normalized)


@pytest.mark.parametrize(("thickness_mm", "within_px"), [(0.0, 0.05), (1.5, 8.0)])
def test_it_holds_the_pixels_all_of_whose_rays_meet_the_mirror(
    default_layout: Layout, thickness_mm: float, within_px: float
) -> None:
    """Through glass as in the apparent mirror of the chief ray, which deviates at the borders, to both sides."""
    for number, mirror in enumerate(default_layout.mirrors):
        if thickness_mm:
            mirror = mirror.replaced(surface="second", thickness_mm=thickness_mm)
        outline = Polygon(whole_pupil_outline(mirror, PUPIL))
        low, high = np.reshape(outline.bounds, (2, 2))
        chief = np.random.default_rng(number).uniform(low - 0.005, high + 0.005, (3000, 2))
        served = wholly_served(mirror, chief, PUPIL)
        inside = shapely.contains_xy(outline, *chief.T)
        assert 0.4 < served.mean() < 0.99
        assert inside.mean() == pytest.approx(served.mean(), abs=0.02)
        far = chief[inside != served]
        assert (shapely.distance(outline.exterior, shapely.points(far)) * 1360.4 < within_px).all()


def test_a_mirror_narrower_than_the_blur_serves_no_whole_pupil(default_layout: Layout) -> None:
    assert whole_pupil_outline(default_layout.mirrors[0], Pupil(40.0, PUPIL.focus_mm)).shape == (0, 2)


def test_many_mirrors_have_the_outlines_of_each_alone(default_layout: Layout) -> None:
    """A triangle that repeats its last corner among them, and one too small for the pupil."""
    small, mirrors = 0.02, list(default_layout.mirrors)
    corners = mirrors[0].outline_in_rig_mm
    mirrors[0] = mirrors[0].replaced(outline_in_rig_mm=corners[:3])
    middle = mirrors[1].outline_in_rig_mm.mean(axis=0)
    mirrors[1] = mirrors[1].replaced(outline_in_rig_mm=middle + small * (mirrors[1].outline_in_rig_mm - middle))
    shown = np.array([mirror.outline_normalized[[0, 1, 2, -1]] for mirror in mirrors])
    normals = np.array([mirror.normal_in_rig for mirror in mirrors])
    distances_mm = np.array([mirror.distance_mm for mirror in mirrors])
    together = whole_pupil_outlines(shown, normals, distances_mm, PUPIL)
    for mirror, outline in zip(mirrors, together, strict=True):
        alone = whole_pupil_outline(mirror, PUPIL)
        np.testing.assert_allclose(outline[: len(alone)], alone, atol=1e-15)
        np.testing.assert_array_equal(outline[len(alone) :] - (outline[len(alone) - 1] if len(alone) else 0.0), 0.0)
    assert [len(whole_pupil_outline(mirror, PUPIL)) for mirror in mirrors[:3]] == [3, 0, 4]
