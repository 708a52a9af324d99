"""Depth, refocusing and new viewpoints of a camera, each against the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.cameras_compared.cameras import FAR_MM, FIELD_MM, NEAR_MM, ComparedCamera
from benchmarks.cameras_compared.pictures import (
    light_of,
    noise_variance,
    true_depth_mm,
    wide_aperture,
    with_noise,
)
from benchmarks.depth_scenes.rendered_scene import RenderedScene, srgb
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth import estimate_depth
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.linear_light import levels_from_light, light_from_levels
from mirrorcam.optics.light_field.render.perspective import render_view
from mirrorcam.optics.light_field.render.view_depths import ViewDepths

Float32 = NDArray[np.float32]

APERTURE_MM = 30.0
"""Diameter of the lens that refocused pictures are compared with: 50 mm at f/1.7."""
RINGS = ((0.0, 1), (0.46, 6), (0.84, 12))
"""Radii, in radii of the aperture, and numbers of the viewpoints that are averaged: equal areas for each."""
WINDOW_PX = 5
"""Side of the window that shares one depth, for the bound."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of a camera on one scene.

    Attributes
    ----------
    true_mm, depth_mm, sigma_mm, confidence, bound_mm
        True and measured depth (v, u) of the reference view, stated standard deviation and confidence, and the bound.
    refocus_db, viewpoint_db
        PSNR of the refocused picture, and of the view midway to the outermost one.
    picture, refocused
        Central view and refocused picture (v, u, c), 8 bits.
    """

    true_mm: Float32
    depth_mm: Float32
    sigma_mm: Float32
    confidence: Float32
    bound_mm: FloatArray
    refocus_db: float
    viewpoint_db: float
    picture: NDArray[np.uint8]
    refocused: NDArray[np.uint8]


def measure(scene: RenderedScene, camera: ComparedCamera, seed: int) -> Measured:
    """Render a scene with a camera, and measure depth, refocusing and a new viewpoint.

    The last two are of pictures without projected dots, but by the depth that these gave.
    """
    views, reference = camera.views, reference_index(camera.views)
    light = light_of(scene, camera, seed)
    light_field = with_noise(camera, light, seed)
    depth = estimate_depth(light_field, near_mm=NEAR_MM, far_mm=FAR_MM)
    true_mm = true_depth_mm(scene, views, reference)
    if camera.is_active:
        passive = replace(camera, is_active=False)
        light_field = with_noise(passive, light_of(scene, passive, seed), seed)
    depths = ViewDepths.of_reference(light_field, depth.depth_mm)
    box = camera.box_mm
    middle = box.mean(axis=0)
    refocused = _refocused(light_field, depths, middle, box)
    half_way = box[np.abs(box).max(axis=1).argmax()] / 2.0
    viewpoint = light_from_levels(render_view(light_field, depths, half_way).image)
    return Measured(
        true_mm,
        depth.depth_mm,
        depth.sigma_mm,
        depth.confidence,
        depth_bound_mm(camera, light[reference], true_mm),
        _psnr_db(views, refocused, wide_aperture(scene, views, middle, APERTURE_MM)),
        _psnr_db(views, viewpoint, wide_aperture(scene, views, half_way, 0.0)),
        light_field.samples[reference],
        srgb(refocused),
    )


def inner(views: Views, picture: NDArray[Any]) -> NDArray[Any]:
    """Return the part of a picture (v, u, ...) that shows the field in which cameras are compared."""
    size = np.array([views.height_px, views.width_px])
    height, width = np.rint(FIELD_MM[::-1] * views.focal_px / views.reference_distance_mm).astype(int)
    top, left = (size - [height, width]) // 2
    return picture[top : top + height, left : left + width]


def _refocused(light_field: LightField, depths: ViewDepths, middle_mm: FloatArray, box_mm: FloatArray) -> Float32:
    """Return light (v, u, c) in focus at FOCUS_MM, of an aperture about a position, as far as the views reach.

    All views show the same points of the plane in focus, so the mean of those within the aperture is in focus there.
    """
    total, count = np.zeros((), np.float32), 0
    for radius, number in RINGS:
        for angle in 2.0 * np.pi * (np.arange(number) + 0.5) / number:
            offset = 0.5 * APERTURE_MM * radius * np.array([np.cos(angle), np.sin(angle), 0.0])
            position = np.clip(middle_mm + offset, *box_mm)
            total, count = total + light_from_levels(render_view(light_field, depths, position).image), count + 1
    return np.asarray(total / np.float32(count), dtype=np.float32)


def depth_bound_mm(camera: ComparedCamera, light: Float32, true_mm: Float32) -> FloatArray:
    """Return the Cramér-Rao bound (v, u) of depth of a window that shares one depth, mm.

    A change dz of depth shifts a view at b by f b dz / Z^2 px. The texture is unknown, so only differences of b from
    their mean count (see `mirrorcam.optics.design.assess.depth_sigma`). `light` (v, u, c) is without noise.
    """
    views = camera.views
    offsets = views.positions_mm[camera.exists > 0][:, :2]
    spread = np.cov(offsets.T, bias=True) * len(offsets)
    right, down = np.gradient(light.astype(np.float64), axis=(1, 0))
    gradient = np.stack([right, down], axis=-1)
    energy = np.einsum("vuci,ij,vucj->vuc", gradient, spread, gradient) / noise_variance(light, camera.samples)
    px_per_mm = views.focal_px / np.square(true_mm.astype(np.float64) - views.reference_view_depth_mm)
    information = cv2.boxFilter(energy.sum(axis=-1), -1, (WINDOW_PX, WINDOW_PX), normalize=False) * px_per_mm**2
    return np.asarray(1.0 / np.sqrt(np.maximum(information, 1e-12)))


def _psnr_db(views: Views, light: Float32, truth: Float32) -> float:
    """Return the PSNR of a picture in sRGB, within the field."""
    levels = (np.clip(levels_from_light(picture), 0.0, 1.0) for picture in (light, truth))
    first, second = (inner(views, picture) for picture in levels)
    return float(-10.0 * np.log10(np.mean(np.square(first - second))))
