"""Laws of the seeds: what makes a parabola a parabola, and a tiling a tiling."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from optics.camera import Camera
from optics.design.errors import InfeasibleDesign
from optics.design.metrics import smallest_gap_mm
from optics.design.seeds import (
    ellipsoid_centres,
    faceted_parabola,
    mirrors_of,
    parabola_centres,
    sensor_rectangle,
    tiles,
)
from optics.mirror import reflect
from optics.spec import DesignSpec
from optics.values import FloatArray, InputError

SIZES = [(1, 2), (2, 2), (3, 3), (2, 4), (4, 1)]
BENT = Camera.c920().replaced(distortion=[0.08, -0.15, 0.001, -0.002, 0.02])


def chief_rays() -> FloatArray:
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 5), np.linspace(-0.4, 0.4, 4))
    return np.stack([u, v, np.ones_like(u)], axis=-1)


def where_chief_rays_meet(centres: FloatArray, rays: FloatArray) -> FloatArray:
    """Points (..., 3) of rays from the pupil on the planes that bisect pupil and virtual centres."""
    return rays * (0.5 * np.sum(centres**2, -1, keepdims=True) / np.sum(rays * centres, -1, keepdims=True))


def test_parabola_sends_chief_rays_parallel_to_the_view_axis() -> None:
    rays = chief_rays()
    centres = parabola_centres(rays[..., :2], 80.0)
    leaving = where_chief_rays_meet(centres, rays) - centres
    assert_allclose(
        leaving / np.linalg.norm(leaving, axis=-1, keepdims=True), np.broadcast_to([0, 1, 0], rays.shape), atol=1e-14
    )
    assert_allclose(centres[..., 1], -80.0)


def test_parabola_facets_are_tangent_to_one_paraboloid() -> None:
    rays = chief_rays()
    points = where_chief_rays_meet(parabola_centres(rays[..., :2], 80.0), rays)
    # Focus at the origin, directrix plane y = -80: as far from one as from the other.
    assert_allclose(np.linalg.norm(points, axis=-1), points[..., 1] + 80.0)


def test_ellipsoid_sends_chief_rays_through_its_target() -> None:
    rays, target = chief_rays(), np.array([0.0, 375.0, 80.0])
    centres = ellipsoid_centres(rays[..., :2], 80.0, 375.0)
    points = where_chief_rays_meet(centres, rays)
    assert_allclose(np.linalg.norm(points, axis=-1) + np.linalg.norm(points - target, axis=-1), 455.0)
    assert_allclose(np.linalg.norm(np.cross(points - centres, target - centres), axis=-1), 0.0, atol=1e-9)
    assert_allclose(reflect(centres, centres), 0.0, atol=1e-12)


def test_ellipsoid_becomes_the_parabola_as_its_target_recedes() -> None:
    chief = chief_rays()[..., :2]
    errors = [
        np.abs(ellipsoid_centres(chief, 80.0, depth) - parabola_centres(chief, 80.0)).max() for depth in (1e5, 1e6)
    ]
    assert errors[0] < 0.2
    assert errors[1] < 0.11 * errors[0]


@pytest.mark.parametrize(("rows", "cols"), SIZES)
@pytest.mark.parametrize("scale_mm", [40.0, 120.0])
def test_parabola_of_any_size_is_in_order(rows: int, cols: int, scale_mm: float) -> None:
    layout = faceted_parabola(DesignSpec(rows=rows, cols=cols, scale_mm=scale_mm))
    assert_allclose(layout.virtual_centres_in_rig_mm[:, 1], -scale_mm)
    x, y, _ = np.moveaxis(layout.virtual_centres_in_view_mm, -1, 0)
    assert (np.diff(x, axis=1) > 0).all(), "columns run to the right of the view"
    assert (np.diff(y, axis=0) > 0).all(), "rows run down the view"
    assert smallest_gap_mm(layout) == pytest.approx(1.0, abs=1e-3)
    for k in range(rows * cols):
        assert_allclose(
            layout.mirrors[k].outline_in_rig_mm @ layout.mirrors[k].normal_in_rig, -layout.mirrors[k].distance_mm
        )


def test_tiles_fill_the_sensor_but_for_their_gaps() -> None:
    spec = DesignSpec(rows=2, cols=4)
    corners = tiles(spec, 0.02).reshape(-1, 4, 2)
    rectangle = sensor_rectangle(spec.camera)
    assert_allclose(corners.min(axis=(0, 1)), rectangle[0])
    assert_allclose(corners.max(axis=(0, 1)), rectangle[1])
    width, height = rectangle[1] - rectangle[0]
    assert_allclose(width, 1920 / 1360.38)
    sizes = np.ptp(corners, axis=1)
    assert_allclose(sizes, np.broadcast_to([(width - 3 * 0.02) / 4, (height - 0.02) / 2], sizes.shape))
    # Row 0 holds the highest views, which the fold puts where v is greatest.
    assert corners[0, :, 1].min() > corners[4, :, 1].max()


def test_a_distorted_sensor_holds_its_rectangle() -> None:
    low, high = sensor_rectangle(BENT)
    along = np.linspace(0.0, 1.0, 50)[:, None]
    for start, end in (
        (low, [high[0], low[1]]),
        (low, [low[0], high[1]]),
        (high, [high[0], low[1]]),
        (high, [low[0], high[1]]),
    ):
        pixels = BENT.pixels_from_normalized(np.asarray(start) * (1 - along) + np.asarray(end) * along)
        assert (pixels > -0.51).all()
        assert (pixels < np.array([1919.51, 1079.51])).all()


def test_a_lens_that_folds_inside_the_sensor_is_refused() -> None:
    camera = Camera.c920().replaced(distortion=[-0.9, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="folds inside the sensor"):
        sensor_rectangle(camera)


def test_facets_that_cannot_be_so_far_apart_are_refused() -> None:
    with pytest.raises(InfeasibleDesign, match=r"spacing constraint: facets 60 mm apart .* too close"):
        faceted_parabola(DesignSpec(spacing_mm=60.0))


def test_noise_below_a_nanometre_leaves_no_trace() -> None:
    spec = DesignSpec()
    corners = tiles(spec, 0.02).reshape(-1, 4, 2).round(8)
    centres = parabola_centres(corners.mean(axis=1), 80.0).round(6)
    noise = np.random.default_rng(0).uniform(-2e-10, 2e-10, centres.shape)
    assert mirrors_of(spec, centres, corners) == mirrors_of(spec, centres + noise, corners + noise[0, 0])


def test_outlines_are_rounded_and_lie_on_their_planes() -> None:
    for mirror in faceted_parabola(DesignSpec(rows=2, cols=2)).mirrors:
        outline = mirror.outline_in_rig_mm
        assert (outline == outline.round(9)).all()
        assert np.abs(outline @ mirror.normal_in_rig + mirror.distance_mm).max() < 2e-9
