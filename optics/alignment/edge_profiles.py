"""Brightness profiles across the edges of sub-images, and their model.

The edge of a mirror is much nearer than the focus, so the lens blurs it over the circle of confusion, across which the
unvignetted fraction of the pupil falls from one to zero. The model of a profile is the mirror's light times this
fraction, plus the same for a neighbour whose edge is near, plus stray light. The light of the scene in each mirror is
a constant plus a random texture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.build_errors import BuiltDevice, EdgePoints
from mirrorcam.optics.geometry.camera import Camera

STATIONS = 7
"""Number of profiles per edge; each averages its section of the edge, which smooths the scene."""
LINES = 16
"""Number of lines averaged for a profile."""
ENDS = 0.12
"""Fraction of an edge, at each end, to skip because the next edge is near."""
MAX_EXTENT_PX = 64.0
STEP_PX = 2.0
MIN_EXTENT_PX = 14.0
"""Extent of a profile on each side of an edge: maximum, step along it, and minimum, beyond the blur."""
MIN_LENGTH_PX = 60.0
TEXTURE_PX = (4.0, 12.0, 40.0)
"""Correlation lengths of textures."""
MIN_TEXTURE = 0.05
"""Minimum standard deviation of a texture, relative to its light."""
DARK = 0.02
"""Fraction of light added where the model passes none, because a misplaced edge passes a little."""
NOISE_GREY = 0.5
"""Noise of a profile, which averages pixels."""
LENS_PX = 0.95
"""Sigma of the combined blur of a lens in focus, a pixel, and the interpolation of profiles."""
NODES = 12
_ANGLES = np.pi * np.arange(1, NODES + 1) / (NODES + 1)
_CHORD, _WEIGHT = np.cos(_ANGLES), 2.0 * np.sin(_ANGLES) ** 2 / (NODES + 1)
"""Gauss-Chebyshev rule of the second kind, for integrals across a disc."""


@dataclass(frozen=True, eq=False)
class Stations:
    """Positions of profiles across the edges of sub-images.

    Attributes
    ----------
    position_px, outward
        Pixel (n, 2) of each station, and the unit vector (n, 2) out of its sub-image.
    edge, neighbour_edge
        Points of the edge, and of the neighbour's edge that the profile meets; both are equal without a neighbour.
    section_px
        Lengths (n,) of the edge's sections that profiles average.
    has_neighbour
        Mask (n,) of stations with a neighbour.
    gap_px
        Distance (n,) of the neighbour's edge along `outward`.
    blur_px
        Radii (n, 2) of the circles of confusion of both edges.
    """

    position_px: FloatArray
    outward: FloatArray
    edge: EdgePoints
    neighbour_edge: EdgePoints
    section_px: FloatArray
    has_neighbour: NDArray[np.bool_]
    gap_px: FloatArray
    blur_px: FloatArray


def edge_stations(device: BuiltDevice) -> Stations:
    """The stations of a nominal device on all edges well inside the sensor; each pair of edges is used once."""
    layout, camera = device.layout, device.layout.camera
    outlines = [layout.outline_px(k, usable=True) for k in range(len(layout.mirrors))]
    rows: list[tuple[Any, ...]] = []
    done: set[tuple[int, int]] = set()
    for k, count in enumerate(device.edges):
        for edge in range(count):
            if (k, edge) in done:
                continue
            fractions = ENDS + (1.0 - 2.0 * ENDS) * (np.arange(STATIONS) + 0.5) / STATIONS
            points = EdgePoints(np.full(STATIONS, k), np.full(STATIONS, edge), fractions)
            pixels, outward = _edge_pixels(device, points, np.nanmean(outlines[k], axis=0))
            if not _is_inside(pixels, camera):
                continue
            facing = _facing_edge(device, k, pixels, outward)
            if facing is not None:
                done.add((int(facing[0]), int(facing[1])))
            mirror, other_edge, positions, gap = (
                facing if facing is not None else (k, edge, fractions, np.zeros(STATIONS))
            )
            section_px = float(np.linalg.norm(pixels[-1] - pixels[0])) / (STATIONS - 1)
            rows.append(
                (
                    pixels,
                    outward,
                    k,
                    edge,
                    fractions,
                    mirror,
                    other_edge,
                    positions,
                    facing is not None,
                    gap,
                    section_px,
                )
            )
    if not rows:
        scalars, pairs, index = np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64)
        empty = EdgePoints(index, index, scalars)
        return Stations(pairs, pairs, empty, empty, scalars, np.zeros(0, bool), scalars, pairs)
    columns = [
        np.concatenate([np.broadcast_to(row[i], np.shape(row[i]) or STATIONS) for row in rows]) for i in range(11)
    ]
    edges = [EdgePoints(columns[i], columns[i + 1], columns[i + 2]) for i in (2, 5)]
    blur = np.column_stack([_blur_px(camera, device.depths_mm(points)) for points in edges])
    return Stations(columns[0], columns[1], edges[0], edges[1], columns[10], columns[8], columns[9], blur)


def _is_inside(pixels: FloatArray, camera: Camera) -> bool:
    """Whether profiles at pixels (n, 2) of an edge fit on the sensor and the edge is long enough."""
    size = np.array([camera.width_px, camera.height_px])
    inside = (pixels >= MIN_EXTENT_PX) & (pixels <= size - 1.0 - MIN_EXTENT_PX)
    return bool(inside.all()) and float(np.linalg.norm(pixels[-1] - pixels[0])) >= MIN_LENGTH_PX


def _edge_pixels(device: BuiltDevice, points: EdgePoints, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nominal pixels (n, 2) of points on an edge, and unit vectors (n, 2) out of the sub-image."""
    pixels = device.pixels(points, np.zeros(device.count))
    tangent = np.gradient(pixels, axis=0)
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
    return pixels, normal * np.sign((normal * (pixels - centre)).sum(axis=1))[:, None]


