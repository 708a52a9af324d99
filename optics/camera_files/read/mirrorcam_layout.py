"""Our own `layout.json`: the base camera and its mirrors, each mirror as a camera of frames as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mirrorcam.optics.camera_files.camera_rig import CameraRig, MirrorProjection, RigCamera
from mirrorcam.optics.camera_files.write.virtual_cameras import view_name
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

FORMAT = "mirrorcam"


def is_layout(value: Any) -> bool:
    """Whether the value of a JSON file is a layout."""
    return isinstance(value, dict) and str(value.get("schema", "")).startswith("mirrorcam.layout/")


def read_layout(path: Path) -> CameraRig:
    """The mirrors of a layout as cameras; raises InputError in one line where it is none."""
    return rig_of(Layout.load(path))


def rig_of(layout: Layout) -> CameraRig:
    """The mirrors of a layout as cameras whose poses are reflections; its covariance stays that of its parameters."""
    size = layout.camera.width_px, layout.camera.height_px
    cameras = []
    for number, mirror in enumerate(layout.mirrors):
        apparent = mirror.apparent
        pose = rigid(apparent.reflection, apparent.virtual_centre_in_rig_mm)
        name = view_name(*divmod(number, layout.cols))
        cameras.append(RigCamera(name, MirrorProjection(layout.camera, mirror), pose, size))
    return CameraRig(
        FORMAT, tuple(cameras), unit_mm=1.0, pictures="as-is", uncertainty=layout.uncertainty, layout=layout
    )
