"""The truth of the pupil, traced ray by ray, against the half-planes of `optics.geometry.pupil`."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil, disc_part, outline_aperture
from mirrorcam.render_scenes.fast.pixel_footprints import pixel_footprints
from mirrorcam.render_scenes.truth.pixel_maps import NO_MIRROR, pixel_rays
from mirrorcam.render_scenes.truth.pupil_maps import SAMPLES, PupilTracer, pupil_maps
from tests.render_scenes.truth.test_pixel_maps import Curtain

PUPIL = Pupil(aperture_mm=1.8, focus_mm=500.0)


def test_shares_and_centroids_are_those_of_the_half_planes(small_layout: Layout) -> None:
    maps = pupil_maps(PupilTracer(small_layout, PUPIL))
    camera = small_layout.camera
    x, y = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    chief = camera.normalized_from_pixels(np.column_stack([x.ravel(), y.ravel()]).astype(np.float64))
    cut = 0
    for number, mirror in enumerate(small_layout.mirrors):
        part = disc_part(outline_aperture(mirror, chief, PUPIL.focus_mm), PUPIL.radius_mm)
        first = maps["first.mirror"].ravel() == number
        second = maps["second.mirror"].ravel() == number
        for place, chosen in (("first", first), ("second", second)):
            found = {name: maps[f"{place}.{name}"].ravel()[chosen] for name in ("share", "x", "y")}
            np.testing.assert_allclose(found["share"], part.fraction[chosen], atol=6.0 / SAMPLES)
            for axis, name in enumerate("xy"):
                expected = PUPIL.radius_mm * part.centroid[chosen, axis]
                assert np.abs((found[name] - expected) * found["share"]).max(initial=0.0) < 0.04
        # Where the corners of four mirrors meet, two fill more of the pupil.
        others = ~first & ~second
        assert (part.fraction[others] < maps["second.share"].ravel()[others] + 4.0 / SAMPLES).all()
        cut += int(((part.fraction > 0.0) & (part.fraction < 1.0)).sum())
    assert cut > 0.05 * len(chief)  # a quarter of the pixels, of four times the size, are as often at an edge


def test_a_pinhole_sees_one_mirror_or_none(small_layout: Layout) -> None:
    maps = pupil_maps(PupilTracer(small_layout, Pupil()))
    single = pixel_rays(small_layout, mirrors=True)
    np.testing.assert_array_equal(maps["first.mirror"], single.mirror)
    np.testing.assert_array_equal(maps["first.share"], single.mirror != NO_MIRROR)
    assert (maps["second.mirror"] == NO_MIRROR).all()
    assert np.isnan(maps["second.x"]).all()


@pytest.mark.slow
def test_obstacles_take_their_part_of_the_pupil(small_layout: Layout) -> None:
    class Half(Curtain):
        """Stops rays from the right half of the pupil."""

        def distance_to_body_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
            return np.where(start[..., 0] > 0.0, 1.0, np.inf)

    free, half = (pupil_maps(PupilTracer(small_layout, PUPIL, obstacles=each)) for each in (None, Half()))
    whole = free["first.share"] == 1.0
    np.testing.assert_allclose(half["first.share"][whole], 0.5, atol=0.02)
    assert (half["first.x"][whole] < 0.0).all()


def test_a_pupil_that_walks_is_cut_where_it_is(small_layout: Layout) -> None:
    """Shares of the fast renderer's footprints against rays from the pupil 1 mm away at 45 degrees."""
    walking = Pupil(aperture_mm=1.8, focus_mm=500.0, walk_mm=3.0)
    camera, mirrors = small_layout.camera, small_layout.mirrors
    found = np.zeros(camera.width_px * camera.height_px)
    for layer in pixel_footprints(camera, mirrors, 1, np.ones(len(mirrors)), walking):
        for footprints in layer:
            np.add.at(found, footprints.subpixel, footprints.weight)
    shares = {}
    for pupil in (walking, PUPIL):
        maps = pupil_maps(PupilTracer(small_layout, pupil))
        shares[pupil] = (maps["first.share"] + maps["second.share"]).ravel()
    assert np.abs(found - shares[walking]).mean() < 0.25 * np.abs(found - shares[PUPIL]).mean()
    assert np.sqrt(np.mean((found - shares[walking]) ** 2)) < 0.02
