"""`mirrorcam export`: light fields from and to the files of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from pydantic import Field

from mirrorcam.console.progress import say
from mirrorcam.optics.base.values import InputError, Value

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.light_field import LightField

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


def depth_from(path: Path, light_field: LightField) -> Any:
    """The depth (v, u) in mm that `mirrorcam depth` wrote for a light field; InputError for another's."""
    import numpy as np

    from mirrorcam.optics.base.files import read_bytes

    read_bytes(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            depth_mm, identity = archive["depth_mm"], str(archive["layout_identity"])
            row, col = archive["view"].tolist()
    except (ValueError, KeyError, OSError, EOFError, TypeError) as error:
        raise InputError(f"{path}: not a depth map of mirrorcam depth: {' '.join(str(error).split())}") from None
    if identity != light_field.layout_identity:
        raise InputError(f"{path}: of layout {identity!r}, but the light field is of {light_field.layout_identity!r}")
    if not (row < light_field.rows and col < light_field.cols) or light_field.positions_mm[row, col].any():
        raise InputError(f"{path}: depth of view {(row, col)}, expected that of the reference view")
    if depth_mm.shape != light_field.weights.shape[2:]:
        height, width = light_field.weights.shape[2:]
        raise InputError(f"{path}: depth of {depth_mm.shape} px, expected {(height, width)} of the views")
    return depth_mm.astype(np.float32)


def run(options: ExportOptions) -> int:
    """Read, and write in the other format."""
    import numpy as np

    from mirrorcam.optics.light_field.depth import DepthEstimator
    from mirrorcam.optics.light_field.io.formats.registry import ENDINGS, format_of, named, read_any, write_any
    from mirrorcam.optics.light_field.io.formats.views_file import Assumed

    assumed = Assumed(
        rows=options.rows,
        cols=options.cols,
        step_mm=options.step_mm,
        focal_px=options.focal_px,
        reference_depth_mm=options.reference_depth_mm,
    )
    light_field, depth_mm = read_any(options.light_field, assumed, options.frame)
    if options.depth is not None:
        depth_mm = depth_from(options.depth, light_field)
    if depth_mm is None and options.to == "ply":
        found = DepthEstimator(light_field).estimate(light_field)
        depth_mm = np.where(found.valid & (found.confidence > 0.5), found.depth_mm, np.float32(np.nan))
        if not np.isfinite(depth_mm).any():
            raise InputError(f"{options.light_field}: no depth with confidence above 0.5; is the layout calibrated?")
        say("export", f"depth measured: {np.isfinite(depth_mm).mean():.0%} of the pixels with confidence above 0.5")
    path = options.out / f"{named(options.light_field)}{ENDINGS[options.to]}"
    write_any(path, light_field, options.to, depth_mm)
    source = format_of(options.light_field)
    views = f"{light_field.rows}x{light_field.cols} views of {light_field.width_px}x{light_field.height_px} px"
    say("export", f"{path} written ({options.to}), from {source}: {views}")
    return 0
