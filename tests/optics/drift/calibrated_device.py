"""A device of nine mirrors as built, and its calibration from simulated corners; and mirrors turned on purpose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.calibration.synthetic_corners import as_built, direct_poses, mirrored_poses, views_of
from tests.optics.layouts import faceted_parabola

BOARD = Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=16.0)


@dataclass(frozen=True)
class Device:
    """A device as built, and as calibrated."""

    truth: Layout
    calibrated: Layout


@cache
def device(rows: int = 3, cols: int = 3, noise_px: float = 0.03) -> Device:
    """A device whose camera has half the resolution of a C920, calibrated from 17 frames of corners with noise."""
    camera = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
    nominal = faceted_parabola(camera, DesignSpec(camera=camera, rows=rows, cols=cols), fill=0.9)
    truth = as_built(nominal, seed=3)
    poses = mirrored_poses(BOARD, 12, tilt_deg=30, seed=1), direct_poses(BOARD, 5, tilt_deg=30, seed=2)
    views = views_of(truth, BOARD, *poses, noise_px=noise_px)
    found = calibrate_corners(views.mirrored, views.base, nominal, BOARD.corners_in_board_mm, model=RequestedModel())
    return Device(truth, found.layout)


def turned(layout: Layout, index: int, turn_deg: FloatArray, shift_mm: float = 0.0) -> Layout:
    """The layout with one mirror turned about its middle by a rotation vector (3,), and shifted along its normal."""

    def moved(mirror: Mirror) -> Mirror:
        rotation = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
        return mirror.moved(rotation, shift_mm * mirror.normal_in_rig)

    mirrors = tuple(moved(mirror) if k == index else mirror for k, mirror in enumerate(layout.mirrors))
    return layout.replaced(mirrors=mirrors)


def across(layout: Layout, index: int, size_deg: float, random: np.random.Generator) -> FloatArray:
    """A rotation vector (3,) of given size about a random axis in a mirror's plane."""
    normal = layout.mirrors[index].normal_in_rig
    axis = random.normal(size=3)
    axis -= (axis @ normal) * normal
    return np.asarray(size_deg * axis / np.linalg.norm(axis))


def turn_error_deg(layout: Layout, truth: Layout, index: int) -> float:
    """Angle between the normals of a mirror in two layouts."""
    one, other = (each.mirrors[index].normal_in_rig for each in (layout, truth))
    return float(np.degrees(np.linalg.norm(np.cross(one, other))))
