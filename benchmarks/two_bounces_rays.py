"""Rays through an arrangement of mirrors, followed from its corner points alone: what it shows and what it blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.two_bounces_chains import THICKNESS_MM, Found
from mirrorcam.core.values import FloatArray

RIM = 8
"""Points on the rim of the pupil from which rays of a pixel start, besides its middle."""
FAR_MM = 1e9


@dataclass(frozen=True)
class Traced:
    """What rays on an even grid of pixels show.

    Attributes
    ----------
    usable
        Share of the sensor, one of each depth, whose whole pupil meets the mirrors of one view, in their order and
        nothing else, and then the common region.
    blocked
        Share of the rays of those pixels of the cells that see a region and that go astray. 0 in a sound arrangement.
    """

    usable: FloatArray
    blocked: float


def _faces(found: Found) -> FloatArray:
    """Corners (mirrors, 4, 3) of all reflecting faces, followed by those of their backs."""
    fronts = np.concatenate([chain.outlines_mm for chain in found.chains])
    normals = np.concatenate([chain.normals for chain in found.chains])
    return np.concatenate([fronts, fronts + THICKNESS_MM * normals[:, None]])


def first_met(faces: FloatArray, origins: FloatArray, ways: FloatArray) -> tuple[NDArray[np.int_], FloatArray]:
    """Which face (n,) each ray meets first, -1 for none, and how far away."""
    met, nearest = np.full(len(origins), -1), np.full(len(origins), FAR_MM)
    for k, corners in enumerate(faces):
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = ((corners[0] - origins) @ normal) / (ways @ normal)
        points = origins + np.nan_to_num(reach, posinf=0.0, neginf=0.0)[:, None] * ways
        sides = np.array([np.cross(corners[(j + 1) % 4] - corners[j], points - corners[j]) @ normal for j in range(4)])
        hit = (sides >= 0.0).all(axis=0) & (reach > 1e-6) & (reach < nearest)
        met[hit], nearest[hit] = k, reach[hit]
    return met, nearest


def traced(found: Found, columns: int = 96) -> Traced:
    """Follow rays from the pupil, in focus where the camera's lens is, to both regions."""
    q = found.question
    faces = _faces(found)
    mirrors = len(faces) // 2
    rows = round(columns * q.half_field[1] / q.half_field[0])
    u, v = ((np.arange(n) + 0.5) / n * 2.0 - 1.0 for n in (columns, rows))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) * q.half_field
    angles = 2.0 * np.pi * np.arange(RIM) / RIM
    pupil = q.camera.pupil
    starts = np.vstack([np.zeros(2), pupil.radius_mm * np.column_stack([np.cos(angles), np.sin(angles)])])
    origins = np.tile(np.column_stack([starts, np.zeros(RIM + 1)]), (len(pixels), 1))
    focus = np.repeat(np.column_stack([pixels, np.ones(len(pixels))]) * pupil.focus_mm, RIM + 1, axis=0)
    ways = focus - origins
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    order = []
    for _ in range(q.bounces):
        met, reach = first_met(faces, origins, ways)
        order.append(met)
        going = met >= 0
        corners = faces[np.maximum(met, 0)]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        origins = np.where(going[:, None], origins + np.minimum(reach, 1e6)[:, None] * ways, origins)
        ways = np.where(going[:, None], ways - 2.0 * (ways * normal).sum(axis=1, keepdims=True) * normal, ways)
    views = np.where(order[0] < mirrors, order[0] // q.bounces, -1)
    right = views >= 0
    for bounce, met in enumerate(order):
        right &= met == views * q.bounces + bounce
    free = first_met(faces, origins, ways)[0] < 0
    whole = (right & free).reshape(-1, RIM + 1).all(axis=1)
    chief = slice(0, None, RIM + 1)
    usable, expected = [], np.zeros(len(pixels), bool)
    for region in found.regions_mm:
        normal = np.cross(region[1] - region[0], region[2] - region[0])
        reach = ((region[0] - origins[chief]) @ normal) / (ways[chief] @ normal)
        shown = _inside(region, origins[chief] + reach[:, None] * ways[chief], normal) & (reach > 0.0)
        usable.append(float((whole & shown).mean()))
        for chain in found.chains:
            seen = np.column_stack([chain.normalized(region), np.zeros(4)])
            expected |= _inside(seen, np.column_stack([pixels, np.zeros(len(pixels))]), None)
    return Traced(np.array(usable), float((expected & ~whole).sum() / max(expected.sum(), 1)))


def _inside(corners: FloatArray, points: FloatArray, normal: FloatArray | None) -> NDArray[np.bool_]:
    if normal is None:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return np.all(
        [np.cross(corners[(j + 1) % 4] - corners[j], points - corners[j]) @ normal >= 0.0 for j in range(4)], axis=0
    )
