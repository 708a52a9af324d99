"""Calibrate from picture files, and write the result as files."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Protocol

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mirrorcam.calibration.calibration_page import write_report
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.core.disk.files import atomic, write_metrics
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import check_size, is_picture, pictures_in, read_image
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress, Step, no_progress, no_step
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import MISSING
from mirrorcam.core.video.video_files import open_video
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.corner_files import SUFFIX as MRCAL_SUFFIX
from mirrorcam.optics.calibration.corner_files import load_corners, save_corners
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.frame_choice import SharpestFrames, SharpFrame
from mirrorcam.optics.calibration.detection.next_pose import NextPose, NextPosePlanner, board_pose
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.diagnostics.view_statistics import ARROWS_ACROSS, cell_means
from mirrorcam.optics.calibration.direct.direct_view import calibrate_with_direct_view
from mirrorcam.optics.calibration.plain_camera import calibrate_camera
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard, load_board
from mirrorcam.optics.geometry.calibrated_camera import CalibratedCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.layout import Layout

FILES = ("metrics.json", "report.html", "residuals.png", "corners.csv")
"""Names of the files that a calibration writes besides its result (`result_name`)."""
MAX_NAMED = 6
"""Pictures named in a message."""
MAX_FRAMES, MAX_BASE_FRAMES = 30, 15
"""Maximum numbers of video frames that a calibration uses, with and without mirrors."""
SEARCHED_FRAMES = 60
"""Maximum number of frames of a video in which boards are searched."""
ARROW_CELLS = 0.8  # length, in cells, at which the RMS of the mean residuals is drawn


def calibrate_files(
    pictures: Sequence[Path],
    request: CalibrationRequest,
    *,
    detections: Path | None = None,
    progress: Progress = no_progress,
    on_hint: Callable[[str, NextPose], None] | None = None,
    on_note: Callable[[str], None] = lambda sentence: None,
    on_step: Step = no_step,
) -> Calibration:
    """Calibrate from files. Pictures are read one at a time; of a video, some frames are used.

    Parameters
    ----------
    pictures
        Pictures and videos of the board in the mirrors, or folders of pictures; empty with tables of corners.
    request
        The other inputs, and the model to fit.
    detections
        Folder that stores detected corners, so that no picture is searched twice.
    progress
        Called with the number of pictures done and their total.
    on_hint
        Called after each picture via the mirrors (without a layout, after the last) with its name and the pose
        recommended for the next.
    on_note
        Called with a sentence about the frames of each video, and about ignored files.
    on_step
        Called with each step of the solution in words.

    Raises
    ------
    InputError
        If a file cannot be read or the pictures do not suffice.
    """
    if bool(pictures) == bool(request.corners):
        raise InputError("expected pictures, or --corners FILE")
    if request.corners and on_hint is not None:
        raise InputError("--live-hint works only with pictures, expected no --corners")
    if request.board is None:
        raise InputError("expected --board FILE")
    board = load_board(request.board)
    if request.is_plain:
        if on_hint is not None:
            raise InputError("--live-hint needs --layout or --direct-view; else the next pose is always recommended")
        return _calibrate_plain(pictures, request, board, detections, progress, on_note, on_step)
    if request.direct_view is not None:
        return _calibrate_directly(pictures, request, request.direct_view, board, progress, on_hint, on_note)
    if request.layout is None:
        raise InputError("expected a layout, or the number of mirrors")
    layout = Layout.load(request.layout)
    if request.corners:
        return _with_surface(layout, request.model, _fit_to_corners(request, layout, board, on_step))
    mirrored, base = _all_pictures(pictures, request, layout.camera, on_note)
    planner = None if on_hint is None else NextPosePlanner.for_layout(layout, board)

    def hint(detected: Sequence[Observations]) -> None:
        if planner is not None and on_hint is not None:
            pose = board_pose(layout, board, detected[-1])
            if pose is not None:
                planner.add(pose, detected[-1])
            on_hint(mirrored.names[len(detected) - 1], planner.next())

    def fit(layout: Layout, model: RequestedModel, *, last: bool) -> Calibration:
        return calibrate(
            mirrored.pictures,
            base.pictures,
            layout,
            board,
            model=model,
            detections=detections,
            workers=cores(),
            max_pictures=(mirrored.max_pictures, base.max_pictures),
            names=(mirrored.labels, base.labels),
            progress=progress,
            on_observations=hint if last else lambda detected: None,
            on_step=on_step,
        )

    return _with_surface(layout, request.model, fit)


class _Fit(Protocol):
    """Fits a model, starting from a layout; `last` is false for a fit that only provides the start of another one."""

    def __call__(self, layout: Layout, model: RequestedModel, *, last: bool) -> Calibration: ...


def _with_surface(layout: Layout, requested: RequestedModel, fit: _Fit) -> Calibration:
    """Fit with mirrors of the requested surface; for new second-surface mirrors, fit the thickness first."""
    model = replace(requested, surface=None)
    if requested.surface == "second" and not layout.mirrors[0].is_second_surface:
        # The thickness determines the ghost images, and pictures determine it better than a data sheet does.
        first = fit(layout, RequestedModel(lens=model.lens), last=False)
        other_surface = first.diagnostics.other_surface if first.diagnostics is not None else None
        layout = layout.with_surface("second", None if other_surface is None else other_surface.thickness_mm)
        if model.auto and "sheet" not in model.additions:
            model = replace(model, additions=("sheet", *model.additions))
    elif requested.surface == "first":
        layout = layout.with_surface("first")
    return fit(layout, model, last=True)


def _fit_to_corners(request: CalibrationRequest, layout: Layout, board: CalibrationBoard, on_step: Step) -> _Fit:
    """Return a function that fits a model to the corners of a request's tables."""
    corners_mm = board.corners_in_board_mm
    tables = [load_corners(path, layout, len(corners_mm)) for path in request.corners]
    names = [name for table in tables for name in (*table.mirrored, *table.base)]
    left_out = _left_out(request.leave_out, names)
    mirrored, base = (
        [(name, corners) for pictures in groups for name, corners in pictures.items() if name not in left_out]
        for groups in ([table.mirrored for table in tables], [table.base for table in tables])
    )
    if not mirrored:
        raise InputError(f"{request.corners[0]}: all corners are in direct views, expected pictures via the mirrors")

    def fit(layout: Layout, model: RequestedModel, *, last: bool) -> Calibration:
        detected = calibrate_corners(
            [corners for _, corners in mirrored],
            [corners for _, corners in base],
            layout,
            corners_mm,
            model=model,
            names=[name for name, _ in (*mirrored, *base)],
            on_step=on_step,
        )
        return replace(detected, notes=(*(note for table in tables for note in table.notes), *detected.notes))

    return fit


