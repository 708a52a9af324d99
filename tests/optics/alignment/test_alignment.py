"""Tilts measured by the edges of sub-images, their words, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.alignment import (
    EdgeAligner,
    EdgeFitter,
    MirrorTilt,
    SceneAligner,
    mean_grey,
    mirror_tilt,
    view_rotation_signs,
)
from mirrorcam.optics.alignment.build_errors import CAMERA_ERRORS, BuildErrors, BuiltDevice
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.alignment.built_devices import built, sheet, tilts_deg
from tests.optics.drift.calibrated_device import turned
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene
from tests.optics.layouts import faceted_parabola

SMALL_CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
LAYOUT = faceted_parabola(SMALL_CAMERA, DesignSpec(camera=SMALL_CAMERA), fill=0.9)


def test_a_view_rotates_as_the_signs_say(default_layout: Layout) -> None:
    for index in range(9):
        right, down = view_rotation_signs(default_layout, index)
        mirror = default_layout.mirrors[index]
        middle = mirror.outline_in_rig_mm.mean(axis=0)
        for axis, sign, which in ((1, right, 0), (0, down, 1)):
            vector = 0.5 * sign * mirror.rig_from_plane[:3, axis]
            after = turned(default_layout, index, vector).mirrors[index]
            rays = [(each.reflection @ middle) @ default_layout.view_from_rig.T for each in (mirror, after)]
            change = rays[1] / np.linalg.norm(rays[1]) - rays[0] / np.linalg.norm(rays[0])
            assert change[which] > 0.0


@pytest.mark.slow
def test_tilts_of_a_device_are_within_their_deviations(default_layout: Layout) -> None:
    pinhole = default_layout.replaced(camera=default_layout.camera.replaced(aperture_mm=0.0))
    errors = BuildErrors()
    aligner, squares = EdgeAligner(pinhole, errors), []
    for seed in range(3):
        units = np.random.default_rng(seed).standard_normal(BuiltDevice(pinhole, errors).count) * 0.7
        found = aligner.align([sheet(built(pinhole, errors, units)).round().astype(np.uint8)])
        off = np.array([each.estimate_deg for each in found.mirrors]) - tilts_deg(pinhole, errors, units)
        sigma = np.array([each.sigma_deg for each in found.mirrors])
        assert sigma.min() < 0.25 and sigma.max() < errors.tilt_deg  # a bound of .14 to .49
        squares.append(np.mean((off / sigma) ** 2))
        assert found.source == "edges" and found.edges is not None
    assert np.mean(squares) < 0.7  # 0.49 is expected of errors drawn 0.7 times as large as their prior


@pytest.mark.slow
def test_a_rotation_of_the_camera_is_not_one_of_the_mirrors(default_layout: Layout) -> None:
    pinhole = default_layout.replaced(camera=default_layout.camera.replaced(aperture_mm=0.0))
    units = np.zeros(BuiltDevice(pinhole, BuildErrors()).count)
    units[3:6] = 1.5, 0.0, -1.5
    found = EdgeAligner(pinhole).align([sheet(built(pinhole, BuildErrors(), units)).round().astype(np.uint8)])
    determined = [value for each in found.mirrors for value in (each.right_deg, each.down_deg) if np.isfinite(value)]
    assert determined and np.sqrt(np.mean(np.square(determined))) < 0.3  # they share part of it: 0.75 deg look alike
    assert found.camera_rotation_deg[2] == pytest.approx(-0.75, abs=0.15)


def test_tilts_in_words() -> None:
    nan = float("nan")
    assert MirrorTilt(0, -0.4, -0.2, (0.1, 0.1)).words == "0.40° left, 0.20° up"
    assert MirrorTilt(0, nan, 0.21, (0.5, 0.1)).words == "0.21° down"
    assert MirrorTilt(0, 0.05, -0.2, (0.1, 0.1)).words == "0.20° up"
    assert MirrorTilt(0, 0.05, nan, (0.1, 0.5)).words == "straight"
    assert MirrorTilt(0, nan, nan, (0.5, 0.5)).words == "cannot tell"
    assert not MirrorTilt(0, nan, nan, (0.5, 0.5)).determined


def test_a_tilt_hardly_better_than_its_prior_is_undetermined(default_layout: Layout) -> None:
    spread = np.diag(np.radians([0.1, 0.45]) ** 2)
    tilt = mirror_tilt(default_layout, 4, np.radians([0.3, 0.3]), spread, 0.5)
    assert np.isnan(tilt.right_deg) and abs(tilt.down_deg) == pytest.approx(0.3)
    assert tilt.sigma_deg == pytest.approx((0.45, 0.1))
    assert abs(tilt.estimate_deg[0]) == pytest.approx(0.3)


def test_frames_are_averaged_and_others_refused(default_layout: Layout) -> None:
    dark, bright = (np.full((1080, 1920, 3), value, np.uint8) for value in (10, 30))
    assert np.allclose(mean_grey([dark, bright[..., 0]], default_layout), 20.0)
    with pytest.raises(InputError, match="no frame is given"):
        mean_grey([], default_layout)
    with pytest.raises(InputError, match="frame is 640x480 px, expected 1920x1080"):
        mean_grey([np.zeros((480, 640, 3), np.uint8)], default_layout)


@pytest.fixture(scope="module")
def pinhole(default_layout: Layout) -> Layout:
    return default_layout.replaced(camera=default_layout.camera.replaced(aperture_mm=0.0))


@pytest.fixture(scope="module")
def fitter(pinhole: Layout) -> EdgeFitter:
    return EdgeFitter(BuiltDevice(pinhole, BuildErrors()))


def drawn(fitter: EdgeFitter, seed: int) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, 0.6, fitter.device.count)


def test_edges_of_a_white_sheet_are_found_where_they_are(pinhole: Layout, fitter: EdgeFitter) -> None:
    units = drawn(fitter, 0)
    found = fitter.fit(sheet(built(pinhole, BuildErrors(), units)))
    for place, points in enumerate((found.stations.edge, found.stations.neighbour_edge)):
        truth = fitter.device.pixels(points, units)
        designed = fitter.device.pixels(points, np.zeros(fitter.device.count))
        off = ((truth - designed) * found.stations.outward).sum(axis=1) - found.offset_px[:, place]
        kept = found.stations.has_neighbour if place else np.ones(len(off), bool)
        assert np.sqrt(np.mean(off[kept] ** 2)) < 0.6
        assert np.abs(truth - designed).max() > 8.0


@pytest.mark.slow
def test_the_rotation_of_the_camera_is_measured(pinhole: Layout, fitter: EdgeFitter) -> None:
    units = np.zeros(fitter.device.count)
    units[3:6] = 1.2, -1.0, 0.8
    found = fitter.fit(sheet(built(pinhole, BuildErrors(), units)))
    sigma = np.sqrt(np.diag(found.covariance))[3:6]
    assert (np.abs(found.errors[3:6] - units[3:6]) < 3.0 * sigma).all()
    assert sigma[2] < 0.3  # roll is determined best


@pytest.mark.slow
def test_a_dark_frame_determines_nothing(fitter: EdgeFitter) -> None:
    random = np.random.default_rng(0)
    found = fitter.fit(random.normal(3.0, 1.0, (1080, 1920)).clip(0.0).astype(np.float32))
    assert np.isnan(found.station_offset_px).mean() > 0.9
    mirrors = np.sqrt(np.diag(found.covariance))[CAMERA_ERRORS:]
    assert mirrors.min() > 0.5
    designed, seen = found.edge_positions
    assert len(designed) == len(seen) < 0.1 * found.station_offset_px.size


@pytest.mark.slow
def test_edge_positions_are_as_far_from_the_design_as_edges_are(pinhole: Layout, fitter: EdgeFitter) -> None:
    found = fitter.fit(sheet(pinhole))
    designed, seen = found.edge_positions
    assert len(designed) > 60
    assert np.median(np.linalg.norm(seen - designed, axis=1)) < 0.6


@pytest.mark.slow
def test_a_fit_from_the_one_before_is_the_same(pinhole: Layout, fitter: EdgeFitter) -> None:
    picture = sheet(built(pinhole, BuildErrors(), drawn(fitter, 2)))
    first = fitter.fit(picture)
    again = fitter.fit(picture, first.errors)
    assert np.abs(again.offset_px - first.offset_px).max() < 0.3


@pytest.mark.slow
def test_tilts_are_determined_if_the_scene_has_texture() -> None:
    errors = BuildErrors()
    units = 0.5 * np.random.default_rng(1).standard_normal(BuiltDevice(LAYOUT, errors).count)
    random = np.random.default_rng(2)
    textures = [fractal(random, slope=slope) for slope in (0.8, 1.2, 1.6)]
    truth = built(LAYOUT, errors, units)
    frames = [
        photograph(truth, scene(random, (250.0, 600.0), textures, SMALL_CAMERA.fx_px), Shot(), random) for _ in range(2)
    ]
    found = SceneAligner(LAYOUT).align([frame[..., 0] for frame in frames])
    assert found.source == "scene" and found.points > 100
    off = np.array([[each.right_deg, each.down_deg] for each in found.mirrors]) - tilts_deg(LAYOUT, errors, units)
    sigma = np.array([each.sigma_deg for each in found.mirrors])
    assert np.isfinite(off).all()
    assert np.sqrt(np.mean(off**2)) < 0.15 < np.abs(tilts_deg(LAYOUT, errors, units)).max()
    assert np.mean((off / sigma) ** 2) < 2.0


def test_an_even_scene_determines_nothing() -> None:
    frame = np.full((540, 960, 3), 120, np.uint8)
    found = SceneAligner(LAYOUT).align([frame])
    assert found.points == 0 and not any(mirror.determined for mirror in found.mirrors)
    assert all(mirror.words == "cannot tell" for mirror in found.mirrors)
