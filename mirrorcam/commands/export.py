"""`mirrorcam export`: light fields from and to the files of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.console.progress import say
from mirrorcam.optics.base.values import Value

# Those of optics.light_field.formats.doors, which is imported late.
Format = Literal[
    "npz",
    "zarr",
    "lftoolbox",
    "hci",
    "stanford",
    "eslf",
    "tiles",
    "plenpy",
    "plenopticam",
    "colmap",
    "nerfstudio",
    "ply",
]


class ExportOptions(Value):
    """Write a light field from any known format to any other; what it is in is seen from its name and contents."""

    light_field: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LIGHTFIELD", help_behavior_hint="")] = (
        Field(
            description=(
                ".npz or .zarr of mirrorcam decode, .mat of the Light Field Toolbox, ESLF or tiled .png, or a folder "
                "as of HCI, the Stanford gantry, plenpy, PlenoptiCam, COLMAP or nerfstudio"
            ),
        )
    )
    to: Format = Field(
        description=(
            "lftoolbox: .mat with H and weights; hci, stanford: folders of pictures; eslf, tiles: one .png; plenpy, "
            "plenopticam: .npy; colmap: rig and masks; nerfstudio: transforms.json; ply: points in mm, in rig"
        )
    )
    out: Path = Field(
        default=Path("output/exported"), description="folder for NAME, with what the format's names end in"
    )
    frame: int = Field(default=0, ge=0, description="which frame of a recording in Zarr, counted from 0")
    depth: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(of HCI its own, for ply measured)")
    ] = Field(default=None, description="NAME_depth.npz of mirrorcam depth: depth for ply, truth for hci")
    rows: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = Field(
        default=None, ge=1, description="views down, of pictures without views.json or the like"
    )
    cols: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = Field(
        default=None, ge=1, description="views across, likewise"
    )
    step_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None, gt=0, allow_inf_nan=False, description="distance of neighbouring views where a file has none"
    )
    focal_px: Annotated[float | None, tyro.conf.arg(metavar="PX", help_behavior_hint="")] = Field(
        default=None, gt=0, allow_inf_nan=False, description="focal length of the views where a file has none"
    )
    reference_depth_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None, gt=0, allow_inf_nan=False, description="distance of zero disparity where a file has none"
    )


def run(options: ExportOptions) -> int:
    """Read, and write in the other format."""
    from mirrorcam.optics.light_field.io.formats.views_file import Assumed
    from mirrorcam.workflow.exporting import export_light_field

    assumed = Assumed(
        rows=options.rows,
        cols=options.cols,
        step_mm=options.step_mm,
        focal_px=options.focal_px,
        reference_depth_mm=options.reference_depth_mm,
    )
    exported = export_light_field(
        options.light_field, options.to, options.out, frame=options.frame, depth=options.depth, assumed=assumed
    )
    if exported.measured is not None:
        say("export", f"depth measured: {exported.measured:.0%} of the pixels with confidence above 0.5")
    field = exported.light_field
    views = f"{field.rows}x{field.cols} views of {field.width_px}x{field.height_px} px"
    say("export", f"{exported.path} written ({options.to}), from {exported.source_format}: {views}")
    return 0
