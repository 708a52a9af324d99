"""Settings of the light field commands: one type is both the options of a command and the request of its function."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from cyclopts import Parameter
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, DEPTH_OR_INF_MM, OFFSET_MM, Bounds
from mirrorcam.core.values import DepthOrInf, Value
from mirrorcam.render_scenes.settings import RATE_HZ

CAMERAS = Bounds(0, 255)
FRAMES = Bounds(1, 10**9)
WIDTH_PX = Bounds(2, 8192)
TILT_DEG = Bounds(-85.0, 85.0)
Tilt = Annotated[float, TILT_DEG.limits]
Offset = Annotated[float, OFFSET_MM.limits]
LoopFormat = Literal["gif", "mp4"]
Detector = Annotated[
    Literal["SIFT4D", "ORB", "AKAZE"],
    Field(
        description="keypoint detector; SIFT4D searches position, scale and slope jointly; the others search single "
        "views, which is faster; AKAZE needs the contributed modules of OpenCV"
    ),
]


@Parameter(name="*")
class DecodeRequest(Value):
    """Settings of decoding pictures, videos or the stream of a camera into light fields."""

    live: Annotated[str | None, Parameter(metavar="NUMBER|ADDRESS")] = Field(
        default=None,
        description=f"camera to decode until Ctrl-C, in place of files: its number, {CAMERAS}, /dev/videoN, or an "
        "address, such as rtsp://HOST/PATH or udp://HOST:PORT",
    )
    limit: int | None = FRAMES.field(None, "maximum number of frames to decode from a video or a camera", unset="all")
    to: Literal["zarr", "hci", "stanford", "mcap"] = Field(
        default="zarr",
        description="output for a video or a camera: one Zarr group, a folder with an HCI or Stanford gantry "
        "scene per frame, or a ROS 2 bag with images and camera_info of all views, depth, points and /tf_static",
    )
    field: Literal["common", "union"] = Field(
        default="common",
        description="extent of the views: the region that all mirrors see at the reference depth, or that any sees",
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
        description="make all views equally bright: pictures or videos to measure the gains in (of any scene, or of a "
        "uniform white target), or an equalisation.json of an earlier run",
    )
    epi: bool = Field(
        default=False, description="also write the epipolar-plane image of each picture, where slope shows depth"
    )
    view: bool = Field(default=False, description="show the decoded views in a window of rerun, with depth and points")
    no_depth: bool = Field(
        default=False, description="leave out depth and points, which take most of the time, for --to mcap and --view"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        live = self.live
        number = int(live) if live and live.isascii() and live.isdigit() else 0
        if live == "" or not CAMERAS.min <= number <= CAMERAS.max:
            raise ValueError(f"--live {live or repr('')}: expected a number from {CAMERAS}, or an address")
        return self


class DepthRange(Value):
    """A nearest and a farthest depth, mm from the pupil."""

    near_mm: float | None = None
    far_mm: float | None = None

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        near_mm, far_mm = self.near_mm, self.far_mm
        if near_mm is not None and far_mm is not None and not near_mm < far_mm:
            raise ValueError(
                f"--near-mm {near_mm:g} --far-mm {far_mm:g}: the nearest depth must be less than the farthest"
            )
        return self


class FeatureSearch(DepthRange):
    """Detector of features, and the depth range of the search."""

    detector: Detector = "SIFT4D"
    near_mm: float | None = DEPTH_MM.field(
        None,
        "nearest depth of the search, from the pupil",
        unset="as the file states, or halfway to the reference plane",
    )
    far_mm: float | None = DEPTH_MM.field(None, "farthest depth of the search", unset="as the file states, or infinity")


@Parameter(name="*")
class DepthRequest(DepthRange):
    """Settings of the depth estimate of light fields and recordings."""

    near_mm: float | None = DEPTH_MM.field(
        None, "nearest depth of the search, from the pupil", unset="as the file states, or 0.6 x reference depth"
    )
    far_mm: float | None = DEPTH_MM.field(
        None, "farthest depth of the search", unset="as the file states, or 2 x reference depth"
    )
    fast: bool = Field(default=False, description="search and refine at half size: several times faster, less accurate")
    frames_apart: bool = Field(
        default=False,
        description="estimate each frame of a recording on its own, without averaging static parts in time",
    )


@Parameter(name="*")
class RefocusRequest(DepthRange):
    """Pictures to render from each light field."""

    depth_mm: tuple[DepthOrInf, ...] = Field(
        default=(),
        max_length=1000,
        description=f"depths from the pupil to focus on, one picture each, {DEPTH_OR_INF_MM} [default: the reference "
        "depth, where no other picture is requested]",
    )
    tilt_deg: tuple[Tilt, Tilt] = Field(
        default=(0.0, 0.0),
        description=f"tilt of the focal plane about its centre: its right and its lower side move away, {TILT_DEG}",
    )
    combine: Literal["mean", "median", "weighted"] = Field(
        default="mean",
        description="average of the views: median suppresses objects in few views, weighted favours the central ones",
    )
    scale: float = Bounds(1, 8).field(
        1.0, "super-resolution: pixels of the picture per pixel of a view, along each side, such as 1.5 or 2"
    )
    between: int = Bounds(0, 8).field(
        0, "views to interpolate between neighbours, by their depth: out-of-focus parts blur without ghost edges"
    )
    all_in_focus: bool = Field(
        default=False, description="also write a picture with everything in focus, by the depth of each pixel"
    )
    from_mm: tuple[Offset, Offset] | None = Field(
        default=None,
        description="also write an all-in-focus picture from a viewpoint this many mm right of and below the central "
        f"view, {OFFSET_MM}",
    )
    behind_mm: float | None = DEPTH_MM.field(None, "remove everything nearer than this depth from all pictures")
    orbit: LoopFormat | None = Field(default=None, description="also write an animation in which the viewpoint circles")
    sweep: LoopFormat | None = Field(
        default=None, description="also write an animation in which the focus moves from --near-mm to --far-mm and back"
    )
    near_mm: float | None = DEPTH_MM.field(
        None, "nearest depth of the search and of --sweep", unset="as for mirrorcam depth"
    )
    far_mm: DepthOrInf | None = Field(
        default=None,
        description=f"farthest depth of the search and of --sweep, {DEPTH_OR_INF_MM} [default: as for mirrorcam depth]",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        for index, depth in enumerate(self.depth_mm):
            if depth in self.depth_mm[:index]:
                raise ValueError(f"focus at {depth:g} mm is requested twice, expected different depths")
        return self

    @property
    def needs_depth(self) -> bool:
        """Whether the pictures need the depth of each pixel."""
        rendered = self.all_in_focus or self.from_mm is not None or self.orbit is not None
        return rendered or self.behind_mm is not None or self.between > 0


@Parameter(name="*")
class FeaturesRequest(FeatureSearch):
    """Settings of the search for features."""

    keypoints: int = Bounds(1, 100_000).field(600, "maximum number of keypoints per view to start from")
    min_views: int | None = Bounds(1, 1_000_000).field(
        None, "number of views, besides the central one, in which a feature must be found", unset="more than half"
    )


@Parameter(name="*")
class TrackRequest(FeatureSearch):
    """Settings of the tracker, and the rate of light fields without times."""

    detector: Detector = "ORB"
    keypoints: int = Bounds(20, 100_000).field(600, "maximum number of keypoints per view to start from")
    rate_hz: float = RATE_HZ.field(30.0, "light fields per second, where a recording does not state their times")


@Parameter(name="*")
class FilterRequest(DepthRange):
    """Settings of a 4-D filter."""

    kind: Literal["hyperfan", "dual-fan", "hypercone"] = Field(
        default="hyperfan",
        description="passband. hyperfan: everything between two depths; dual-fan: slopes of these depths along x "
        "and y, independently; hypercone: surfaces at any depth",
    )
    near_mm: float | None = DEPTH_MM.field(
        None, "nearest depth of the passband, from the pupil", unset="as the file states"
    )
    far_mm: DepthOrInf | None = Field(
        default=None,
        description=f"farthest depth of the passband, {DEPTH_OR_INF_MM} [default: as the file states]",
    )
    leave_out: bool = Field(
        default=False,
        description="leave out samples that disagree with the others: rain, snow and particles nearer than --near-mm",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind == "hypercone" and (self.near_mm is not None or self.far_mm is not None):
            raise ValueError("--kind hypercone keeps all depths, so --near-mm and --far-mm are not allowed")
        return self
