"""`mirrorcam render`: a synthetic calibration set with ground truth; and the check of a set by its checksums."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import PICTURES, SAMPLES_PER_PIXEL, SEED, WORKERS
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import InputError, InvalidValue, Value
from mirrorcam.render_scenes.settings import (
    RATE_HZ,
    RendererName,
    RenderSettings,
    SensorModel,
    SurfaceFinish,
    VideoName,
)
from mirrorcam.simulation.camera_options import SensorOption, TolerancesOption, sensor_from_text, tolerances_from_text

if TYPE_CHECKING:
    from mirrorcam.render_scenes.sets.dataset import Dataset


def settings_of(options: RenderOptions, sensor: SensorModel, finish: SurfaceFinish) -> RenderSettings:
    """The settings that options ask for; raises InputError where they contradict each other."""
    try:
        return RenderSettings(
            renderer=options.renderer,
            spp=options.spp,
            sensor=sensor,
            finish=finish,
            maps=not options.no_maps,
            video=options.video,
        )
    except InvalidValue as error:
        raise InputError(error.reason) from None


class RenderOptions(Value):
    """Render frames of a calibration board as a device built with tolerances sees it, with ground truth."""

    layout: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[LAYOUT]", help_behavior_hint="")] = (
        Field(default=None, description="nominal layout.json")
    )
    frames: int = PICTURES.cut(least=1).field(20, "frames of the board through the mirrors")
    base_frames: int = PICTURES.field(10, "frames of the board by the camera without mirrors")
    seed: int = SEED.field(0, "seed of poses, tolerances and noise; the same seed gives the same bytes")
    renderer: RendererName = Field(
        default="mitsuba", description="mitsuba: reference, by path tracing; fast: analytic, for large sets"
    )
    spp: int = SAMPLES_PER_PIXEL.field(16, "samples per pixel of the reference renderer")
    sensor: SensorOption = "c920"
    as_built: TolerancesOption = ""
    board: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="board.toml of the target; without it, the default board"
    )
    poses: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="JSON file of poses, rig_from_board in mm, to use instead of planned ones"
    )
    rate_hz: Annotated[float | None, tyro.conf.arg(metavar="FLOAT", help_behavior_hint="")] = RATE_HZ.field(
        None,
        "frame rate of one smooth motion through the poses, instead of separate poses",
    )
    video: Annotated[VideoName | None, tyro.conf.arg(metavar="mp4|avi", help_behavior_hint="")] = Field(
        default=None, description="also write the motion as a video: mp4 (H.264), or avi (the JPEG files, as MJPEG)"
    )
    finish: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None,
        description="TOML file with the surface finish of the mirrors: tint, reflectance, roughness, sag, ripple",
    )
    parts: Annotated[Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="")] = Field(
        default=None,
        description="folder that `mirrorcam cad` wrote for the layout: show its parts, which block and scatter light",
    )
    no_maps: bool = Field(
        default=False,
        description="leave out the maps of what each pixel shows: an EXR file per frame, 18 MB at 1920 x 1080",
    )
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(all cores)")] = WORKERS.field(
        None, "number of frames rendered at the same time on this machine"
    )
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="")] = Field(
        default=None, description="Dask scheduler whose workers render them instead, such as tcp://host:8786"
    )
    verify: Annotated[Path | None, tyro.conf.arg(metavar="SET", help_behavior_hint="")] = Field(
        default=None, description="render nothing; compare the files of a set with their checksums"
    )
    out: Path = Field(default=Path("output/set"), description="folder for the set; an interrupted one is resumed")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.layout is None) == (self.verify is None):
            raise ValueError("expected LAYOUT or --verify SET, one of the two")
        if self.workers is not None and self.scheduler is not None:
            raise ValueError("--workers and --scheduler: expected one of the two")
        if self.video is not None and self.rate_hz is None:
            raise ValueError(f"--video {self.video}: a video shows a motion, expected --rate-hz with it")
        return self


def run(options: RenderOptions) -> int:
    """Render the set, or verify one."""
    if options.verify is not None:
        return verify(options.verify)
    from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, read_model
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.optics.geometry.targets import default_board, load_board
    from mirrorcam.simulation.poses_file import PosesFile

    assert options.layout is not None
    layout = Layout.load(options.layout)
    target = default_board() if options.board is None else load_board(options.board)
    given = None if options.poses is None else read_model(PosesFile, options.poses, LARGEST_FILE_BYTES)
    tolerances, sensor = tolerances_from_text(options.as_built), sensor_from_text(options.sensor)
    finish = SurfaceFinish() if options.finish is None else read_model(SurfaceFinish, options.finish)
    settings = settings_of(options, sensor, finish)
    require("render")
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.render_scenes.sets.dataset import MANIFEST
    from mirrorcam.render_scenes.sets.render_set import render_set
    from mirrorcam.render_scenes.sets.set_request import SetRequest
    from mirrorcam.simulation.rendering import in_workers, on_cluster

    request = SetRequest(
        layout=layout,
        target=target,
        frames=options.frames,
        base_frames=options.base_frames,
        seed=options.seed,
        tolerances=tolerances,
        settings=settings,
        poses=() if given is None else given.poses.tolist(),
        poses_hz=1.0 if given is None else given.poses_hz,
        rate_hz=options.rate_hz,
        parts=options.parts,
    )
    workers = options.workers or cores()
    run_there = in_workers(workers) if options.scheduler is None else on_cluster(options.scheduler)
    who = count_text(workers, "worker") if options.scheduler is None else f"the workers of {options.scheduler}"
    with (
        output_folder(options.out, "render"),
        long_work("render", f"{options.renderer}, {who}", "frames") as advance,
    ):
        dataset = render_set(request, options.out, run=run_there, progress=advance)
    say("coverage", coverage_text(dataset, layout.cols))
    say("coverage", reach_text(dataset, layout.mirror_names))
    say("render", f"{options.out / MANIFEST} written; {options.out / 'truth'} is for mirrorcam validate only")
    return 0


def coverage_text(dataset: Dataset, cols: int) -> str:
    """Percentage of each sub-image, row by row, and of the base frames, in which some frame shows corners."""
    percent = [f"{100.0 * part:.0f}" for part in dataset.coverage]
    rows = [" ".join(percent[begin : begin + cols]) for begin in range(0, len(percent), cols)]
    mirrors = f"corners cover {' / '.join(rows)} % of the sub-images"
    return f"{mirrors}, {100.0 * dataset.base_coverage:.0f} % of base frames" if dataset.base_frames else mirrors


def reach_text(dataset: Dataset, mirrors: Sequence[str]) -> str:
    """Distances and tilts of boards that every mirror shows."""
    reaches = dataset.reaches
    blind = [name for name, reach in zip(mirrors, reaches, strict=True) if reach.farthest_mm == 0]
    if blind:
        return f"mirror {', '.join(blind)} shows too few corners in every frame"
    nearest, farthest = max(reach.nearest_mm for reach in reaches), min(reach.farthest_mm for reach in reaches)
    tilt = min(reach.tilt_deg for reach in reaches)
    return f"every mirror shows boards from {nearest} to {farthest} mm away and tilted by up to {tilt}°"


def verify(folder: Path) -> int:
    """Compare every file of a set with its checksum; 1 where one is missing or altered."""
    from mirrorcam.simulation.set_check import check_set

    found = check_set(folder)
    for state, names in (("altered", found.altered), ("missing", found.lost)):
        for name in names:
            say("verify", f"{folder / name} is {state}")
    if found.unfinished:
        say("verify", f"{count_text(len(found.unfinished), 'file')} not rendered yet, {found.unfinished[0]} first")
    if found.passed:
        say("verify", f"{count_text(found.files, 'file')} as rendered")
    return 0 if found.passed else 1
