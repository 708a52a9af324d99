"""A synthetic calibration set: the pictures that a user would take, with the truth in a separate folder.

A set follows from its request: the same request, the same bytes, whoever renders the frames. Every file is written
whole or not at all, so an interrupted set is continued where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
from pydantic import Field

from mirrorcam.optics.base.files import write_bytes
from mirrorcam.optics.base.fingerprint import value_digest
from mirrorcam.optics.base.progress import Progress, no_progress
from mirrorcam.optics.base.values import FloatArray, InputError, Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built
from mirrorcam.optics.geometry.targets import Target, default_board, save_board
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.boards.motion import smooth_motion
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, draw_finishes
from mirrorcam.render_scenes.reference.device_bodies import DeviceParts, bodies_around, parts_of
from mirrorcam.render_scenes.reference.obstacles import BodyObstacles
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.sets.frame_task import CaptureSetup, FrameTask, render_frame
from mirrorcam.render_scenes.sets.poses import PosePlan, plan_base_frames, plan_frames, plan_of, reaches
from mirrorcam.render_scenes.sets.set_truth import write_truth
from mirrorcam.render_scenes.sets.set_video import check_video, write_video
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.truth.corners import Oracle
from mirrorcam.render_scenes.variant import use_variant

# Streams of random numbers; each is independent of how much the others draw.
_AS_BUILT, _POSES, _BASE_POSES, _FRAMES, _BASE, _FINISH = range(6)

Run = Callable[[Sequence[str]], Iterator[tuple[int, dict[str, bytes]]]]


class SetRequest(Value):
    """All inputs that determine the files of a rendered set.

    Parameters
    ----------
    layout
        Nominal layout; the set is rendered with an as-built copy of it, drawn with `tolerances`.
    target
        Board in the pictures.
    frames, base_frames
        Number of pictures through the mirrors, and by the bare camera.
    seed
        Seed of the as-built copy, the poses and the noise.
    tolerances
        How far the as-built copy may be from the nominal layout.
    settings
        Renderer, light, sensor, and whether pixel maps and a video are written.
    poses
        Poses (n, 4, 4) of the board, rig_from_board in mm, instead of planned ones.
    poses_hz
        Number of poses that a motion passes per second.
    rate_hz
        Frame rate of a motion: the pictures are then moments of one smooth path through the poses.
    parts
        Folder with the parts of the device (`build_parts`) that stand around the mirrors.
    """

    layout: Layout
    target: Target = Field(default_factory=default_board)
    frames: int = Field(default=20, ge=1)
    base_frames: int = Field(default=10, ge=0)
    seed: int = Field(default=0, ge=0)
    tolerances: Tolerances = Tolerances()
    settings: RenderSettings = RenderSettings()
    poses: tuple[tuple[tuple[float, ...], ...], ...] = ()
    poses_hz: float = Field(default=1.0, gt=0)
    rate_hz: float | None = Field(default=None, ge=0.01, le=500)
    parts: Path | None = None


def render_set(request: SetRequest, out: Path, *, run: Run | None = None, progress: Progress = no_progress) -> Dataset:
    """Render pictures of a board through an as-built copy of a layout, and by its bare camera.

    Parameters
    ----------
    request
        What to render; the same request gives the same bytes.
    out
        Folder for the set: `frames/`, `base/`, `layout.json` (nominal), `board.toml`, `dataset.json`, and the truth in
        its own folder. Finished pictures of an interrupted run with the same request are kept.
    run
        Renders pictures of their tasks and yields their numbers and files in any order; by default this process does.
    progress
        Called with the numbers of pictures done and of all, at the start and after each; those of a video count twice.

    Returns
    -------
    Dataset
        The manifest: names of the pictures relative to `out`, and checksums.

    Raises
    ------
    InputError
        If the extra `render` is not installed, the board cannot be seen, the tolerances cannot be built, the pictures
        make no such video, or `out` holds another set.
    """
    check_video(request.settings, request.layout.camera, request.rate_hz)
    if request.parts is not None and request.settings.renderer == "fast":
        raise InputError("renderer fast: shows mirrors alone, expected renderer mitsuba for the parts of a device")
    variant = use_variant()
    layout, settings = request.layout, request.settings
    built = draw_as_built(layout, request.tolerances, _random(request.seed, _AS_BUILT))
    parts = None if request.parts is None else parts_of(request.parts, layout, built)
    plan, moments = _frames(request)
    base_plan = plan_base_frames(layout, request.target, request.base_frames, _random(request.seed, _BASE_POSES))
    dataset = _manifest(request, plan, base_plan, None if parts is None else parts.checksum, variant)
    dataset = dataset.replaced(request=_digest(dataset, built, plan, base_plan, request.seed))
    dataset = dataset.continued(out)
    dataset = _write_known(out, dataset, layout)
    finishes = draw_finishes(settings, len(built.mirrors), _random(request.seed, _FINISH))
    obstacles = None if parts is None else BodyObstacles(bodies_around(parts))
    oracle = Oracle(built, dataset.target, finishes, obstacles)
    names = write_truth(out, oracle, finishes, moments, base_plan, request.seed)
    dataset = dataset.recorded(out, *names)
    tasks = _tasks(request, dataset, built, finishes, parts, moments, base_plan, variant)
    return _render_missing(out, dataset, tasks, run or in_this_process, progress)


def _manifest(
    request: SetRequest, plan: PosePlan, base_plan: PosePlan, parts_checksum: str | None, variant: str
) -> Dataset:
    """The manifest without its digest and files."""
    layout = request.layout
    return Dataset(
        layout_identity=layout.identity,
        target=request.target,
        frames=len(plan.poses),
        base_frames=request.base_frames,
        width_px=layout.camera.width_px,
        height_px=layout.camera.height_px,
        tolerances=request.tolerances,
        settings=request.settings,
        rate_hz=request.rate_hz,
        parts=parts_checksum,
        renderer=f"{request.settings.renderer}, mitsuba {metadata.version('mitsuba')} {variant}",
        coverage=tuple(plan.coverage),
        reaches=reaches(plan, request.target, layout.view_from_rig[2]),
        base_coverage=float(base_plan.coverage[0]),
        request="",
    )


def _tasks(
    request: SetRequest,
    dataset: Dataset,
    built: Layout,
    finishes: tuple[MirrorFinish, ...],
    parts: DeviceParts | None,
    moments: FloatArray,
    base_plan: PosePlan,
    variant: str,
) -> list[FrameTask]:
    """Tasks of all frames, via the mirrors and of the bare camera."""
    through_mirrors, bare = (
        CaptureSetup(
            built=built,
            mirrors=mirrors,
            target=request.target,
            settings=request.settings,
            finishes=finishes if mirrors else (),
            parts=parts if mirrors else None,
            variant=variant,
        )
        for mirrors in (True, False)
    )
    return [
        FrameTask(
            setup=setup,
            name=name,
            map_name=dataset.map_of(name),
            poses=poses,
            key=(request.seed, stream, index),
        )
        for stream, setup, names, moments_of in (
            (_FRAMES, through_mirrors, dataset.frame_names, moments),
            (_BASE, bare, dataset.base_names, base_plan.poses[:, None]),
        )
        for index, (name, poses) in enumerate(zip(names, moments_of, strict=True))
    ]


def _render_missing(out: Path, dataset: Dataset, tasks: Sequence[FrameTask], run: Run, progress: Progress) -> Dataset:
    """Render the frames, and encode the video, that an interrupted run has not written."""
    missing = [task for task in tasks if not {task.name, task.map_name} - {None} <= dataset.files.keys()]
    in_video = 0 if dataset.video_name is None else dataset.frames
    total = len(tasks) + in_video
    done = len(tasks) - len(missing) + (in_video if dataset.video_name in dataset.files else 0)
    progress(done, total)
    for _, files in run([task.model_dump_json() for task in missing]):
        # The picture last, so that there is none without its maps.
        for name, content in sorted(files.items(), reverse=True):
            write_bytes(out / name, content)
        dataset = dataset.recorded(out, *files)
        done += 1
        progress(done, total)
    if dataset.video_name is not None and dataset.video_name not in dataset.files:
        write_video(out, dataset, lambda frames: progress(done + frames, total))
        dataset = dataset.recorded(out, dataset.video_name)
    return dataset


def in_this_process(tasks: Sequence[str]) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Frames of their tasks, one after the other, with all cores at work on each."""
    yield from enumerate(map(render_frame, tasks))


