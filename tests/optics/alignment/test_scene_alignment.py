"""Tilts from points of a textured scene."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.alignment.build_errors import BuildErrors, BuiltDevice
from mirrorcam.optics.alignment.scene_alignment import SceneAligner
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.optics.alignment.built_devices import built, tilts_deg
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene
from tests.optics.layouts import faceted_parabola

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA), fill=0.9)


def test_tilts_are_told_where_the_scene_has_texture() -> None:
    errors = BuildErrors()
    units = 0.5 * np.random.default_rng(1).standard_normal(BuiltDevice(LAYOUT, errors).count)
    random = np.random.default_rng(2)
    textures = [fractal(random, slope=slope) for slope in (0.8, 1.2, 1.6)]
    truth = built(LAYOUT, errors, units)
    frames = [
        photograph(truth, scene(random, (250.0, 600.0), textures, CAMERA.fx_px), Shot(), random) for _ in range(2)
    ]
    found = SceneAligner(LAYOUT).align([frame[..., 0] for frame in frames])
    assert found.source == "scene" and found.points > 100
    off = np.array([[each.right_deg, each.down_deg] for each in found.mirrors]) - tilts_deg(LAYOUT, errors, units)
    sigma = np.array([each.sigma_deg for each in found.mirrors])
    assert np.isfinite(off).all()
    assert np.sqrt(np.mean(off**2)) < 0.15 < np.abs(tilts_deg(LAYOUT, errors, units)).max()
    assert np.mean((off / sigma) ** 2) < 2.0


def test_an_even_scene_tells_nothing() -> None:
    frame = np.full((540, 960, 3), 120, np.uint8)
    found = SceneAligner(LAYOUT).align([frame])
    assert found.points == 0 and not any(mirror.told for mirror in found.mirrors)
    assert all(mirror.words == "cannot tell" for mirror in found.mirrors)
