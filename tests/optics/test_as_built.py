"""The camera as built strays from its design by as much as the tolerances say, and no more."""

from __future__ import annotations

import numpy as np
import pytest

from optics.as_built import draw_as_built
from optics.layout import Layout
from optics.tolerances import Tolerances
from optics.values import InputError


def test_without_tolerances_it_is_the_design(default_layout: Layout) -> None:
    built = draw_as_built(default_layout, Tolerances.none(), np.random.default_rng(0))
    assert built.kind == "as-built"
    np.testing.assert_array_equal(built.camera.intrinsics, default_layout.camera.intrinsics)
    for mirror, designed in zip(built.mirrors, default_layout.mirrors, strict=True):
        np.testing.assert_allclose(mirror.virtual_centre_in_rig_mm, designed.virtual_centre_in_rig_mm, atol=1e-9)
        np.testing.assert_allclose(mirror.outline_in_rig_mm, designed.outline_in_rig_mm, atol=1e-9)
    assert built.metrics == {}


def test_draws_spread_as_the_tolerances_say(default_layout: Layout) -> None:
    tolerances = Tolerances(tilt_deg=0.3, offset_mm=0.2, focal_percent=1.5, centre_px=6.0)
    random = np.random.default_rng(1)
    tilts, offsets, cameras = [], [], []
    for _ in range(150):
        built = draw_as_built(default_layout, tolerances, random)
        cameras.append(built.camera.intrinsics - default_layout.camera.intrinsics)
        for mirror, designed in zip(built.mirrors, default_layout.mirrors, strict=True):
            in_plane = designed.rig_from_plane[:3, :2].T @ np.cross(designed.normal_in_rig, mirror.normal_in_rig)
            tilts.append(np.degrees(in_plane))
            moved = mirror.outline_in_rig_mm.mean(axis=0) - designed.outline_in_rig_mm.mean(axis=0)
            offsets.append(moved @ designed.normal_in_rig)
            assert np.linalg.norm(moved) == pytest.approx(abs(offsets[-1]), abs=1e-9)
    np.testing.assert_allclose(np.std(tilts, axis=0), 0.3, rtol=0.08)
    np.testing.assert_allclose(np.mean(tilts, axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.std(offsets), 0.2, rtol=0.08)
    camera = np.array(cameras)
    np.testing.assert_array_equal(camera[:, 0], camera[:, 1])  # square pixels stay square
    np.testing.assert_allclose(camera[:, 0].std() / default_layout.camera.fx_px, 0.015, rtol=0.2)
    np.testing.assert_allclose(camera[:, 2:4].std(axis=0), 6.0, rtol=0.2)
    np.testing.assert_allclose(camera[:, 4:].mean(axis=0), [0.05, -0.1, 0.0, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(camera[:, 4:8].std(axis=0), [0.02, 0.03, 5e-4, 5e-4], rtol=0.2)


def test_outlines_move_with_their_mirrors(default_layout: Layout) -> None:
    built = draw_as_built(default_layout, Tolerances(), np.random.default_rng(2))
    for mirror, designed in zip(built.mirrors, default_layout.mirrors, strict=True):
        sides, designed_sides = (
            np.linalg.norm(np.diff(m.outline_in_rig_mm, axis=0, append=m.outline_in_rig_mm[:1]), axis=1)
            for m in (mirror, designed)
        )
        np.testing.assert_allclose(sides, designed_sides, atol=1e-9)


@pytest.mark.parametrize(
    ("tolerances", "named"),
    [
        (Tolerances(tilt_deg=25.0), "tilt_deg 25.0"),
        (Tolerances(offset_mm=200.0), "offset_mm 200.0"),
        (Tolerances(focal_percent=1e9), "focal_percent"),
        (Tolerances(distortion_mean=(-0.6, 0.0, 0.0, 0.0, 0.0)), "distortion_mean"),
    ],
)
def test_what_cannot_be_built_is_refused_in_one_line(
    default_layout: Layout, tolerances: Tolerances, named: str
) -> None:
    with pytest.raises(InputError, match=named) as error:
        draw_as_built(default_layout, tolerances, np.random.default_rng(0))
    assert "\n" not in str(error.value)
