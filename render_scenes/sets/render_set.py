"""A synthetic calibration set: the pictures that a user would take, with the ground truth in a separate folder.

The request determines the bytes of a set, whichever process renders the frames. Every file is written atomically, so
that an interrupted set can be continued.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import metadata
from pathlib import Path

from mirrorcam.core.arguments import AnyPath, check_callable, check_type, path_of
from mirrorcam.core.disk.files import write_bytes, write_files, write_json, write_npz
from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.errors import InputError
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built
from mirrorcam.render_scenes.lens import TrueLens, true_camera, with_pupil_of
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, draw_finishes
from mirrorcam.render_scenes.reference.device_bodies import BodyObstacles, DeviceParts, parts_of, read_device
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.sets.frame_task import CaptureSetup, FrameTask, render_frame
from mirrorcam.render_scenes.sets.poses import PosePlan, depth_ranges, plan_base_frames
from mirrorcam.render_scenes.sets.set_request import SetRequest, Stream, planned_frames
from mirrorcam.render_scenes.sets.video import check_video, write_video
from mirrorcam.render_scenes.truth.corners import CornerProjector
from mirrorcam.render_scenes.truth.pixel_maps import exr_bytes
from mirrorcam.render_scenes.truth.pupil_maps import PupilTracer, pupil_maps
from mirrorcam.render_scenes.variant import use_variant


def write_truth(
    out: Path,
    projector: CornerProjector,
    finishes: tuple[MirrorFinish, ...],
    lens: TrueLens | None,
    readouts: FloatArray,
    base_plan: PosePlan,
    seed: int,
) -> None:
    """Write the ground truth of a set, for validation only."""
    middle_poses = readouts[:, readouts.shape[1] // 2]
    truth = out / "truth"
    frames_px, frames_visible = projector.all_via_mirrors(list(readouts))
    base_px, base_visible = projector.all_direct(list(base_plan.poses))
    projector.layout.save(truth / "layout.json")
    write_json(truth / "poses.json", {"frames": middle_poses.tolist(), "base": base_plan.poses.tolist()})
    if readouts.shape[1] == 3:
        write_json(truth / "readout.json", {"poses": readouts.tolist()})
    if finishes:
        write_json(truth / "finish.json", {"mirrors": [finish.model_dump(mode="json") for finish in finishes]})
    if lens is not None:
        write_json(truth / "lens.json", lens.model_dump(mode="json"))
    write_json(truth / "seed.json", {"seed": seed})
    corners = {
        "frames_px": frames_px,
        "frames_visible": frames_visible,
        "base_px": base_px,
        "base_visible": base_visible,
    }
    write_npz(truth / "corners.npz", corners)


def write_pupil_maps(path: Path, tracer: PupilTracer) -> None:
    """Write the maps of the pupil's unvignetted part via each mirror, the same for all frames."""
    pupil = tracer.pupil
    header = {"layout": tracer.layout.identity, "units": "mm"}
    header |= {"aperture_mm": repr(pupil.aperture_mm), "focus_mm": repr(pupil.focus_mm)}
    write_bytes(path, exr_bytes(pupil_maps(tracer), header))


RenderTasks = Callable[[Sequence[str]], Iterator[tuple[int, dict[str, bytes]]]]


def render_set(
    request: SetRequest,
    out: AnyPath,
    *,
    run: RenderTasks | None = None,
    variant: str | None = None,
    progress: Progress = no_progress,
) -> Dataset:
    """Render pictures of a board via the mirrors of an as-built copy of a layout, and with its bare camera.

    Parameters
    ----------
    request
        Inputs of the set; the same request gives the same bytes.
    out
        Folder for the set: `frames/`, `base/`, `layout.json` (nominal), `board.toml`, `dataset.json`, and `truth/`.
        Pictures that an interrupted run with the same request has finished are kept.
    run
        Renders the tasks and yields the index and files of each picture, in any order; by default in this process.
    variant
        Mitsuba's variant, on which the bytes depend; by default the fastest available.
    progress
        Called with the number of pictures done and the total, at the start and after each picture; pictures in a video
        count twice.

    Returns
    -------
    Dataset
        The manifest: names of the pictures relative to `out`, and checksums.

    Raises
    ------
    InputError
        If the extra `render` is not installed, the board is not visible, no device can be built with the tolerances,
        the pictures do not fit the video's format, or `out` contains a different set.
    """
    check_type("request", request, SetRequest)
    check_callable("progress", progress)
    out = path_of("out", out)
    check_video(request.settings, request.layout.camera, request.rate_hz)
    if request.parts is not None and request.settings.renderer == "fast":
        raise InputError("renderer fast: cannot show the parts of a device, expected renderer mitsuba")
    variant = use_variant(variant)
    layout, settings = request.layout, request.settings
    built = draw_as_built(layout, request.tolerances, request.random(Stream.AS_BUILT))
    built = built.replaced(camera=with_pupil_of(built.camera, settings.sensor))
    parts = None if request.parts is None else parts_of(request.parts, layout, built)
    plan, readouts = planned_frames(request)
    base_plan = plan_base_frames(layout, request.board, request.base_frames, request.random(Stream.BASE_POSES))
    dataset = _manifest(request, plan, base_plan, None if parts is None else parts.checksum, variant)
    dataset = dataset.replaced(request=_request_digest(dataset, built, plan, base_plan, request.seed))
    dataset = dataset.resumed(out, dataset.planned_names)
    dataset = dataset.added(out, partial(_write_user_files, dataset=dataset, layout=layout))
    finishes = draw_finishes(settings, len(built.mirrors), request.random(Stream.FINISH))
    obstacles = None if parts is None else BodyObstacles(read_device(parts))
    is_ideal = settings.sensor.lens_waves_px == settings.sensor.lateral_chromatic_percent == 0.0
    lens = None if is_ideal else TrueLens.of(settings.sensor)
    built_with_true_lens = built.replaced(camera=true_camera(built.camera, settings.sensor))
    projector = CornerProjector(built_with_true_lens, dataset.board, finishes, obstacles)
    dataset = dataset.added(
        out, lambda folder: write_truth(folder, projector, finishes, lens, readouts, base_plan, request.seed)
    )
    if (name := dataset.pupil_name) is not None and name not in dataset.files:
        tracer, path = PupilTracer(built_with_true_lens, built.camera.pupil, finishes, obstacles), Path(name)
        dataset = dataset.added(out, lambda folder: write_pupil_maps(folder / path, tracer))
    tasks = _tasks(request, dataset, built, finishes, parts, readouts, base_plan, variant)
    return _render_missing(out, dataset, tasks, run or in_this_process, progress)


