"""Rendered frames of second-surface mirrors that differ slightly from the nominal ones."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from tests.optics.layouts import faceted_parabola

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
BOARD = Charuco(cols=16, rows=11, square_mm=14.0, marker_mm=8.75)
FRONT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)


def second_surface(mirror: Mirror) -> Mirror:
    return Mirror.second_surface(
        mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=3.0, refractive_index=1.49
    )


NOMINAL = FRONT.replaced(mirrors=tuple(second_surface(mirror) for mirror in FRONT.mirrors), spec=None)


@dataclass(frozen=True)
class PlateFrames:
    """Pictures, the true layout, poses (frames, 4, 4) and corners (frames, mirrors, corners, 2) in px."""

    pictures: list[Grey]
    layout: Layout
    rig_from_board: FloatArray
    corners_px: FloatArray


def rendered_frames(folder: Path) -> PlateFrames:
    request = SetRequest(
        layout=NOMINAL,
        board=BOARD,
        frames=3,
        base_frames=0,
        seed=3,
        tolerances=Tolerances(tilt_deg=0.5),
        settings=RenderSettings(renderer="fast", sensor=SENSORS["c920"], maps=False),
    )
    dataset = render_set(request, folder)
    poses = json.loads((folder / "truth" / "poses.json").read_text())["frames"]
    with np.load(folder / "truth" / "corners.npz") as truth:
        corners_px = truth["frames_px"]
    pictures = [read_image(folder / name, grey=True) for name in dataset.frame_names]
    return PlateFrames(pictures, Layout.load(folder / "truth" / "layout.json"), np.array(poses), corners_px)
