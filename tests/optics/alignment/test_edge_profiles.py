"""Profiles across edges: their positions, and the model of the light."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.alignment.build_errors import BuildErrors, BuiltDevice
from mirrorcam.optics.alignment.edge_profiles import (
    LENS_PX,
    MAX_EXTENT_PX,
    STATIONS,
    Stations,
    edge_residuals,
    edge_response,
    edge_stations,
    profiles,
)
from mirrorcam.optics.geometry.layout import Layout


@pytest.fixture(scope="module")
def seen(default_layout: Layout) -> Stations:
    return edge_stations(BuiltDevice(default_layout, BuildErrors()))


def test_stations_lie_inside_the_sensor_on_edges_that_point_outwards(default_layout: Layout, seen: Stations) -> None:
    assert len(seen.position_px) > 60
    assert (seen.position_px > 0.0).all() and (seen.position_px < [1919.0, 1079.0]).all()
    middles = np.array([default_layout.outline_px(k).mean(axis=0) for k in range(9)])
    assert (((seen.position_px - middles[seen.edge.mirror]) * seen.outward).sum(axis=1) > 0.0).all()


def test_each_pair_of_edges_has_its_stations_once(seen: Stations) -> None:
    pairs = {
        frozenset([(int(a), int(b)), (int(c), int(d))])
        for a, b, c, d, paired in zip(
            seen.edge.mirror,
            seen.edge.edge,
            seen.neighbour_edge.mirror,
            seen.neighbour_edge.edge,
            seen.has_neighbour,
            strict=True,
        )
        if paired
    }
    assert len(pairs) * STATIONS == seen.has_neighbour.sum()
    assert len(pairs) == 12  # 3 x 3 mirrors: six horizontal and six vertical pairs
    assert (seen.gap_px[seen.has_neighbour] > 0.0).all() and (seen.gap_px < MAX_EXTENT_PX).all()
    assert (seen.edge.mirror != seen.neighbour_edge.mirror)[seen.has_neighbour].all()


def test_a_pinhole_blurs_no_edge(default_layout: Layout, seen: Stations) -> None:
    assert seen.blur_px.min() > 8.0
    pinhole = default_layout.replaced(camera=default_layout.camera.replaced(aperture_mm=0.0))
    assert edge_stations(BuiltDevice(pinhole, BuildErrors())).blur_px.max() == 0.0


@pytest.mark.parametrize("radius_px", [0.0, 5.0, 14.0])
def test_an_edge_lets_half_of_the_light_through_at_its_place_and_all_of_it_inside(radius_px: float) -> None:
    inside = np.linspace(-40.0, 40.0, 801)[None]
    part, slope = edge_response(inside, np.array([radius_px]), np.array([1.0]))
    assert part[0, 400] == pytest.approx(0.5, abs=1e-12)
    assert part[0, 0] < 1e-6 and part[0, -1] > 1.0 - 1e-6
    assert np.allclose(np.gradient(part[0], inside[0]), slope[0], atol=2e-3)
    assert (np.diff(part[0]) >= 0.0).all()


def test_a_blurred_edge_is_the_part_of_a_disc_that_it_leaves() -> None:
    inside = np.linspace(-10.0, 10.0, 21)
    part, _ = edge_response(inside[None], np.array([10.0]), np.array([0.1]))
    x = np.clip(inside / 10.0, -1.0, 1.0)
    disc = 0.5 + (x * np.sqrt(1.0 - x**2) + np.arcsin(x)) / np.pi
    assert np.abs(part[0] - disc).max() < 0.015


def test_light_of_the_model_leaves_nothing_and_pulls_to_the_edge(default_layout: Layout, seen: Stations) -> None:
    given = profiles(np.zeros((1080, 1920), np.float32), seen, np.zeros((len(seen.position_px), 2)), 0.0)
    true = np.full((len(seen.position_px), 2), 1.5)
    slope = np.full(true.shape, 0.05)  # its section, of some 70 px, is blurred like a uniform one of 3.5 px
    sigma_px = np.hypot(LENS_PX, 0.05 * seen.section_px / np.sqrt(12.0))
    own, _ = edge_response(true[:, :1] - given.out_px, seen.blur_px[:, 0], sigma_px)
    other, _ = edge_response(given.out_px - seen.gap_px[:, None] - true[:, 1:], seen.blur_px[:, 1], sigma_px)
    given.light[:] = 3.0 + 100.0 * own + 80.0 * other * seen.has_neighbour[:, None]
    given.texture[:] = 5.0
    at_truth, _ = edge_residuals(given, seen, true, slope, 0.0)
    displaced, change = edge_residuals(given, seen, np.zeros_like(true), slope, 0.0)
    assert np.abs(at_truth).max() < 0.4 < np.abs(displaced).max()
    paired = seen.has_neighbour
    by = (change @ np.swapaxes(change, 1, 2))[paired]
    step = np.linalg.solve(by, (change @ displaced[..., None])[paired])[..., 0]
    assert np.abs(step - 1.5).max() < 0.8
