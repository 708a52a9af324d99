"""`mirrorcam export`: light fields from and to the files of other tools."""

from __future__ import annotations

import glob
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from pydantic import Field

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import say
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.lightfield.light_fields import AssumedViews
from mirrorcam.optics.light_field.io.formats.registry import MIN_CONFIDENCE, NAMES
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.depth import DepthMap
    from mirrorcam.optics.light_field.io.light_field_format import Contents, Depth
    from mirrorcam.optics.light_field.light_field import LightField

    FormatName = str
else:
    FormatName = Literal[NAMES]


@Parameter(name="*")
class ExportRequest(Value):
    """The format of an exported light field, and the frame and depth to export."""

    to: FormatName = Field(
        description="format to write. lftoolbox: .mat with H and weights; hci, stanford: folders of pictures; eslf, "
        "tiles: one .png; mcap: a ROS 2 bag; plenpy, plenopticam: .npy; colmap: rig, masks and points; nerfstudio: "
        "transforms.json and points; ply: points in mm, in the rig frame, with confidence and sigma"
    )
    frame: int = Bounds(0, 10**9).field(0, "frame of a recording, counted from 0")
    depth: Path | None = Field(
        default=None,
        description="NAME_depth.npz of mirrorcam depth, as points for ply, colmap and nerfstudio, and as ground truth "
        "for hci [default: the depth of an HCI scene; otherwise estimated for points]",
    )
    min_confidence: float = Bounds(0.0, 1.0).field(
        MIN_CONFIDENCE, "confidence above which a pixel becomes a point; 0 keeps all pixels with a depth"
    )


def export(
    light_field: Annotated[
        Path,
        Parameter(
            name="LIGHTFIELD",
            help=".npz, .zarr or .mcap of mirrorcam decode, .mat of the Light Field Toolbox, ESLF or tiled .png, or a "
            "folder in the format of HCI, the Stanford gantry, plenpy, PlenoptiCam, COLMAP or nerfstudio, "
            "or of pictures",
        ),
    ],
    /,
    *,
    request: ExportRequest,
    views: AssumedViews = NOTHING,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/exported"),
    force: Force = False,
) -> int:
    """Convert a light field between formats.

    Its format is detected from its name and contents; options or views.toml state the values that it lacks
    (docs/formats.md). Writes NAME with the suffix of the format.

    Examples:
        mirrorcam export decoded/frame_0000.npz --to hci
        mirrorcam export decoded/recording.zarr --frame 12 --to ply
    """
    exported = export_light_field(light_field, out, request, views, force=force)
    for note in exported.notes:
        say("views", note)
    if exported.measured is not None:
        confidence = f"confidence above {request.min_confidence:g}"
        say("export", f"depth estimated: {exported.measured:.0%} of the pixels with {confidence}")
    field = exported.light_field
    count = f"{field.rows}x{field.cols}" if field.is_grid else str(field.rows * field.cols)
    size = f"{count} views of {field.width_px}x{field.height_px} px"
    say("export", f"{exported.path} written ({request.to}): {size}")
    return 0


@dataclass(frozen=True)
class Exported:
    """An exported light field: its path and its samples.

    `measured` is the fraction of pixels with a confident depth if depth was estimated for the export, else None.
    `notes` are remarks on views that were reordered.
    """

    path: Path
    light_field: LightField
    measured: float | None = None
    notes: tuple[str, ...] = ()


def export_light_field(
    source: Path, folder: Path, request: ExportRequest, assumed: Assumed = NOTHING, *, force: bool = False
) -> Exported:
    """Read a light field in any format and write it in another format into a folder, under its name.

    For formats with points, a depth is estimated if neither the request nor the source has one; `force` also replaces
    files that this command did not write. Raises InputError for a source that cannot be read, or cannot be written in
    the format.
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.light_field.io.formats.registry import (
        formats,
        name_of,
        open_light_fields,
        write_light_field,
    )

    name = f"{name_of(source)}{formats()[request.to].ending}"
    with output_folder(folder, "export", force=force) as output:
        # Other files in the folder would be read as part of the light field.
        inner_pattern = f"{glob.escape(name)}/**/*"
        output.refuse_others(
            *([inner_pattern] if output.path.joinpath(name).is_dir() else [inner_pattern, glob.escape(name)])
        )
        contents = open_light_fields(source, assumed=assumed)
        light_field, depth_mm, measured = _read(contents, source, request)
        with output.staged(complete=False) as staged:
            write_light_field(staged / name, light_field, request.to, depth_mm, min_confidence=request.min_confidence)
    return Exported(folder / name, light_field, measured, contents.notes)


def _read(
    contents: Contents, source: Path, request: ExportRequest
) -> tuple[LightField, Depth | DepthMap | None, float | None]:
    """Return the light field, its depth if any, and the fraction of sure pixels if depth was estimated for points.

    Without any sure pixel, a model of cameras is exported without points.
    """
    from mirrorcam.optics.light_field.depth import DepthEstimator
    from mirrorcam.optics.light_field.depth.depth_files import load_depth_map
    from mirrorcam.optics.light_field.io.formats.registry import formats, frame_of

    light_field = frame_of(contents, request.frame, source)
    if request.depth is not None:
        return light_field, load_depth_map(request.depth, light_field), None
    if contents.depth_mm is not None or not formats()[request.to].has_points:
        return light_field, contents.depth_mm, None
    needs_depth = request.to == "ply"
    try:
        depth = DepthEstimator(light_field).estimate(light_field)
    except InputError:
        if needs_depth:
            raise
        return light_field, None, 0.0
    sure = float((depth.valid & (depth.confidence > request.min_confidence)).mean())
    if not sure and needs_depth:
        raise InputError(
            f"{source}: no depth with confidence above {request.min_confidence:g}; is the layout calibrated?"
        )
    return light_field, depth if sure else None, sure