def _manifest(
    request: SetRequest, plan: PosePlan, base_plan: PosePlan, parts_checksum: str | None, variant: str
) -> Dataset:
    """Return the manifest without its digest and files."""
    layout = request.layout
    return Dataset(
        layout_identity=layout.identity,
        board=request.board,
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
        reaches=depth_ranges(plan, request.board, layout.view_from_rig[2]),
        base_coverage=float(base_plan.coverage[0]),
        request="",
    )


def _tasks(
    request: SetRequest,
    dataset: Dataset,
    built: Layout,
    finishes: tuple[MirrorFinish, ...],
    parts: DeviceParts | None,
    readouts: FloatArray,
    base_plan: PosePlan,
    variant: str,
) -> list[FrameTask]:
    """Return the tasks of all frames, via the mirrors and with the bare camera."""
    via_mirrors, bare = (
        CaptureSetup(
            built=built,
            mirrors=mirrors,
            board=request.board,
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
        for stream, setup, names, poses_of in (
            (Stream.FRAMES, via_mirrors, dataset.frame_names, readouts),
            (Stream.BASE, bare, dataset.base_names, base_plan.poses[:, None]),
        )
        for index, (name, poses) in enumerate(zip(names, poses_of, strict=True))
    ]


def _render_missing(
    out: Path, dataset: Dataset, tasks: Sequence[FrameTask], run: RenderTasks, progress: Progress
) -> Dataset:
    """Render the missing frames, then encode the video if it is missing too."""
    missing = [task for task in tasks if not {task.name, task.map_name} - {None} <= dataset.files.keys()]
    in_video = 0 if dataset.video_name is None else dataset.frames
    total = len(tasks) + in_video
    done = len(tasks) - len(missing) + (in_video if dataset.video_name in dataset.files else 0)
    progress(done, total)
    for _, files in run([task.model_dump_json() for task in missing]):
        dataset = dataset.added(out, partial(write_files, files=files))
        done += 1
        progress(done, total)
    if dataset.video_name is not None and dataset.video_name not in dataset.files:
        dataset = _with_video(out, dataset, lambda frames: progress(done + frames, total))
    return dataset


def _with_video(out: Path, dataset: Dataset, on_picture: Callable[[int], None]) -> Dataset:
    return dataset.added(out, lambda folder: write_video(folder / f"{dataset.video_name}", out, dataset, on_picture))


def in_this_process(tasks: Sequence[str]) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Render the frames of tasks one after another, each on all cores."""
    yield from enumerate(map(render_frame, tasks))


def _request_digest(dataset: Dataset, built: Layout, plan: PosePlan, base_plan: PosePlan, seed: int) -> str:
    """Return a digest (16 hexadecimal digits) of everything that determines the bytes of a set."""
    inputs = dataset.model_dump(mode="json", exclude={"request", "files"})
    inputs["target"] = inputs.pop("board")  # the key of the file, so that digests of earlier sets stay valid
    samples = {"seed": seed, "built": built.identity, "poses": [plan.poses.tolist(), base_plan.poses.tolist()]}
    return value_digest(inputs | samples)[:16]


def _write_user_files(folder: Path, dataset: Dataset, layout: Layout) -> None:
    """Write the files that the user of a real camera also has, besides the pictures."""
    layout.save(folder / "layout.json")
    save_board(folder / "board.toml", dataset.board)