def _calibrate_directly(
    pictures: Sequence[Path],
    request: CalibrationRequest,
    mirrors: int,
    board: CalibrationBoard,
    progress: Progress,
    on_hint: Callable[[str, NextPose], None] | None,
    on_note: Callable[[str], None],
) -> Calibration:
    mirrored, base = _all_pictures(pictures, request, None, on_note)
    return calibrate_with_direct_view(
        mirrored.read(),
        board,
        mirrors=mirrors,
        names=mirrored.names,
        base=base.read(),
        base_names=base.labels,
        max_pictures=mirrored.max_pictures,
        model=request.model,
        adjacent=mirrored.adjacent if any(mirrored.sources) else None,
        progress=progress,
        on_hint=on_hint,
    )


def _calibrate_plain(
    pictures: Sequence[Path],
    request: CalibrationRequest,
    board: CalibrationBoard,
    detections: Path | None,
    progress: Progress,
    on_note: Callable[[str], None],
    on_step: Step,
) -> Calibration:
    camera = None if request.camera is None else read_camera(request.camera)
    shown, _ = _all_pictures(pictures, request, camera, on_note)
    return calibrate_camera(
        shown.pictures,
        board,
        nominal=camera,
        model=request.model,
        detections=detections,
        workers=cores(),
        max_pictures=shown.max_pictures,
        names=shown.names if len(set(shown.names)) == len(shown.names) else shown.labels,
        progress=progress,
        on_step=on_step,
    )


def _all_pictures(
    pictures: Sequence[Path], request: CalibrationRequest, camera: Camera | None, on_note: Callable[[str], None]
) -> tuple[CalibrationPictures, CalibrationPictures]:
    """Collect the pictures via the mirrors and without them, without those to leave out."""
    mirrored, base = (
        calibration_pictures(paths, max_pictures, camera=camera, on_note=on_note)
        for paths, max_pictures in ((pictures, MAX_FRAMES), (request.base, MAX_BASE_FRAMES))
    )
    left_out = _left_out(request.leave_out, [*mirrored.labels, *base.labels])
    return mirrored.without(left_out), base.without(left_out)