def _random(*key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(key))


def _frames(request: SetRequest) -> tuple[PosePlan, FloatArray]:
    """Plan of the board's pose in each frame, and its poses (frames, 1 or 3, 4, 4) while the frame is read out."""
    layout, target, random = request.layout, request.target, _random(request.seed, _POSES)
    keys = np.array(request.poses)
    if request.rate_hz is not None and (len(keys) or request.frames) == 1:
        raise InputError("rate_hz: one pose is no motion, expected two frames or more")
    if request.rate_hz is None:
        plan = plan_of(layout, target, keys) if len(keys) else plan_frames(layout, target, request.frames, random)
        return plan, plan.poses[:, None]
    if len(keys):
        count = int((len(keys) - 1) / request.poses_hz * request.rate_hz) + 1
    else:
        count = request.frames
        seconds = (count - 1) / request.rate_hz
        keys = plan_frames(layout, target, int(np.ceil(seconds * request.poses_hz)) + 1, random).poses
    half_s = request.settings.sensor.readout_ms / 2000.0
    around = np.array([-half_s, 0.0, half_s] if half_s > 0 else [0.0])
    times = np.arange(count)[:, None] / request.rate_hz + around
    moments = smooth_motion(keys, times.ravel() * request.poses_hz).reshape(count, len(around), 4, 4)
    return plan_of(layout, target, moments[:, len(around) // 2]), moments


def _digest(dataset: Dataset, built: Layout, plan: PosePlan, base_plan: PosePlan, seed: int) -> str:
    """Sixteen hexadecimal digits of all that the bytes of a set follow from."""
    asked = dataset.model_dump(mode="json", exclude={"request", "files"})
    drawn = {"seed": seed, "built": built.identity, "poses": [plan.poses.tolist(), base_plan.poses.tolist()]}
    return value_digest(asked | drawn)[:16]


def _write_known(out: Path, dataset: Dataset, layout: Layout) -> Dataset:
    """Write the data that the user has besides the pictures."""
    layout.save(out / "layout.json")
    save_board(out / "board.toml", dataset.target)
    return dataset.recorded(out, "layout.json", "board.toml")
