"""Calibration of a camera that sees a board both directly and in its mirrors, without a layout.

A first estimate (`direct_start`) and a fit of one camera, 3 parameters per mirror and one pose per picture give a
layout measured from the corners. Rotations of the camera between pictures are compensated by means of the static scene.
From there on, the calibration is that with a layout (`corner_calibration`). If it finds plates in front of the mirrors,
or a rolling shutter, corners are corrected for ghost images or for their motion, and it is repeated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text, grouped_names
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.calibration import other_board_in_sample
from mirrorcam.optics.calibration.corner_calibration import FittedCorners, calibration_of, fit_corners
from mirrorcam.optics.calibration.detection.board_growing import softened
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_direct_view
from mirrorcam.optics.calibration.detection.frame_choice import most_informative
from mirrorcam.optics.calibration.detection.ghost_images import refine_with_ghosts
from mirrorcam.optics.calibration.detection.next_pose import NextPose
from mirrorcam.optics.calibration.detection.other_boards import other_board
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, layout_from_corners
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.diagnostics.worst_views import with_worst_views
from mirrorcam.optics.calibration.direct.direct_boards import (
    FLIPPED,
    INVERTED,
    SMOOTHER,
    DetectedBoard,
    boards_in,
    confirmed_corners,
    distance_note,
    first_estimate_of,
    fits_flipped,
    more_mirrors,
    negative,
)
from mirrorcam.optics.calibration.direct.direct_result import with_direct_figures
from mirrorcam.optics.calibration.direct.motion import (
    Shutter,
    camera_rotations,
    corner_velocities,
    corrected_to_middle_row,
    rolling_shutter,
    stabilised,
)
from mirrorcam.optics.calibration.direct.next_direct_pose import next_direct_pose
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")
"""Free intrinsics of the first fit, which few boards determine."""


def calibrate_with_direct_view(
    pictures: Sequence[Grey],
    board: CalibrationBoard,
    *,
    mirrors: int,
    names: Sequence[str],
    base: Sequence[Grey] = (),
    base_names: Sequence[str] = (),
    max_pictures: int | None = None,
    model: RequestedModel = AUTO,
    adjacent: Callable[[Sequence[int]], Sequence[tuple[Grey, Grey] | None]] | None = None,
    progress: Progress = no_progress,
    on_hint: Callable[[str, NextPose], None] | None = None,
) -> Calibration:
    """Calibrate a camera and mirrors from pictures that show a board directly and in the mirrors, without a layout.

    Parameters
    ----------
    pictures
        Grey pictures (h, w) of one camera.
    board
        The board; lengths are in the unit of `board.square_mm`.
    mirrors
        Number of mirrors.
    names
        Names of the pictures, for notes.
    base
        Pictures of the board by the same camera without mirrors, which improve the intrinsics.
    base_names
        Names of `base`.
    max_pictures
        Maximum number of pictures to use, chosen so that boards cover the picture and differ in pose; None for all.
    model
        Model to fit. Default: the largest one that the pictures support.
    adjacent
        Returns the frames before and after each picture of the given numbers, if these are frames of a video; then a
        rolling shutter is estimated.
    progress
        Called with the number of pictures searched and the total.
    on_hint
        Called, as soon as the mirrors are roughly known, with the name of the last picture and the recommended pose for
        the next one.

    Returns
    -------
    Calibration
        Its layout has one row of mirrors, numbered from left to right, in the rig frame, which is the camera's.

    Raises
    ------
    InputError
        If the pictures do not determine the camera and the mirrors.
    """
    if not pictures:
        raise InputError("no pictures given")
    _check_sizes((*pictures, *base), (*names, *base_names))
    if other := other_board_in_sample(pictures, board, mirrored=None):
        raise InputError(other)
    boards = boards_in(pictures, board, max_boards=mirrors + 1, progress=progress)
    # Pictures with the most corners come first: those taken first may not show the board yet.
    pictures_by_corners = [
        pictures[number] for number in sorted(range(len(pictures)), key=lambda number: -_corner_count(boards[number]))
    ]
    if other := other_board(pictures_by_corners, board, mirrored=None, found=True):
        raise InputError(other)
    corners_mm = board.corners_in_board_mm
    height, width = pictures[0].shape
    notes: tuple[str, ...] = ()
    used = list(range(len(pictures)))
    if max_pictures is not None and len(pictures) > max_pictures:
        detected = [
            [found.any_numbering for found in in_picture if found.any_numbering is not None] for in_picture in boards
        ]
        used = most_informative(detected, corners_mm, width_px=width, max_frames=max_pictures)
        notes = (f"{len(used)} of {len(pictures)} pictures used: {grouped_names([names[number] for number in used])}",)
        boards = [boards[number] for number in used]
        pictures, names = [pictures[number] for number in used], [names[number] for number in used]
    try:
        start, inverted = first_estimate_of(boards, board, mirrors=mirrors, width_px=width, height_px=height)
    except InputError as error:
        # The stated board was found but gives no estimate: parts of a larger checkerboard can look like it.
        other = other_board(pictures_by_corners, board, mirrored=None, found=True, fits=False)
        if other is None and fits_flipped(boards, board, mirrors=mirrors, width_px=width, height_px=height):
            other = FLIPPED
        raise InputError(other or f"{error}{more_mirrors(boards, names, mirrors)}") from None
    if inverted:
        notes += (INVERTED,)
    notes += distance_note(start.estimate, board)
    used_pictures = [negative(pictures[number]) if inverted else pictures[number] for number in start.pictures]
    try:
        observations, is_sharpened = confirmed_corners(used_pictures, start, board)
        base_pictures = [negative(picture) if inverted else picture for picture in base]
        if is_sharpened:
            notes += (SMOOTHER,)
            used_pictures, base_pictures = (
                [softened(picture) for picture in group] for group in (used_pictures, base_pictures)
            )
        base_corners = [detect_direct_view(picture, board) for picture in base_pictures]
        used_names = [names[number] for number in start.pictures]
        if on_hint is not None:
            shown = [rows for rows in base_corners if len(rows)]
            hint = next_direct_pose(
                start.estimate, observations, board, intrinsics=INTRINSICS, pictures=used_names, base=shown
            )
            if hint is not None:
                on_hint(names[-1], hint)
        rigid = Model(INTRINSICS, thickness=False, curvature=False, board=Board.rigid(corners_mm))
        start_poses = start.estimate.with_poses(start.estimate.rig_from_board)
        flat = fit_as("joint", start_poses, observations, rigid)
        flat, rotations = _with_rotations(used_pictures, flat, observations)
        estimate = flat.solution.estimate
        frames = _Frames(
            used_pictures,
            [observations.where(observations.frame == n).with_frame_offset(-n) for n in range(len(used_pictures))],
            [None] * len(used_pictures),
            estimate.camera,
            rotations,
        )
        if adjacent is not None:
            pairs = adjacent([used[number] for number in start.pictures])
            triplets = [
                None if pair is None else (pair[0], pictures[number], pair[1])
                for number, pair in zip(start.pictures, pairs, strict=True)
            ]
            frames = replace(frames, triplets=triplets)
        labels = [*used_names, *(base_names or [f"base frame {number}" for number in range(len(base))])]
        layout = layout_from_corners(estimate, observations.where(flat.solution.inliers))
        fitted, layout, shutter = _fitted(frames, base_corners, layout, board, model, labels)
        result = with_direct_figures(calibration_of(fitted, layout), rotations, shutter)
        shown_pictures = [*used_pictures, *base]
        result = with_worst_views(result, lambda frame: shown_pictures[fitted.frames[frame]])
    except (UndeterminedError, InvalidValue) as error:
        # Parts of a different board that look like the stated one lead to impossible mirrors, or to views without it.
        if other := other_board(pictures_by_corners, board, mirrored=None, found=False):
            raise InputError(other) from None
        if isinstance(error, InvalidValue):
            raise InputError(f"the pictures lead to impossible mirrors: {error}") from None
        more = more_mirrors(boards, names, mirrors)
        raise InputError(f"the pictures do not determine camera and mirrors: {error}{more}") from None
    unused = [f"{name}: no board found, not used" for n, name in enumerate(names) if n not in start.pictures]
    return result.with_figures({}, [*notes, *unused])


def _corner_count(boards: Sequence[DetectedBoard]) -> int:
    """Number of corners of all boards in a picture."""
    return sum(len(board.any_numbering) for board in boards if board.any_numbering is not None)


def _check_sizes(pictures: Sequence[Grey], names: Sequence[str]) -> None:
    """Raise InputError for the first picture whose size differs from the most common size."""
    sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures]
    ((usual, count),) = Counter(sizes).most_common(1)
    for number, size in enumerate(sizes):
        if size != usual:
            name = names[number] if number < len(names) else f"picture {number + 1}"
            others = f"{usual[0]}x{usual[1]} of {count_text(count, 'other')}"
            raise InputError(f"{name}: {size[0]}x{size[1]} px, expected {others}: pictures of one camera and size")


@dataclass(frozen=True)
class _Frames:
    """Pictures with the corners detected in each (frame 0), and the motion of camera and board.

    Attributes
    ----------
    pictures
        The pictures.
    detected
        Their corners.
    triplets
        Each picture between the frames before and after; None if it is not from a video.
    camera
        The camera, for its rotations.
    rotations
        Rotation vectors (f, 3), rad, of the camera since the first picture, if they are compensated.
    shutter
        The rolling shutter, if it was estimated.
    """

    pictures: Sequence[Grey]
    detected: Sequence[Observations]
    triplets: Sequence[tuple[Grey, Grey, Grey] | None]
    camera: Camera
    rotations: FloatArray | None
    shutter: Shutter | None = None

    def corrected(self) -> list[Observations]:
        """Correct the corners of each picture for the camera's rotation, and to the time of the middle row."""
        frames = list(self.detected)
        if self.shutter is not None and self.shutter.supported:
            height_px = self.camera.height_px
            frames = [
                corrected_to_middle_row(rows, corner_velocities(rows, [triplet]), self.shutter.readout, height_px)
                for rows, triplet in zip(frames, self.triplets, strict=True)
            ]
        if self.rotations is not None:
            frames = [
                stabilised(rows, self.camera, self.rotations[number : number + 1]) for number, rows in enumerate(frames)
            ]
        return frames

    def with_shutter(self, fitted: FittedCorners) -> _Frames:
        """Estimate the rolling shutter from fitted corners that are not corrected for it."""
        triplets = [self.triplets[number] if number < len(self.triplets) else None for number in fitted.frames]
        velocity = corner_velocities(fitted.observations, triplets)
        shutter = rolling_shutter(fitted.selection, fitted.observations, velocity, self.camera.height_px)
        return replace(self, shutter=shutter)

    def with_ghosts(self, fitted: FittedCorners, layout: Layout, board: CalibrationBoard) -> _Frames:
        """Refine the corners in second-surface mirrors together with their ghost images."""
        poses = dict(zip(fitted.frames, fitted.selection.solution.estimate.rig_from_board, strict=True))
        refined = refine_with_ghosts(
            self.detected, self.pictures, poses, layout, board, edges_known=False, workers=cores()
        )
        return replace(self, detected=refined)