def _left_out(leave_out: Sequence[str], labels: Sequence[str]) -> set[str]:
    """Labels of the pictures to leave out, each named by the last parts of its label.

    Raises InputError for a name of none, or of several.
    """
    left_out = set()
    for name in leave_out:
        parts = PurePath(name).parts
        named = [label for label in labels if PurePath(label).parts[-len(parts) :] == parts]
        if len(named) != 1:
            found = "no such picture" if not named else f"{len(named)} pictures have this name"
            expected = named or labels
            more = f", ... ({len(expected)} in all)" if len(expected) > MAX_NAMED else ""
            raise InputError(f"--leave-out {name}: {found}, expected one of {', '.join(expected[:MAX_NAMED])}{more}")
        left_out.add(named[0])
    return left_out


def result_name(*, plain: bool) -> str:
    """Name of the file with the calibrated layout, or with the camera if there are no mirrors."""
    return "camera.json" if plain else "layout.json"


def write_calibration(calibration: Calibration, folder: Path, *, command: str) -> None:
    """Write layout.json (or camera.json), metrics.json, report.html, residuals.png and corners.csv, each atomically.

    The report states `command`.
    """
    if calibration.layout.mirrors:
        calibration.layout.save(folder / result_name(plain=False))
    else:
        CalibratedCamera.of(calibration.layout).save(folder / result_name(plain=True))
    write_metrics(folder / "metrics.json", calibration.metrics)
    save_corners(folder / "corners.csv", calibration)
    residual_figure(calibration, folder / "residuals.png")
    write_report(calibration, folder / "report.html", command=command)


@dataclass(frozen=True, eq=False)
class CalibrationPictures:
    """Pictures to search, each a file or the grey values (h, w) of a frame, and their names.

    `max_pictures` is the number to use if there are video frames among them; None uses all. `sources` holds the video
    and frame index of each; None for a picture.
    """

    pictures: list[Path | Grey]
    names: list[str]
    max_pictures: int | None
    sources: list[tuple[Path, int] | None]

    @property
    def labels(self) -> list[str]:
        """Unique names: paths as given, and names of video frames."""
        return [
            picture.as_posix() if source is None and isinstance(picture, Path) else name
            for picture, name, source in zip(self.pictures, self.names, self.sources, strict=True)
        ]

    def without(self, labels: Collection[str]) -> CalibrationPictures:
        """Return all pictures but those with some labels."""
        kept = [number for number, label in enumerate(self.labels) if label not in labels]
        return CalibrationPictures(
            [self.pictures[n] for n in kept],
            [self.names[n] for n in kept],
            self.max_pictures,
            [self.sources[n] for n in kept],
        )

    def read(self) -> list[Grey]:
        """Read all pictures in grey; raises InputError for a file that cannot be read."""
        return [read_image(item, grey=True) if isinstance(item, Path) else item for item in self.pictures]

    def adjacent(self, numbers: Sequence[int]) -> list[tuple[Grey, Grey] | None]:
        """The frames before and after some pictures; None for a picture not from a video, or without both of them."""
        frame_numbers: dict[Path, set[int]] = {}
        for source in (self.sources[number] for number in numbers):
            if source is not None:
                frame_numbers.setdefault(source[0], set()).update((source[1] - 1, source[1] + 1))
        detected = {path: _frames(path, frames) for path, frames in frame_numbers.items()}
        pairs: list[tuple[Grey, Grey] | None] = []
        for source in (self.sources[number] for number in numbers):
            frames = {} if source is None else detected[source[0]]
            before, after = (None if source is None else frames.get(source[1] + step) for step in (-1, 1))
            pairs.append(None if before is None or after is None else (before, after))
        return pairs


def calibration_pictures(
    paths: Sequence[Path], max_pictures: int, *, camera: Camera | None = None, on_note: Callable[[str], None]
) -> CalibrationPictures:
    """Collect the pictures of files, folders and videos, in order.

    Parameters
    ----------
    paths
        Picture files, folders of them, and videos.
    max_pictures
        Number of pictures to use if there is a video among them.
    camera
        Camera whose picture size videos must have; None for any size.
    on_note
        Called with a sentence about each video (problems, number of frames chosen, duration), about ignored files of
        folders, and about pictures of 16 bits.

    Raises
    ------
    InputError
        For a folder without pictures, and for a file that is neither a picture nor a video, or has a different size.
    """
    pictures: list[Path | Grey] = []
    names: list[str] = []
    sources: list[tuple[Path, int] | None] = []
    for path in pictures_in(paths, on_note):
        if is_picture(path):
            pictures.append(path)
            names.append(path.name)
            sources.append(None)
            continue
        if path.suffix.lower() in (".csv", MRCAL_SUFFIX):
            raise InputError(f"{path}: a table of corners, expected pictures: give it with --corners")
        for frame in _sharp_frames(path, camera, on_note):
            pictures.append(frame.picture)
            names.append(f"{path.name} frame {frame.number}")
            sources.append((path, frame.number))
    return CalibrationPictures(pictures, names, max_pictures if any(sources) else None, sources)


