"""Errors of a calibration by gravity, warmth and creep, in degrees of the mirrors and in pixels of their images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.cad.checks.elasticity.device_motions import DeviceMotions
from mirrorcam.cad.checks.elasticity.plastics import PLASTICS, STEEL_PER_K, Plastic
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import GravityTable, MirrorMotion, image_shifts_px

WARMER_K = 10.0
# A correction by the table leaves so much of gravity's part: the modulus of prints is known to a fifth at best.
LEFT_BY_TABLE = 0.2
# Images are linear in motions as small as these: derivatives by motions this much smaller.
STEP = 0.1


@dataclass(frozen=True)
class Error:
    """Turn in deg of the mirror that turns most against the camera; shift in px of the image that moves most.

    `apart_px` is the largest shift that is left where the motion of all mirrors as one body is estimated from pictures.
    """

    deg: float
    px: float
    apart_px: float

    def times(self, factor: float) -> Error:
        return Error(self.deg * factor, self.px * factor, self.apart_px * factor)


@dataclass(frozen=True)
class Errors:
    """Of one plastic: what the device does that its calibration does not know.

    `gravity` is for turning the device from no gravity to 1 g in the worst direction (from one side to the other it is
    twice that); `corrected` what is left of it by the table; `warmth` for 10 K, `creep` for 1000 h in the worst
    direction. `mirrors_warmth_deg` is the turn of each mirror for 10 K.
    """

    plastic: Plastic
    gravity: Error
    corrected: Error
    warmth: Error
    creep: Error
    mirrors_warmth_deg: Mapping[str, float]


def errors_of(layout: Layout, motions: DeviceMotions, depth_mm: float, plastic: Plastic) -> Errors:
    """The errors of a device of one plastic, of scene points at a depth in view axes."""
    weighed = motions.under_gravity(plastic.modulus_mpa, plastic.density_g_per_cm3)
    gravity = Error(_worst_turn_deg(weighed), *_worst_shifts_px(layout, weighed, depth_mm))
    warm = motions.of_strain(plastic.strain_per_k * WARMER_K, STEEL_PER_K * WARMER_K, motions.mirror_per_k * WARMER_K)
    warmth = {name: motion[:, None] for name, motion in warm.items()}
    return Errors(
        plastic=plastic,
        gravity=gravity,
        corrected=gravity.times(LEFT_BY_TABLE),
        warmth=Error(_worst_turn_deg(warmth), *_worst_shifts_px(layout, warmth, depth_mm)),
        creep=gravity.times(plastic.creep),
        mirrors_warmth_deg={name: float(np.degrees(np.linalg.norm(motion[3:]))) for name, motion in warm.items()},
    )


def all_errors(layout: Layout, motions: DeviceMotions, depth_mm: float) -> tuple[Errors, ...]:
    """The errors with each plastic of the table."""
    return tuple(errors_of(layout, motions, depth_mm, plastic) for plastic in PLASTICS)


def gravity_table(layout: Layout, motions: DeviceMotions, plastic: Plastic) -> GravityTable:
    """What a robot needs to correct the layout for a pose."""
    mirrors = {}
    weighed = motions.under_gravity(plastic.modulus_mpa, plastic.density_g_per_cm3)
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        motion = weighed[name]
        normal, middle, distance = mirror.normal_in_rig, mirror.rig_from_plane[:3, 3], mirror.distance_mm
        # The plane is n.x = -d, its virtual centre -2 d n.
        by_normal = np.cross(motion[3:], normal, axisa=0).T
        by_distance = -(normal @ motion[:3] + middle @ by_normal)
        plane = -2.0 * (np.outer(normal, by_distance) + distance * by_normal)
        mirrors[name] = MirrorMotion(shift_mm=motion[:3], turn_rad=motion[3:], plane_mm=plane)
    return GravityTable(mirrors=mirrors, plastic=plastic.name, modulus_mpa=plastic.modulus_mpa)


def _worst_turn_deg(motions: Mapping[str, FloatArray]) -> float:
    return float(np.degrees(max(np.linalg.norm(motion[3:], ord=2) for motion in motions.values())))


def _worst_shifts_px(layout: Layout, motions: Mapping[str, FloatArray], depth_mm: float) -> tuple[float, float]:
    """Of motions (6, k) of each mirror per unit of k loads: the largest shift for a unit vector of these.

    Second, what is left of it where the motion of all mirrors as one body is estimated from pictures, as `drift` does.
    """
    shifts = _shifts_px(layout, motions, depth_mm)
    together = {}
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        turned = np.cross(np.eye(3), mirror.rig_from_plane[:3, 3]).T
        together[name] = np.block([[np.eye(3), turned], [np.zeros((3, 3)), np.eye(3)]]) * [*[1.0] * 3, *[1e-2] * 3]
    common = _shifts_px(layout, together, depth_mm)
    left = shifts - common @ np.linalg.lstsq(common, shifts, rcond=None)[0]
    whole, apart = (
        float(np.linalg.norm(each.reshape(-1, 2, each.shape[1]), ord=2, axis=(1, 2)).max()) for each in (shifts, left)
    )
    return whole, apart


def _shifts_px(layout: Layout, motions: Mapping[str, FloatArray], depth_mm: float) -> FloatArray:
    """Shifts of images (2 n, k) in px per unit of each load: x and y of every point."""
    columns = []
    for load in range(next(iter(motions.values())).shape[1]):
        mirrors = tuple(
            mirror.moved(
                Rotation.from_rotvec(STEP * motions[name][3:, load]).as_matrix(), STEP * motions[name][:3, load]
            )
            for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)
        )
        moved = layout.replaced(kind="as-built", mirrors=mirrors, metrics={}, verdict={})
        columns.append(np.vstack(image_shifts_px(layout, moved, depth_mm)).ravel() / STEP)
    return np.stack(columns, axis=-1)
