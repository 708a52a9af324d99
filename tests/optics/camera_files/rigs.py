"""A device, and rigs with known errors to score against it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.bench.scores.calibration_score import CalibrationScore, score_calibration
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.camera_rig import CameraRig, RigCamera
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.layouts import faceted_parabola

DISTANCE_MM = 450.0
EXACT = 1e-6


@dataclass(frozen=True)
class Device:
    """A device as built, and its design."""

    truth: Layout
    nominal: Layout

    def score(self, rig: CameraRig, **options: Any) -> CalibrationScore:
        """The score of a calibration of it."""
        return score_calibration(rig, self.truth, self.nominal, DISTANCE_MM, **options)


@cache
def device(
    lens_model: str = "brown_conrady", distortion: tuple[float, ...] = (0.08, -0.11, 1.2e-3, -8e-4, 0.0)
) -> Device:
    """Six tilted and shifted mirrors in front of a decentred lens."""
    camera = Camera.model_validate(
        {
            "width_px": 960,
            "height_px": 600,
            "fx_px": 700.0,
            "fy_px": 705.0,
            "cx_px": 470.3,
            "cy_px": 305.8,
            "lens_model": lens_model,
            "distortion": list(distortion),
        }
    )
    spec = DesignSpec(camera=camera, rows=2, cols=3, depths_mm=(350.0, 600.0))
    nominal = faceted_parabola(camera, spec, fill=0.85)
    random = np.random.default_rng(7)
    mirrors = tuple(
        mirror.moved(Rotation.from_rotvec(random.normal(0, np.deg2rad(0.6), 3)).as_matrix(), random.normal(0, 0.8, 3))
        for mirror in nominal.mirrors
    )
    return Device(nominal.replaced(kind="as-built", mirrors=mirrors), nominal)


def true_rig(truth: Layout, unit_mm: float | None = 1.0) -> CameraRig:
    """The exact calibration: the mirrors as cameras of the flipped frame."""
    cameras = tuple(
        RigCamera(view.name, view.camera, view.camera_from_rig, (view.camera.width_px, view.camera.height_px))
        for view in virtual_cameras(truth)
    )
    return CameraRig("test", cameras, unit_mm)


def changed(rig: CameraRig, number: int, **changes: Any) -> CameraRig:
    """The rig with one camera changed."""
    cameras = list(rig.cameras)
    cameras[number] = replace(cameras[number], **changes)
    return replace(rig, cameras=tuple(cameras))


def pose_of(camera: RigCamera) -> FloatArray:
    """The pose (4, 4) of a posed camera."""
    assert camera.camera_from_rig is not None
    return camera.camera_from_rig


def lens_of(camera: RigCamera) -> Camera:
    """The lens of a pinhole camera."""
    assert isinstance(camera.lens, Camera)
    return camera.lens


def moved(rig: CameraRig, rig_from_true: FloatArray) -> CameraRig:
    """The rig in a frame `moved` from the true one: it projects moved points as the original projects true ones."""
    inverse = np.linalg.inv(rig_from_true)
    cameras = []
    for camera in rig.cameras:
        pose = pose_of(camera) @ inverse
        size = np.cbrt(abs(np.linalg.det(pose[:3, :3])))
        cameras.append(replace(camera, camera_from_rig=rigid(pose[:3, :3] / size, pose[:3, 3] / size)))
    return replace(rig, cameras=tuple(cameras))


def with_random_poses(rig: CameraRig, size: float, seed: int = 0) -> CameraRig:
    """The rig with every camera rotated and shifted at random, by about `size`."""
    random = np.random.default_rng(seed)
    cameras = []
    for camera in rig.cameras:
        turn = Rotation.from_rotvec(size * 2e-4 * random.normal(size=3)).as_matrix()
        step = rigid(turn, size * 0.05 * random.normal(size=3))
        cameras.append(replace(camera, camera_from_rig=step @ pose_of(camera)))
    return replace(rig, cameras=tuple(cameras))
