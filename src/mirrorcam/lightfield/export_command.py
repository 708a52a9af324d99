"""`mirrorcam export`: light fields from and to the files of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import say
from mirrorcam.lightfield.light_fields import GeometryOptions
from mirrorcam.optics.light_field.io.formats.registry import NAMES

if TYPE_CHECKING:
    FormatName = str
else:
    FormatName = Literal[NAMES]


class ExportOptions(GeometryOptions):
    """Convert a light field between formats; the format it is in is detected from its name and contents."""

    light_field: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LIGHTFIELD")] = Field(
        description=(
            ".npz, .zarr or .mcap of mirrorcam decode, .mat of the Light Field Toolbox, ESLF or tiled .png, or a "
            "folder in the format of HCI, the Stanford gantry, plenpy, PlenoptiCam, COLMAP or nerfstudio"
        ),
    )
    to: FormatName = Field(
        description=(
            "format to write. lftoolbox: .mat with H and weights; hci, stanford: folders of pictures; eslf, tiles: "
            "one .png; mcap: a ROS 2 bag; plenpy, plenopticam: .npy; colmap: rig and masks; nerfstudio: "
            "transforms.json; ply: points in mm, in rig"
        )
    )
    out: Path = Field(default=Path("output/exported"), description="folder for NAME with the ending of the format")
    force: bool = FORCE
    frame: int = Bounds(0, 10**9).field(0, "frame of a recording, counted from 0")
    depth: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(that of an HCI scene; else measured for ply)")
    ] = Field(
        default=None,
        description="NAME_depth.npz of mirrorcam depth, to use as depth for ply and as ground truth for hci",
    )


def run(options: ExportOptions) -> int:
    """Read, and write in the other format."""
    from mirrorcam.lightfield.exporting import export_light_field

    exported = export_light_field(
        options.light_field,
        options.to,
        options.out,
        frame=options.frame,
        depth=options.depth,
        assumed=options.assumed,
        force=options.force,
    )
    for note in exported.notes:
        say("views", note)
    if exported.measured is not None:
        say("export", f"depth measured: {exported.measured:.0%} of the pixels with confidence above 0.5")
    field = exported.light_field
    count = f"{field.rows}x{field.cols}" if field.is_grid else str(field.rows * field.cols)
    views = f"{count} views of {field.width_px}x{field.height_px} px"
    say("export", f"{exported.path} written ({options.to}), from {exported.source_format}: {views}")
    return 0
