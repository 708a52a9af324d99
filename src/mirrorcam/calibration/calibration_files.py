"""A calibration from picture files, and its result as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from mirrorcam.calibration.calibration_figure import residual_figure
from mirrorcam.calibration.calibration_page import write_report
from mirrorcam.calibration.calibration_pictures import calibration_pictures
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.corner_files import load_corners, save_corners
from mirrorcam.optics.calibration.detection.next_pose import NextPose, NextPosePlanner, pose_by_layout
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.nested_models import additions_of
from mirrorcam.optics.calibration.direct.direct_view import calibrate_with_direct_view
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.targets import Target, load_board

FILES = ("layout.json", "metrics.json", "report.html", "residuals.png", "corners.csv")
"""Names of the files of a calibration."""
MOST_FRAMES, MOST_BASE_FRAMES = 30, 15
"""Frames of videos that a calibration uses, with and without mirrors."""


@dataclass(frozen=True)
class CalibrationRequest:
    """Inputs of a calibration from files.

    Parameters
    ----------
    board
        `board.toml` of the target.
    pictures
        Pictures and videos of the board through the mirrors, or folders of such pictures.
    corners
        Tables of corners, in place of pictures with and without mirrors.
    layout
        Nominal `layout.json`; None where the camera sees the board directly, too.
    base_pictures
        Pictures and videos of the board by the camera without mirrors, or folders of pictures.
    mirrors
        Number of mirrors, where there is no layout.
    level
        Model to fit; None: the one that the pictures support.
    lens
        Lens model of the camera; None: the layout's, or the one that the pictures support.
    surface
        Which surface of the mirrors reflects, where that is not what the layout says; None: as it says.
    detections
        Folder that keeps found corners, so that no picture is searched twice.
    """

    board: Path
    pictures: tuple[Path, ...] = ()
    corners: tuple[Path, ...] = ()
    layout: Path | None = None
    base_pictures: tuple[Path, ...] = ()
    mirrors: int | None = None
    level: str | None = None
    lens: LensName | None = None
    surface: Literal["first", "second"] | None = None
    detections: Path | None = None

    def __post_init__(self) -> None:
        if (self.layout is None) == (self.mirrors is None):
            raise InputError(
                "expected a nominal layout, or the number of mirrors where the board is also seen directly"
            )
        if bool(self.pictures) == bool(self.corners) or (self.corners and self.layout is None):
            raise InputError("expected pictures, or tables of corners with a nominal layout")


def calibrate_files(
    request: CalibrationRequest,
    progress: Progress = no_progress,
    on_hint: Callable[[str, NextPose], None] | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> Calibration:
    """Calibrate from files; every picture is read when its turn comes, and of every video some frames are used.

    `progress` is called with the numbers of pictures done and of all; `on_hint`, where given, after each picture
    through the mirrors (without a layout, after all of them) with its name and the pose that the next one should show;
    `tell` with a sentence on the frames of each video, and on files left out. Raises InputError where a
    file cannot be read or the pictures do not suffice.
    """
    target = load_board(request.board)
    if request.layout is None:
        return _calibrate_directly(request, target, progress, on_hint, tell)
    layout = Layout.load(request.layout)
    if request.corners:
        fit_corners = _fit_to_corners(request, layout, target)
        return fit_corners(_model(request, layout, fit_corners))
    seen, base = (
        calibration_pictures(paths, most, camera=layout.camera, tell=tell)
        for paths, most in ((request.pictures, MOST_FRAMES), (request.base_pictures, MOST_BASE_FRAMES))
    )
    planner = None if on_hint is None else NextPosePlanner.designed(layout, target)

    def hint(found: Sequence[Observations]) -> None:
        if planner is not None and on_hint is not None:
            pose = pose_by_layout(layout, target, found[-1])
            if pose is not None:
                planner.add(pose, found[-1])
            on_hint(seen.names[len(found) - 1], planner.next())

    def fit(model: _Model, on_seen: Callable[[Sequence[Observations]], None] = lambda found: None) -> Calibration:
        return calibrate(
            seen.pictures,
            base.pictures,
            model.layout,
            target,
            level=model.level,
            extend=model.extend,
            lens=request.lens,
            detections=request.detections,
            workers=cores(),
            most=(seen.most, base.most),
            names=(seen.labels, base.labels),
            on_frame=lambda done: progress(done, len(seen.pictures) + len(base.pictures)),
            on_seen=on_seen,
        )

    return fit(_model(request, layout, fit), on_seen=hint)


@dataclass(frozen=True)
class _Model:
    """What is fitted: mirrors as of a layout, a level (None: chosen by evidence), and whether levels above it count."""

    layout: Layout
    level: str | None
    extend: bool = False


def _model(request: CalibrationRequest, layout: Layout, fit: Callable[[_Model], Calibration]) -> _Model:
    """The model for mirrors of the requested surface; `fit` is called where the thickness of plates is to be found."""
    if request.surface == "second" and not layout.mirrors[0].is_second_surface:
        # The thickness decides where ghost images are; the pictures tell it better than the drawing of a plate.
        first = fit(_Model(layout, "joint"))
        other_surface = first.diagnostics.other_surface if first.diagnostics is not None else None
        layout = layout.with_surface("second", None if other_surface is None else other_surface.thickness_mm)
        return _Model(layout, "joint+sheet", extend=True) if request.level is None else _Model(layout, request.level)
    return _Model(layout.with_surface("first") if request.surface == "first" else layout, request.level)


def _fit_to_corners(request: CalibrationRequest, layout: Layout, target: Target) -> Callable[[_Model], Calibration]:
    """A function that fits a model to the corners in the tables of a request."""
    corners_mm = target.corners_in_board_mm
    tables = [load_corners(path, layout, len(corners_mm)) for path in request.corners]
    seen = [picture for table in tables for picture in table.seen.items()]
    base = [picture for table in tables for picture in table.base.items()]
    if not seen:
        raise InputError(f"{request.corners[0]}: all corners are seen directly, expected pictures through the mirrors")
    if request.level is not None:
        additions_of(request.level)

    def fit(model: _Model) -> Calibration:
        found = calibrate_corners(
            [corners for _, corners in seen],
            [corners for _, corners in base],
            model.layout,
            corners_mm,
            level=model.level,
            extend=model.extend,
            lens=request.lens,
            names=[name for name, _ in (*seen, *base)],
        )
        return replace(found, notes=(*(note for table in tables for note in table.notes), *found.notes))

    return fit


def _calibrate_directly(
    request: CalibrationRequest,
    target: Target,
    progress: Progress,
    on_hint: Callable[[str, NextPose], None] | None,
    tell: Callable[[str], None],
) -> Calibration:
    if request.mirrors is None:
        raise InputError("expected the number of mirrors")
    taken = calibration_pictures(request.pictures, MOST_FRAMES, tell=tell)
    base = calibration_pictures(request.base_pictures, MOST_BASE_FRAMES, tell=tell)
    return calibrate_with_direct_view(
        taken.read(),
        target,
        mirrors=request.mirrors,
        names=taken.names,
        base=base.read(),
        base_names=base.labels,
        most=taken.most,
        level=request.level,
        beside=taken.beside if any(taken.sources) else None,
        progress=progress,
        on_hint=on_hint,
    )


def write_calibration(calibration: Calibration, folder: Path, *, command: str) -> None:
    """Write layout.json, metrics.json, report.html, residuals.png and corners.csv into a folder, each atomically.

    `command` is what the report says it was made by.
    """
    calibration.layout.save(folder / "layout.json")
    write_metrics(folder / "metrics.json", calibration.metrics)
    save_corners(folder / "corners.csv", calibration)
    residual_figure(calibration, folder / "residuals.png")
    write_report(calibration, folder / "report.html", command=command)
