"""`mirrorcam cameras`: every mirror of a layout as a camera for other tools."""

from __future__ import annotations

import glob
from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import say
from mirrorcam.core.values import Value


class CamerasOptions(Value):
    """Export every mirror as a camera for OpenCV, ROS, Kalibr, COLMAP, nerfstudio, URDF, Anipose and DeepLabCut."""

    layout: tyro.conf.Positional[Path] = Field(description="layout.json, calibrated if possible")
    pictures: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PICTURE...", help_behavior_hint="")] = Field(
        default=(), description="frames of the camera, or folders of them, to write flipped and masked for COLMAP"
    )
    out: Path = Field(default=Path("output/cameras"), description="folder for the files; its README.md explains them")
    force: bool = FORCE


def run(options: CamerasOptions) -> int:
    """Write the cameras."""
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.images.picture_data import EXPECTED
    from mirrorcam.core.images.pictures import is_picture, pictures_in
    from mirrorcam.core.values import InputError
    from mirrorcam.optics.camera_files.write.write_exports import export_names, write_exports
    from mirrorcam.optics.geometry.layout import Layout

    layout, pictures = Layout.load(options.layout), pictures_in(options.pictures, lambda line: say("cameras", line))
    for path in pictures:
        if not is_picture(path):
            raise InputError(f"{path}: no picture, expected {EXPECTED} frames or folders of them, not videos")
    with output_folder(options.out, "cameras", force=options.force) as output:
        output.refuse_others(*(glob.escape(name) for name in export_names(layout, pictures)))
        with output.staged() as folder:
            write_exports(layout, folder, pictures)
    tools = "OpenCV, ROS, Kalibr, COLMAP, nerfstudio, URDF, Anipose and DeepLabCut"
    say("cameras", f"files for {tools} written to {options.out}")
    return 0
