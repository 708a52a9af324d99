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
    "Camera",
    "Charuco",
    "Checkerboard",
    "Decoder",
    "DesignSpec",
    "Fastener",
    "InputError",
    "Layout",
    "LightField",
    "MountFace",
    "RenderSettings",
    "RequestedModel",
    "SetRequest",
    "build_parts",
    "calibrate",
    "calibrate_camera",
    "design",
    "estimate_depth",
    "open_light_field",
    "read_image",
    "render_set",
    "validate",
    "write_light_field",
]

if TYPE_CHECKING:
    from mirrorcam.cad.backs.adapter import Adapter, Fastener, MountFace
    from mirrorcam.cad.build import build_parts
    from mirrorcam.calibration.validation import validate
    from mirrorcam.core.errors import InputError
    from mirrorcam.core.images.pictures import read_image
    from mirrorcam.optics.calibration.calibration import calibrate
    from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
    from mirrorcam.optics.calibration.plain_camera import calibrate_camera
    from mirrorcam.optics.design.optimise import design
    from mirrorcam.optics.geometry.camera import Camera
    from mirrorcam.optics.geometry.design_spec import DesignSpec
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.optics.geometry.targets import AprilGrid, Charuco, Checkerboard
    from mirrorcam.optics.light_field.decoder import Decoder
    from mirrorcam.optics.light_field.depth.estimate import estimate_depth
    from mirrorcam.optics.light_field.io.formats.registry import open_light_field, write_light_field
    from mirrorcam.optics.light_field.light_field import LightField
    from mirrorcam.render_scenes.sets.render_set import render_set
    from mirrorcam.render_scenes.sets.set_request import SetRequest
    from mirrorcam.render_scenes.settings import RenderSettings
else:
    # The same for the interpreter, which imports a module when one of its names is first used.
    _MODULES = {
        "Adapter": "cad.backs.adapter",
        "Camera": "optics.geometry.camera",
        "AprilGrid": "optics.geometry.targets",
        "Charuco": "optics.geometry.targets",
        "Checkerboard": "optics.geometry.targets",
        "Decoder": "optics.light_field.decoder",
        "DesignSpec": "optics.geometry.design_spec",
        "Fastener": "cad.backs.adapter",
        "InputError": "core.errors",
        "Layout": "optics.geometry.layout",
        "LightField": "optics.light_field.light_field",
        "MountFace": "cad.backs.adapter",
        "RenderSettings": "render_scenes.settings",
        "RequestedModel": "optics.calibration.diagnostics.requested_model",
        "SetRequest": "render_scenes.sets.set_request",
        "build_parts": "cad.build",
        "calibrate": "optics.calibration.calibration",
        "calibrate_camera": "optics.calibration.plain_camera",
        "design": "optics.design.optimise",
        "estimate_depth": "optics.light_field.depth.estimate",
        "open_light_field": "optics.light_field.io.formats.registry",
        "read_image": "core.images.pictures",
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
        return sorted({*globals(), *_MODULES})
