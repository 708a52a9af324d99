"""Devices with known build errors, for tests and benchmarks of the alignment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.alignment import view_rotation_signs
from mirrorcam.optics.alignment.build_errors import CAMERA_ERRORS, RIGID_ERRORS, BuildErrors, BuiltDevice
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

PER_SIDE = 16
"""Points of an outline per side, between which its image is straight."""


def built(layout: Layout, errors: BuildErrors, units: FloatArray) -> Layout:
    """The device of first-surface mirrors whose errors are given in standard deviations (p,), as `BuiltDevice` does."""
    device = BuiltDevice(layout, errors)
    sized = units * device.sigma
    turn = Rotation.from_rotvec(sized[3:6]).as_matrix()
    mirrors = []
    for mirror, start in zip(layout.mirrors, device.starts, strict=False):
        rigid, cut = np.split(sized[start : start + RIGID_ERRORS + len(mirror.outline_in_rig_mm)], [RIGID_ERRORS])
        flat = np.column_stack([recut(mirror.outline_in_plane_mm, cut), np.zeros(len(cut))])
        frame = mirror.rig_from_plane
        moved = Rotation.from_rotvec(rigid[:3]).as_matrix()
        corners = (flat @ moved.T + rigid[3:]) @ frame[:3, :3].T + frame[:3, 3]
        corners = (corners - sized[:3]) @ turn
        normal = turn.T @ frame[:3, :3] @ moved[:, 2]
        corners -= ((corners - corners.mean(axis=0)) @ normal)[:, None] * normal
        mirrors.append(
            Mirror.from_plane(corners.mean(axis=0), normal, outline_in_rig_mm=corners, thickness_mm=mirror.thickness_mm)
        )
    intrinsics = layout.camera.intrinsics.copy()
    intrinsics[:2] *= 1.0 + sized[6]
    intrinsics[2:6] += sized[7:CAMERA_ERRORS]
    return layout.replaced(
        kind="as-built",
        camera=layout.camera.with_intrinsics(intrinsics),
        mirrors=tuple(mirrors),
        view_from_rig=layout.view_from_rig @ turn,
        metrics={},
        verdict={},
    )


def recut(outline: FloatArray, out_mm: FloatArray) -> FloatArray:
    """A convex outline (n, 2) whose edges are moved outwards by distances (n,)."""
    along = np.roll(outline, -1, axis=0) - outline
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    normal *= np.sign((normal * (outline - outline.mean(axis=0))).sum(axis=1))[:, None]
    offset = (normal * outline).sum(axis=1) + out_mm
    pairs = [np.linalg.solve(normal[[k - 1, k]], offset[[k - 1, k]]) for k in range(len(outline))]
    return np.array(pairs)


def tilts_deg(layout: Layout, errors: BuildErrors, units: FloatArray) -> FloatArray:
    """True tilts (mirrors, 2) to the right and down, as `MirrorTilt` states them."""
    device = BuiltDevice(layout, errors)
    found = []
    for k in range(len(layout.mirrors)):
        about_x, about_y = np.degrees((units * device.sigma)[device.tilts(k)])
        right, down = view_rotation_signs(layout, k)
        found.append([right * about_y, down * about_x])
    return np.array(found)


def sheet(layout: Layout, grey: float = 150.0, noise: float = 1.0) -> NDArray[np.float32]:
    """A frame (h, w) of a white sheet that fills all views of a pinhole camera, with noise, and stray light of 3.

    Edges are as sharp as a lens and pixels make them, at their exact positions.
    """
    camera = layout.camera
    sigma_px = np.hypot(0.8, 1.0 / np.sqrt(12.0))
    light = np.zeros((camera.height_px, camera.width_px))
    for k, mirror in enumerate(layout.mirrors):
        outline = layout.outline_px(k, PER_SIDE)
        first = np.maximum(outline.min(axis=0) - 5.0, 0.0).astype(int)
        last = np.minimum(outline.max(axis=0) + 6.0, [camera.width_px, camera.height_px]).astype(int)
        window = np.s_[first[1] : last[1], first[0] : last[0]]
        pixels = np.stack(np.meshgrid(*(np.arange(*ends) for ends in zip(first, last, strict=True))), axis=-1)
        shown = np.ones(light[window].shape)
        for side in range(len(mirror.outline_in_rig_mm)):
            points = np.take(outline, np.arange(PER_SIDE + 1) + PER_SIDE * side, axis=0, mode="wrap")
            along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
            inward = np.array([-along[1], along[0]])
            inward *= np.sign(inward @ (outline.mean(axis=0) - points[0]))
            bow = np.interp((pixels - points[0]) @ along, (points - points[0]) @ along, (points - points[0]) @ inward)
            shown *= ndtr(((pixels - points[0]) @ inward - bow) / sigma_px)
        light[window] = np.minimum(light[window] + shown, 1.0)  # a mirror hides what it overlaps
    noisy = grey * light + 3.0 + np.random.default_rng(0).normal(0.0, noise, light.shape)
    return noisy.clip(0.0).astype(np.float32)