def _facing_edge(
    device: BuiltDevice, mirror: int, pixels: FloatArray, outward: FloatArray
) -> tuple[int, int, FloatArray, FloatArray] | None:
    """The neighbour's edge that profiles meet first: mirror, edge, positions (n,) along it, and distances (n,)."""
    no_errors = np.zeros(device.count)
    best: tuple[int, int, FloatArray, FloatArray] | None = None
    for k, count in enumerate(device.edges):
        for edge in range(count) if k != mirror else ():
            ends = EdgePoints(np.full(2, k), np.full(2, edge), np.array([0.0, 1.0]))
            start, end = device.pixels(ends, no_errors)
            direction = end - start
            to_start = start - pixels
            # Solve pixels + gap * outward = start + fraction * direction.
            cross = outward[:, 0] * direction[1] - outward[:, 1] * direction[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                gap = (to_start[:, 0] * direction[1] - to_start[:, 1] * direction[0]) / cross
                fraction = (to_start[:, 0] * outward[:, 1] - to_start[:, 1] * outward[:, 0]) / cross
            meets = (gap > 0.0) & (gap < MAX_EXTENT_PX) & (fraction > 0.02) & (fraction < 0.98)
            if meets.all() and (best is None or gap.mean() < best[3].mean()):
                best = k, edge, fraction, gap
    return best


def _blur_px(camera: Camera, depth_mm: FloatArray) -> FloatArray:
    """Radii (n,) of the circles of confusion at depths (n,), px."""
    defocus = np.abs(1.0 / depth_mm - 1.0 / camera.focus_mm)
    return np.asarray(camera.pupil.radius_mm * max(camera.fx_px, camera.fy_px) * defocus)


@dataclass(frozen=True, eq=False)
class Profiles:
    """Brightness profiles across edges, in grey levels.

    Attributes
    ----------
    out_px, light
        Light (n, d) at distances (d,) along `outward` from the nominal edges.
    weight
        Weights (n, d): 0 outside the sensor and beyond the extent, else 1.
    texture
        Standard deviations (n, 2) of the light in the mirror and in its neighbour.
    stray, stray_sigma
        Stray light, half the darkest grey level, and its standard deviation.
    noise
        Standard deviation of the noise.
    """

    out_px: FloatArray
    light: FloatArray
    weight: FloatArray
    texture: FloatArray
    stray: float
    stray_sigma: float
    noise: float = NOISE_GREY


def profiles(picture: NDArray[np.float32], stations: Stations, offset_px: FloatArray, smooth_px: float) -> Profiles:
    """Profiles at all stations of a picture (h, w), smoothed by a Gaussian, around edges with offsets (n, 2)."""
    image: Any = picture if smooth_px == 0.0 else cv2.GaussianBlur(picture, (0, 0), smooth_px)
    out_px = np.arange(-1.5 * MAX_EXTENT_PX, 2.0 * MAX_EXTENT_PX + STEP_PX / 2.0, STEP_PX)
    height, width = picture.shape
    section = np.column_stack([-stations.outward[:, 1], stations.outward[:, 0]]) * stations.section_px[:, None]
    light, inside = np.zeros((len(section), len(out_px))), np.ones((len(section), len(out_px)), dtype=bool)
    for line in (np.arange(LINES) + 0.5) / LINES - 0.5:
        points = (stations.position_px + line * section)[:, None] + out_px[:, None] * stations.outward[:, None]
        inside &= ((points >= 0.0) & (points <= [width - 1.0, height - 1.0])).all(axis=2)
        pixels = np.nan_to_num(points).astype(np.float32)
        light += np.asarray(cv2.remap(image, pixels[..., 0].copy(), pixels[..., 1].copy(), cv2.INTER_LINEAR)) / LINES
    extent = np.minimum(MIN_EXTENT_PX + stations.blur_px + 1.5 * smooth_px, MAX_EXTENT_PX)
    last = np.where(stations.has_neighbour, stations.gap_px, 0.0) + extent[:, 1]
    in_extent = (out_px >= offset_px[:, :1] - extent[:, :1]) & (out_px <= last[:, None] + offset_px[:, 1:])
    stray = 0.5 * float(np.quantile(image[::4, ::4], 0.002))
    texture = np.column_stack([_texture(light, inside & side) for side in _sides(out_px, stations, offset_px)])
    return Profiles(out_px, light, (inside & in_extent).astype(np.float64), texture, stray, stray + 2.0)


def _sides(
    out_px: FloatArray, stations: Stations, offset_px: FloatArray
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks (n, d) of positions well inside the mirror, and well inside its neighbour."""
    inside = out_px < offset_px[:, :1] - 0.7 * stations.blur_px[:, :1]
    inside_neighbour = out_px > stations.gap_px[:, None] + offset_px[:, 1:] + 0.7 * stations.blur_px[:, 1:]
    return inside & (out_px > -MAX_EXTENT_PX), inside_neighbour & (out_px < 1.5 * MAX_EXTENT_PX)


def _texture(light: FloatArray, inside: NDArray[np.bool_]) -> FloatArray:
    """Standard deviations (n,) of the masked light (n, d), plus a fraction of its mean."""
    count = np.maximum(inside.sum(axis=1), 1)
    mean = (light * inside).sum(axis=1) / count
    variance = ((light - mean[:, None]) ** 2 * inside).sum(axis=1) / count
    return np.asarray(np.sqrt(1.5 * variance) + MIN_TEXTURE * mean)


def edge_response(inside_px: FloatArray, radius_px: FloatArray, sigma_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fraction (n, d) of the light that passes an edge at distances (n, d) inside it, and its derivative.

    The blur is a disc with radii (n,), convolved with a Gaussian of standard deviations (n,).
    """
    radius, sigma = radius_px[:, None], np.maximum(sigma_px, radius_px / 8.0)[:, None]
    total, derivative = np.zeros_like(inside_px), np.zeros_like(inside_px)
    for chord, weight in zip(_CHORD, _WEIGHT, strict=True):
        z = (inside_px - radius * chord) / sigma
        total += weight * ndtr(z)
        derivative += weight * np.exp(-0.5 * z**2) / (sigma * np.sqrt(2.0 * np.pi))
    return total, derivative


def edge_residuals(
    measured: Profiles, stations: Stations, offset_px: FloatArray, slope: FloatArray, smooth_px: float
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals (n, d) of the best fit, and the model's derivatives (n, 2, d) for the offsets (n, 2).

    Offsets are measured along `outward` from the nominal edges. An edge with a slope (n, 2) against the nominal one is
    blurred by the average over its section. The light of each mirror is a constant, which is solved for, plus a random
    texture: correlated noise proportional to the fraction of light that passes the edge. Therefore, the dark gap
    between edges determines their positions. The derivatives are projected on the complement of the constants
    (Kaufman's variable projection).
    """
    section_sigma_px = np.abs(slope) * stations.section_px[:, None] / np.sqrt(12.0)
    sigma_px = np.sqrt(LENS_PX**2 + smooth_px**2 + section_sigma_px**2)
    out_px = measured.out_px[None]
    response, d_response = edge_response(offset_px[:, :1] - out_px, stations.blur_px[:, 0], sigma_px[:, 0])
    other_response, d_other = edge_response(
        out_px - stations.gap_px[:, None] - offset_px[:, 1:], stations.blur_px[:, 1], sigma_px[:, 1]
    )
    has_other = stations.has_neighbour[:, None].astype(np.float64)
    other_response, d_other = other_response * has_other, d_other * has_other
    cholesky = np.linalg.cholesky(_covariance(measured, (response, other_response), smooth_px))
    is_used = measured.weight > 0.0
    columns = np.stack([np.ones_like(response), response, other_response], axis=-1) * is_used[..., None]
    design = np.linalg.solve(cholesky, columns)
    light = np.linalg.solve(cholesky, ((measured.light - measured.stray) * is_used)[..., None])
    # The weak prior on both mirrors' light keeps the equations regular where a profile shows only one of them.
    prior = np.diag([1.0 / measured.stray_sigma**2, 1e-6, 1e-6])
    normal = np.swapaxes(design, 1, 2) @ design + prior
    levels = np.linalg.solve(normal, np.swapaxes(design, 1, 2) @ light)
    residual = (light - design @ levels)[..., 0]
    steps = np.maximum(levels[:, 1:, 0], 0.0)
    d_offset = np.stack([d_response * steps[:, :1], -d_other * steps[:, 1:]], axis=-1) * is_used[..., None]
    d_offset = np.linalg.solve(cholesky, d_offset)
    d_offset = d_offset - design @ np.linalg.solve(normal, np.swapaxes(design, 1, 2) @ d_offset)
    return residual, np.swapaxes(d_offset, 1, 2)


def _covariance(measured: Profiles, fractions: tuple[FloatArray, FloatArray], smooth_px: float) -> FloatArray:
    """Covariance (n, d, d) of the light: noise, and texture where light passes edges; 1 where the weight is 0."""
    lag_px = measured.out_px[:, None] - measured.out_px[None]
    correlation = np.zeros(lag_px.shape)
    for length in TEXTURE_PX:
        correlation += np.exp(-0.5 * lag_px**2 / (length**2 + 2.0 * smooth_px**2)) / len(TEXTURE_PX)
    total = np.zeros((len(measured.light), *lag_px.shape))
    for fraction, texture in zip(fractions, measured.texture.T, strict=True):
        sigma = (fraction + DARK) * texture[:, None]
        total += sigma[:, :, None] * sigma[:, None, :] * correlation
    is_used = measured.weight > 0.0
    total *= is_used[:, :, None] & is_used[:, None, :]
    noise = np.where(is_used, measured.noise**2, 1.0)
    total[:, np.arange(len(lag_px)), np.arange(len(lag_px))] += noise
    return total
