"""A sound calibration of four mirrors from simulated corners, made once for all tests of a process."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.synthetic_corners import as_built, direct_poses, mirrored_poses, views_of
from tests.optics.layouts import faceted_parabola

BOARD = Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=16.0)
NOISE_PX = 0.05


def nominal_layout() -> Layout:
    """The design of the device."""
    camera = Camera.c920()
    return faceted_parabola(camera, DesignSpec(camera=camera, rows=2, cols=2), fill=0.9)


@cache
def true_layout() -> Layout:
    """The device as built."""
    return as_built(nominal_layout(), seed=3)


@cache
def board_poses() -> tuple[list[FloatArray], list[FloatArray]]:
    """True poses of the boards before the mirrors, and before the bare camera."""
    return mirrored_poses(BOARD, 12, tilt_deg=30, seed=1), direct_poses(BOARD, 5, tilt_deg=30, seed=2)


@cache
def sound_calibration() -> Calibration:
    """The calibration from corners of all boards, with noise."""
    views = views_of(true_layout(), BOARD, *board_poses(), noise_px=NOISE_PX)
    return calibrate_corners(views.mirrored, views.base, nominal_layout(), BOARD.corners_in_board_mm)


def rows_of(calibration: Calibration, keep: np.ndarray) -> Calibration:
    """Return the calibration with only some of the corners (n,)."""
    return replace(
        calibration,
        observations=calibration.observations.where(keep),
        residuals_px=calibration.residuals_px[keep],
        inliers=calibration.inliers[keep],
    )
