"""`mirrorcam decode`: from frames to light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from cyclopts import Parameter
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, Bounds
from mirrorcam.core.console.options import Force, Layout
from mirrorcam.core.values import Value

CAMERAS = Bounds(0, 255)
FRAMES = Bounds(1, 10**9)
WIDTH_PX = Bounds(2, 8192)


@Parameter(name="*")
class DecodeRequest(Value):
    """Settings of decoding pictures, videos or the stream of a camera into light fields."""

    live: Annotated[str | None, Parameter(metavar="NUMBER|ADDRESS")] = Field(
        default=None,
        description=f"camera to decode until Ctrl-C, in place of files: its number, {CAMERAS}, /dev/videoN, or an "
        "address, such as rtsp://HOST/PATH or udp://HOST:PORT",
    )
    limit: int | None = FRAMES.field(None, "largest number of frames to decode of a video or a camera", unset="all")
    to: Literal["zarr", "hci", "stanford", "mcap"] = Field(
        default="zarr",
        description="what a video or a camera becomes: one Zarr group, a folder with a scene of HCI or of the Stanford "
        "gantry per frame, or a ROS 2 bag with images and camera_info of all views, depth, points and /tf_static",
    )
    field: Literal["common", "union"] = Field(
        default="common",
        description="extent of the views: what all mirrors see at the reference depth, or what any of them sees",
    )
    width_px: int | None = WIDTH_PX.field(
        None, "width of every view; its height follows", unset="as sharp as the frame"
    )
    reference_depth_mm: float | None = DEPTH_MM.field(
        None, "depth of zero disparity, from the pupil", unset="of the design, or of the calibration's board"
    )
    regular_grid_at_mm: float | None = DEPTH_MM.field(
        None,
        "warp the views to an even grid, exactly for objects at this depth",
        unset="views keep their true positions",
    )
    equalise: tuple[Path, ...] = Field(
        default=(),
        description="make all views equally bright: pictures or videos (of any scene, or of a uniform white target) to "
        "measure it in, or an equalisation.json of an earlier run",
    )
    epi: bool = Field(
        default=False, description="also write the epipolar-plane image of each picture, in which depth shows as slope"
    )
    view: bool = Field(default=False, description="show what is decoded in a window of rerun, with depth and points")
    no_depth: bool = Field(
        default=False, description="leave depth and points, which take most of the time, out of --to mcap and --view"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        live = self.live
        number = int(live) if live and live.isascii() and live.isdigit() else 0
        if live == "" or not CAMERAS.least <= number <= CAMERAS.most:
            raise ValueError(f"--live {live or repr('')}: expected a number from {CAMERAS}, or an address")
        return self


def decode(
    frames: Annotated[
        tuple[Path, ...],
        Parameter(
            name="FRAME|VIDEO...",
            help="frames of the camera (PNG, JPEG, TIFF or BMP), or videos (such as MP4 or AVI)",
        ),
    ] = (),
    /,
    *,
    layout: Layout,
    request: DecodeRequest = DecodeRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/decoded"),
    force: Force = False,
) -> int:
    """Decode frames, videos or a camera into light fields.

    Writes, for each picture, NAME.npz (NumPy: samples (t, s, v, u, c), weights (t, s, v, u), positions_mm (t, s, 3) and
    the other fields of LightField) and NAME_views.png (all views), with --epi also NAME_epi.png and NAME_epi.npz (of
    the middle row of the central view). A video becomes NAME.zarr with NAME_views.png, a folder NAME or NAME.mcap, as
    --to says; a camera is called deviceNUMBER, or stream. Recordings are never replaced; the same command resumes an
    interrupted one. Exit code 1: damaged frames are left out.

    Examples:
        mirrorcam decode frame.png --layout calibrated/layout.json --epi
        mirrorcam decode recording.mp4 --layout calibrated/layout.json --to mcap --out bags
        mirrorcam decode --live 0 --layout calibrated/layout.json --view
    """
    from mirrorcam.calibration.drift_check import drift_check
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.decoding import decode_files

    lost = decode_files(frames, out, request, TERMINAL, layout=layout, force=force, make_check=drift_check)
    return 1 if lost else 0
