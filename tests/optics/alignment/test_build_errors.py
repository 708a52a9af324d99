"""Derivatives of edges by build errors, and the prior for a layout."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.alignment.build_errors import CAMERA_ERRORS, RIGID_ERRORS, BuildErrors, BuiltDevice, EdgePoints
from mirrorcam.optics.alignment.edge_profiles import edge_stations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.alignment.built_devices import built


@pytest.fixture
def device(default_layout: Layout) -> BuiltDevice:
    return BuiltDevice(default_layout, BuildErrors())


def some_points(device: BuiltDevice) -> EdgePoints:
    random = np.random.default_rng(0)
    mirror = random.integers(0, 9, 40)
    edge = np.array([random.integers(device.edges[k]) for k in mirror])
    return EdgePoints(mirror, edge, random.uniform(0.1, 0.9, 40))


def test_without_errors_edges_are_on_the_outlines(default_layout: Layout, device: BuiltDevice) -> None:
    points = some_points(device)
    at = device.pixels(points, np.zeros(device.count))
    for mirror, edge, part, pixel in zip(points.mirror, points.edge, points.fraction, at, strict=True):
        corners = default_layout.mirrors[mirror].usable_normalized
        on_edge = corners[edge] + part * (corners[(edge + 1) % len(corners)] - corners[edge])
        # Positions along an edge count on the mirror, not in the picture: the pixel is on the line.
        along = corners[(edge + 1) % len(corners)] - corners[edge]
        away = (pixel - default_layout.camera.cx_px * 0.0) - default_layout.camera.pixels_from_normalized(on_edge)
        normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        assert abs(away @ normal) < 1e-6


def test_edges_are_where_a_device_with_these_errors_has_them(default_layout: Layout, device: BuiltDevice) -> None:
    units = np.random.default_rng(3).normal(0.0, 0.3, device.count)
    truth = built(default_layout, BuildErrors(), units)
    points = some_points(device)
    at = device.pixels(points, units)
    for mirror, edge, pixel in zip(points.mirror, points.edge, at, strict=True):
        corners = truth.mirrors[mirror].outline_in_rig_mm
        ends = corners[[edge, (edge + 1) % len(corners)]]
        between = ends[0] + np.linspace(-0.1, 1.1, 2001)[:, None] * (ends[1] - ends[0])
        assert np.linalg.norm(truth.camera.project(between) - pixel, axis=1).min() < 0.3


def test_derivatives_are_those_of_finite_differences(device: BuiltDevice) -> None:
    points, random = some_points(device), np.random.default_rng(1)
    errors = random.normal(0.0, 0.5, device.count)
    _, jacobian = device.pixels_with_jacobian(points, errors)
    for place in range(0, device.count, 7):
        step = np.zeros(device.count)
        step[place] = 1e-2
        change = (device.pixels(points, errors + step) - device.pixels(points, errors - step)) / 2e-2
        assert np.abs(jacobian[:, :, place] - change).max() < 2e-2 * max(np.abs(change).max(), 0.1)


def test_a_line_meets_a_turned_edge_where_it_crosses_it(device: BuiltDevice) -> None:
    stations = edge_stations(device)
    points, start, direction = stations.edge, stations.position_px, stations.outward
    errors = np.random.default_rng(2).normal(0.0, 0.7, device.count)
    errors[9:CAMERA_ERRORS] = 0.0  # without distortion, edges are straight
    distance, jacobian, slope = device.crossings_px(points, errors, start, direction)
    ends = [
        device.pixels(EdgePoints(points.mirror, points.edge, np.full(len(start), part)), errors) for part in (0.0, 1.0)
    ]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0], axis=1, keepdims=True)
    crossing = start + distance[:, None] * direction - ends[0]
    assert np.abs(along[:, 0] * crossing[:, 1] - along[:, 1] * crossing[:, 0]).max() < 1e-4
    assert np.abs(slope) == pytest.approx(np.abs(np.tan(np.arcsin((along * direction).sum(axis=1)))), abs=1e-6)
    for place in range(0, device.count, 7):
        step = np.zeros(device.count)
        step[place] = 1e-2
        pair = [device.crossings_px(points, errors + sign * step, start, direction)[0] for sign in (1.0, -1.0)]
        change = (pair[0] - pair[1]) / 2e-2
        assert np.abs(jacobian[:, place] - change).max() < 2e-2 * max(np.abs(change).max(), 0.1)


def test_errors_are_those_of_the_camera_then_of_each_mirror(device: BuiltDevice) -> None:
    assert device.count == CAMERA_ERRORS + sum(RIGID_ERRORS + count for count in device.edges)
    assert device.tilts(1) == slice(
        CAMERA_ERRORS + RIGID_ERRORS + device.edges[0], CAMERA_ERRORS + RIGID_ERRORS + device.edges[0] + 2
    )


def test_the_camera_of_a_calibrated_layout_is_known(default_layout: Layout) -> None:
    calibrated = BuildErrors.of(default_layout.replaced(kind="calibrated"))
    nominal = BuildErrors.of(default_layout)
    assert calibrated.focal_percent < nominal.focal_percent and calibrated.centre_px < nominal.centre_px
    assert calibrated.tilt_deg == nominal.tilt_deg and calibrated.camera_deg == nominal.camera_deg
