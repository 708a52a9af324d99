"""`mirrorcam decode`: from frames to light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, Bounds
from mirrorcam.core.console.option_texts import FORCE_TEXT
from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.values import Value
from mirrorcam.lightfield.light_fields import check_range

DEVICES = Bounds(0, 255)
FRAMES = Bounds(1, 10**9)
WIDTH_PX = Bounds(2, 8192)


class DecodeOptions(Value):
    """Decode pictures, videos or a camera's stream into light fields, with a picture of all views."""

    frames: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[FRAME|VIDEO...]", help_behavior_hint="")
    ] = Field(default=(), description="frames of the camera (PNG, JPEG, TIFF or BMP), or videos (such as MP4 or AVI)")
    layout: Path = Field(description="layout.json, calibrated where there is one")
    out: Path = Field(
        default=Path("output/decoded"),
        description=(
            "folder for NAME.npz of each frame (NumPy: samples (t, s, v, u, c), weights (t, s, v, u), positions_mm "
            "(t, s, 3) and the other fields of LightField), NAME.zarr of each video, and NAME_views.png of both"
        ),
    )
    force: bool = Field(default=False, description=f"{FORCE_TEXT}; recordings are never replaced")
    device: Annotated[str | None, tyro.conf.arg(metavar="NUMBER|ADDRESS", help_behavior_hint="")] = Field(
        default=None,
        description=(
            "camera to decode live instead of files, until Ctrl-C, to deviceNUMBER.zarr or stream.zarr: its number, "
            f"{DEVICES}, /dev/videoN, or an address, such as rtsp://HOST/PATH or udp://HOST:PORT"
        ),
    )
    limit: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = FRAMES.field(
        None, "maximum number of frames to decode of a video or a camera"
    )
    to: Literal["zarr", "hci", "stanford"] = Field(
        default="zarr",
        description=(
            "format for a video: one Zarr group, or a folder NAME with a scene per frame in the format of HCI or of "
            "the Stanford gantry"
        ),
    )
    field: Literal["common", "union"] = Field(
        default="common",
        description="extent of the views: what all mirrors see at the reference depth, or what any of them sees",
    )
    width_px: Annotated[int | None, tyro.conf.arg(metavar="PX", help_behavior_hint="(as sharp as the frame)")] = (
        WIDTH_PX.field(None, "width of every view; its height follows")
    )
    reference_depth_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(of the design, or of the calibration's board)")
    ] = DEPTH_MM.field(None, "depth of zero disparity, from the pupil")
    regular_grid_at_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = DEPTH_MM.field(
        None,
        "warp the views to an even grid, exactly for objects at this depth; without it they keep their true positions",
    )
    equalise: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="")] = Field(
        default=(),
        description=(
            "make all views equally bright: pictures or videos (of any scene, or of a uniform white target) to "
            "measure it in, or an equalisation.json of an earlier run"
        ),
    )

    mcap: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = Field(
        default=None,
        description=(
            "ROS 2 bag to write instead of a recording in --out, .mcap: images and camera_info of all views, depth, "
            "point cloud and /tf_static; of one video or camera"
        ),
    )
    mcap_compression: Literal["none", "zstd"] = Field(default="none", description="compression of the chunks of a bag")
    view: bool = Field(
        default=False, description="show what is decoded in a window of rerun, with depth and points (extra view)"
    )
    no_depth: bool = Field(
        default=False, description="leave depth and points out of --mcap and --view, which take most of the time"
    )
    near_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(0.6 times the reference depth)")
    ] = DEPTH_MM.field(None, "nearest depth that is searched for --mcap and --view, from the pupil")
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(2 times the reference depth)")] = (
        DEPTH_MM.field(None, "farthest depth that is searched")
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if bool(self.frames) == (self.device is not None):
            raise ValueError("expected frames, videos, or --device NUMBER or ADDRESS")
        number = int(self.device) if self.device and self.device.isascii() and self.device.isdigit() else 0
        if self.device == "" or not DEVICES.least <= number <= DEVICES.most:
            raise ValueError(f"--device {self.device or repr('')}: expected a number from {DEVICES}, or an address")
        if self.mcap is not None and self.to != "zarr":
            raise ValueError(f"--mcap and --to {self.to}: expected one of them")
        check_range(self.near_mm, self.far_mm)
        names = [frame.stem for frame in self.frames]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"two frames are called {twice!r}, expected different names: each names its light field")
        return self


def run(options: DecodeOptions) -> int:
    """Decode the frames; 1 where a damaged one was left out."""
    from mirrorcam.calibration.drift_check import drift_check
    from mirrorcam.lightfield.decoding import DecodeRequest, decode_files

    request = DecodeRequest(
        layout=options.layout,
        frames=options.frames,
        device=options.device,
        limit=options.limit,
        to=options.to,
        field=options.field,
        width_px=options.width_px,
        reference_depth_mm=options.reference_depth_mm,
        regular_grid_at_mm=options.regular_grid_at_mm,
        equalise=options.equalise,
        mcap=options.mcap,
        mcap_compression=options.mcap_compression,
        view=options.view,
        depth=not options.no_depth,
        near_mm=options.near_mm,
        far_mm=options.far_mm,
    )
    lost = decode_files(request, options.out, TERMINAL, force=options.force, make_check=drift_check)
    return 1 if lost else 0
