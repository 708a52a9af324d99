"""Design, build, render, calibrate and decode a light field camera made of a webcam and flat mirrors.

The names of this package are the public API: `import mirrorcam`, then `mirrorcam.design(mirrorcam.DesignSpec())`.
Importing it is cheap: a name is looked up in its module when it is first used. See docs/library.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.2.0"

__all__ = [
    "Adapter",
    "AprilGrid",
    "ArrivedFrame",
    "CalibratedCamera",
    "Calibration",
    "Camera",
    "CameraBag",
    "Charuco",
    "Checkerboard",
    "Dataset",
    "Decoder",
    "DepthEstimator",
    "DepthMap",
    "DesignSpec",
    "Fastener",
    "Frame",
    "InfeasibleDesign",
    "InputError",
    "Layout",
    "LightField",
    "LiveCamera",
    "Lost",
    "Metric",
    "Mirror",
    "MountFace",
    "NewestFrame",
    "RenderSettings",
    "RequestedModel",
    "SceneObject",
    "SensorModel",
    "SetRequest",
    "TargetDesigns",
    "Tolerances",
    "Uncertainty",
    "Validation",
    "Video",
    "VideoDepth",
    "Views",
    "build_parts",
    "calibrate",
    "calibrate_camera",
    "calibrate_from_corners",
    "design",
    "designs_for",
    "estimate_depth",
    "load_board",
    "open_camera",
    "open_light_field",
    "open_video",
    "read_image",
    "render_frame",
    "render_set",
    "validate",
    "write_light_field",
]

if TYPE_CHECKING:
    from mirrorcam.cad.backs.adapter import Adapter, Fastener, MountFace
    from mirrorcam.cad.build import build_parts
    from mirrorcam.calibration.validation import Validation, validate
    from mirrorcam.core.errors import InputError
    from mirrorcam.core.images.pictures import read_image
    from mirrorcam.core.values import Metric
    from mirrorcam.core.video.camera_addresses import open_camera
    from mirrorcam.core.video.camera_bag import CameraBag
    from mirrorcam.core.video.frames import Frame, Lost
    from mirrorcam.core.video.live_camera import LiveCamera
    from mirrorcam.core.video.newest_frame import ArrivedFrame, NewestFrame
    from mirrorcam.core.video.video import Video
    from mirrorcam.core.video.video_files import open_video
    from mirrorcam.designs.target_search import TargetDesigns, designs_for
    from mirrorcam.optics.calibration.calibration import calibrate
    from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
    from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
    from mirrorcam.optics.calibration.given_corners import calibrate_from_corners
    from mirrorcam.optics.calibration.plain_camera import calibrate_camera
    from mirrorcam.optics.design.optimise import design
    from mirrorcam.optics.geometry.boards import AprilGrid, Charuco, Checkerboard, load_board
    from mirrorcam.optics.geometry.calibrated_camera import CalibratedCamera
    from mirrorcam.optics.geometry.camera import Camera
    from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
    from mirrorcam.optics.geometry.layout import Layout, Uncertainty
    from mirrorcam.optics.geometry.mirror import Mirror
    from mirrorcam.optics.geometry.tolerances import Tolerances
    from mirrorcam.optics.light_field.decoder import Decoder
    from mirrorcam.optics.light_field.depth.depth_map import DepthMap
    from mirrorcam.optics.light_field.depth.estimate import DepthEstimator, estimate_depth
    from mirrorcam.optics.light_field.depth.video import VideoDepth
    from mirrorcam.optics.light_field.io.formats.registry import open_light_field, write_light_field
    from mirrorcam.optics.light_field.light_field import LightField, Views
    from mirrorcam.render_scenes.sets.dataset import Dataset
    from mirrorcam.render_scenes.sets.render_set import render_set
    from mirrorcam.render_scenes.sets.set_request import SetRequest
    from mirrorcam.render_scenes.settings import RenderSettings, SensorModel
    from mirrorcam.render_scenes.tabletop.objects import SceneObject
    from mirrorcam.render_scenes.tabletop.single_frame import render_frame
else:
    # The same for the interpreter, which imports a module when one of its names is first used.
    _MODULES = {
        "Adapter": "cad.backs.adapter",
        "AprilGrid": "optics.geometry.boards",
        "ArrivedFrame": "core.video.newest_frame",
        "CalibratedCamera": "optics.geometry.calibrated_camera",
        "Calibration": "optics.calibration.diagnostics.calibration_result",
        "Camera": "optics.geometry.camera",
        "Charuco": "optics.geometry.boards",
        "Checkerboard": "optics.geometry.boards",
        "Dataset": "render_scenes.sets.dataset",
        "Decoder": "optics.light_field.decoder",
        "DepthEstimator": "optics.light_field.depth.estimate",
        "DepthMap": "optics.light_field.depth.depth_map",
        "DesignSpec": "optics.geometry.design_spec",
        "Fastener": "cad.backs.adapter",
        "Frame": "core.video.frames",
        "InfeasibleDesign": "optics.geometry.design_spec",
        "InputError": "core.errors",
        "Layout": "optics.geometry.layout",
        "LightField": "optics.light_field.light_field",
        "LiveCamera": "core.video.live_camera",
        "Lost": "core.video.frames",
        "Metric": "core.values",
        "Mirror": "optics.geometry.mirror",
        "MountFace": "cad.backs.adapter",
        "NewestFrame": "core.video.newest_frame",
        "RenderSettings": "render_scenes.settings",
        "RequestedModel": "optics.calibration.diagnostics.requested_model",
        "SceneObject": "render_scenes.tabletop.objects",
        "SensorModel": "render_scenes.settings",
        "SetRequest": "render_scenes.sets.set_request",
        "TargetDesigns": "designs.target_search",
        "Tolerances": "optics.geometry.tolerances",
        "Uncertainty": "optics.geometry.layout",
        "Validation": "calibration.validation",
        "Video": "core.video.video",
        "open_video": "core.video.video_files",
        "CameraBag": "core.video.camera_bag",
        "VideoDepth": "optics.light_field.depth.video",
        "Views": "optics.light_field.light_field",
        "build_parts": "cad.build",
        "calibrate": "optics.calibration.calibration",
        "calibrate_camera": "optics.calibration.plain_camera",
        "calibrate_from_corners": "optics.calibration.given_corners",
        "design": "optics.design.optimise",
        "designs_for": "designs.target_search",
        "estimate_depth": "optics.light_field.depth.estimate",
        "load_board": "optics.geometry.boards",
        "open_camera": "core.video.camera_addresses",
        "open_light_field": "optics.light_field.io.formats.registry",
        "read_image": "core.images.pictures",
        "render_frame": "render_scenes.tabletop.single_frame",
        "render_set": "render_scenes.sets.render_set",
        "validate": "calibration.validation",
        "write_light_field": "optics.light_field.io.formats.registry",
    }

    def __getattr__(name):
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        return [*__all__, *(name for name in globals() if name.startswith("__"))]