def _fitted(
    frames: _Frames,
    base: Sequence[Observations],
    layout: Layout,
    board: CalibrationBoard,
    model: RequestedModel,
    names: Sequence[str],
) -> tuple[FittedCorners, Layout, Shutter | None]:
    """Return the fit of the corners, corrected for the shutter and for ghost images, its layout, and the shutter.

    `layout` has first-surface mirrors; the returned one has plates if the fit has.
    """
    fit = partial(
        fit_corners, base=list(base), corners_in_board_mm=board.corners_in_board_mm, names=names, is_designed=False
    )
    if model.surface == "second" and "sheet" not in model.additions:
        model = replace(model, additions=("sheet", *model.additions))
    fitted = fit(frames.corrected(), layout=layout, model=model)
    if any(triplet is not None for triplet in frames.triplets):
        frames = frames.with_shutter(fitted)
    has_shutter = frames.shutter is not None and frames.shutter.supported
    if has_shutter:
        fitted = fit(frames.corrected(), layout=layout, model=model)
    solution = fitted.selection.solution
    if (solution.estimate.thickness_mm > 0.0).any():
        layout = layout_from_corners(solution.estimate, fitted.observations.where(solution.inliers))
        frames = frames.with_ghosts(fitted, layout, board)
        if "sheet" not in model.additions:
            model = replace(model, additions=("sheet", *model.additions))
        fitted = fit(frames.corrected(), layout=layout, model=model)
    return fitted, layout, frames.shutter


def _with_rotations(
    pictures: Sequence[Grey], flat: Fitted, observations: Observations
) -> tuple[Fitted, FloatArray | None]:
    """Return the fit with the camera's rotations compensated if that improves it, and the rotations."""
    camera = flat.solution.estimate.camera
    rotations = camera_rotations(pictures, camera)
    if rotations is None:
        return flat, None
    compensated = fit_as("joint", flat.solution.estimate, stabilised(observations, camera, rotations), flat.model)
    if np.sum(compensated.solution.standardised**2) < np.sum(flat.solution.standardised**2):
        return compensated, rotations
    return flat, None