def _sharp_frames(path: Path, camera: Camera | None, on_note: Callable[[str], None]) -> list[SharpFrame]:
    started = time.monotonic()
    video, sharpest, count, damaged, missing = open_video(path, on_note), SharpestFrames(SEARCHED_FRAMES), 0, 0, 0
    if camera is not None:
        check_size(path, (video.width_px, video.height_px), (camera.width_px, camera.height_px), "the layout's camera")
    if video.sample_bits.largest:
        on_note(f"{path.name}: {video.sample_bits}")
    for frame in video.frames():
        count += 1
        if not isinstance(frame, Frame):
            missing += frame.reason == MISSING
            damaged += frame.reason != MISSING
            continue
        sharpest.add(SharpFrame.of(frame.number, _grey(frame)))
    chosen = sharpest.chosen()
    if not chosen:
        raise InputError(f"{path}: none of its {count} frames can be read, expected a video of a board")
    skipped = f", {damaged} of them damaged" if damaged else ""
    skipped += f", {missing} more missing according to its time stamps" if missing else ""
    on_note(
        f"{path.name}: the {len(chosen)} sharpest of {count - missing} frames, from all of the video{skipped}, "
        f"read in {time.monotonic() - started:.1f} s"
    )
    return chosen


def _frames(path: Path, numbers: set[int]) -> dict[int, Grey]:
    """Frames of a video by index, without missing or damaged ones."""
    detected: dict[int, Grey] = {}
    for frame in open_video(path).frames():
        if frame.number > max(numbers):
            break
        if frame.number in numbers and isinstance(frame, Frame):
            detected[frame.number] = _grey(frame)
    return detected


def _grey(frame: Frame) -> Grey:
    return np.asarray(cv2.cvtColor(frame.pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def residual_figure(calibration: Calibration, path: Path) -> None:
    """Write a PNG: mean residuals in each part of the sensor, by view, and the distribution of all residuals.

    Mean residuals in cells show systematic errors of the model; without such errors, arrows point in random directions.
    """
    figure, (sensor, plot) = plt.subplots(1, 2, figsize=(13, 5), width_ratios=(2.3, 1), layout="constrained")
    _arrows(sensor, calibration)
    _distribution(plot, calibration)
    _save(figure, path)


def _arrows(axes: Axes, calibration: Calibration) -> None:
    camera = calibration.layout.camera
    cell_px = camera.width_px / ARROWS_ACROSS
    means = {int(view): cell_means(calibration, int(view)) for view in np.unique(calibration.observations.view)}
    rms = float(np.sqrt(np.mean(np.concatenate([cells.mean_px for cells in means.values()]) ** 2)))
    gain = ARROW_CELLS * cell_px / max(rms, 1e-12)
    colours = plt.get_cmap("tab10")
    for view, cells in means.items():
        name = "direct" if view == DIRECT else f"mirror {calibration.layout.mirror_names[view]}"
        colour = "0.65" if view == DIRECT else colours(view % 10)
        axes.quiver(
            *cells.centres_px.T,
            *(gain * cells.mean_px.T),
            color=colour,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.0015,
            label=name,
            zorder=1 if view == DIRECT else 2,
        )
    axes.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5), aspect="equal")
    title = f"Mean residual in cells of {cell_px:.0f} px, scale {gain:.0f}:1 (rms {rms:.3f} px)"
    axes.set(xlabel="x px", ylabel="y px", title=title)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=5, frameon=False, fontsize=8)


def _distribution(axes: Axes, calibration: Calibration) -> None:
    used = calibration.residuals_px[calibration.inliers]
    limit = 4.0 * float(used.std())
    for axis, values in zip("xy", used.T, strict=True):
        axes.hist(
            values,
            bins=np.linspace(-limit, limit, 61).tolist(),
            histtype="step",
            label=f"{axis}: {values.std():.3f} px",
        )
    axes.set(
        xlabel="residual px", ylabel="corners", title=f"{len(used)} corners, {int((~calibration.inliers).sum())} out"
    )
    axes.legend(frameon=False)


def _save(figure: Figure, path: Path) -> None:
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)
    plt.close(figure)
