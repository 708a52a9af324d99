"""Calibration of a camera that sees a board both directly and in its mirrors, with no layout to start from.

From a first estimate (`direct_start`) one camera, 3 numbers per mirror and one pose per picture are solved jointly;
where the corners support it, also one thickness of second-surface mirrors, and the board's corners: paper is printed
and glued less exactly than its corners are measured here. Rotations of the camera between the pictures are compensated
by the static scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mirrorcam.optics.base.progress import Progress, no_progress
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.detection.checkerboard import Grey, confirm, find_checkerboards
from mirrorcam.optics.calibration.detection.frame_choice import most_telling
from mirrorcam.optics.calibration.detection.other_boards import other_board
from mirrorcam.optics.calibration.detection.seen_grid import SeenGrid
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.model_comparison import compare, smallest
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, conclude, forward
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    DIRECT_ADDITIONS,
    Fitted,
    additions_of,
    fit_as,
    fit_with,
)
from mirrorcam.optics.calibration.direct.camera_motion import camera_rotations, stabilised
from mirrorcam.optics.calibration.direct.direct_result import direct_result
from mirrorcam.optics.calibration.direct.direct_start import FoundBoard, Start, first_estimate
from mirrorcam.optics.calibration.direct.rolling_shutter import at_middle_row, corner_velocities, rolling_shutter
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, UndeterminedError, fit
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.targets import Checkerboard

INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")
INVERTED = (
    "the board in the pictures has black and white exchanged, as where cols and rows are exchanged in board.toml: its "
    "corners are numbered as if its top left square were black"
)
MOST_NUMBERINGS = 8  # of a board of which a part is visible, for it to tell where the mirrors are


def calibrate_with_direct_view(
    pictures: Sequence[Grey],
    target: Checkerboard,
    *,
    mirrors: int,
    names: Sequence[str],
    most: int | None = None,
    level: str | None = None,
    beside: Callable[[Sequence[int]], Sequence[tuple[Grey, Grey] | None]] | None = None,
    progress: Progress = no_progress,
) -> Calibration:
    """Calibrate a camera and mirrors from pictures that show a board directly and in the mirrors, without a layout.

    Parameters
    ----------
    pictures
        Grey pictures (h, w) of one camera.
    target
        The board, a plain checkerboard; lengths come out in the unit of `target.square_mm`.
    mirrors
        Number of mirrors.
    names
        Names of the pictures, for the notes.
    most
        Number of pictures to use: those whose boards cover the picture and differ in pose; None: all.
    level
        Model to fit, `joint` with any of `DIRECT_ADDITIONS`; None selects the largest one that the pictures support.
    beside
        Gives of some pictures, by number, the frames before and after them, where they are of a video: a rolling
        shutter is searched for.
    progress
        Called with the number of pictures searched and of all.

    Returns
    -------
    Calibration
        Its layout has one row of mirrors, numbered from left to right, in the frame `rig` of the camera.

    Raises
    ------
    InputError
        Where the pictures do not determine camera and mirrors.
    """
    if not isinstance(target, Checkerboard):
        raise InputError("a direct view needs a plain checkerboard, got a ChArUco board")
    if not pictures:
        raise InputError("no pictures given")
    sizes = {picture.shape for picture in pictures}
    if len(sizes) > 1:
        raise InputError(f"pictures of {len(sizes)} sizes, expected pictures of one camera and size")
    if level is not None:
        additions_of(level, DIRECT_ADDITIONS)  # refused before pictures are searched
    grids = _found(pictures, target, progress)
    corners_mm = target.corners_in_board_mm
    height, width = pictures[0].shape
    notes: tuple[str, ...] = ()
    used = list(range(len(pictures)))
    if most is not None and len(pictures) > most:
        used = most_telling([_one_each(some, target) for some in grids], corners_mm, width_px=width, most=most)
        notes = (f"{len(used)} of {len(pictures)} pictures used: {', '.join(names[number] for number in used)}",)
        grids = [grids[number] for number in used]
        pictures, names = [pictures[number] for number in used], [names[number] for number in used]
    try:
        start, inverted = _first_estimate(grids, target, mirrors=mirrors, width_px=width, height_px=height)
    except InputError as error:
        # Parts of a larger checkerboard are taken for the stated one here and there.
        other = other_board(pictures, target, mirrored=None, found=True, fits=False)
        raise InputError(other or str(error)) from None
    if inverted:
        notes += (INVERTED,)
    shown = [_negative(pictures[number]) if inverted else pictures[number] for number in start.pictures]
    rigid = Model(INTRINSICS, thickness=False, curvature=False, board=Board.rigid(corners_mm))
    try:
        observations = _confirmed(shown, start.estimate, target)
        plain = start.estimate.with_poses(start.estimate.rig_from_board)
        flat = fit_as("joint", plain, observations, rigid)
        flat, observations, turns = _steadied(shown, flat, observations)
        selection, drawn = select_direct_model(flat, observations, level=level)
        shutter = None
        if beside is not None:
            numbers = [used[number] for number in start.pictures]
            velocity = _velocities(observations, [pictures[n] for n in start.pictures], beside(numbers))
            shutter = rolling_shutter(selection, observations, velocity, height)
            if shutter is not None and shutter.supported:
                observations = at_middle_row(observations, velocity, shutter.readout, height)
                flat = fit_as("joint", flat.solution.estimate, observations, rigid)
                selection, drawn = select_direct_model(flat, observations, level=level)
    except UndeterminedError as error:
        raise InputError(f"the pictures do not determine camera and mirrors: {error}") from None
    found = direct_result(
        selection, drawn, observations, pictures=start.pictures, names=names, turns=turns, shutter=shutter
    )
    return replace(found, notes=(*notes, *found.notes))


def _velocities(
    observations: Observations, pictures: Sequence[Grey], beside: Sequence[tuple[Grey, Grey] | None]
) -> FloatArray:
    frames = [
        None if pair is None else (pair[0], picture, pair[1]) for picture, pair in zip(pictures, beside, strict=True)
    ]
    return corner_velocities(observations, frames)


def _found(pictures: Sequence[Grey], target: Checkerboard, progress: Progress) -> list[list[SeenGrid]]:
    """The boards detected in each picture; raises InputError where there are none at all."""
    found = []
    for number, picture in enumerate(pictures):
        found.append(find_checkerboards(picture, target))
        progress(number + 1, len(pictures))
    if not any(_one_each(grids, target) for grids in found):
        other = other_board(pictures, target, mirrored=False, found=False)
        raise InputError(
            other or f"no {target.cols} x {target.rows} checkerboard found in any of {len(pictures)} pictures"
        )
    return found


def _one_each(grids: Sequence[SeenGrid], target: Checkerboard) -> list[Corners]:
    """The boards of a picture that may be the target or a part of it, each in one of its numberings."""
    each = [_numbered(way, target) for grid in grids for way in (grid, _inverted(grid))]
    return [(board.direct or board.image)[0] for board in each if board.direct or board.image][::2]


def _first_estimate(
    grids: Sequence[Sequence[SeenGrid]], target: Checkerboard, *, mirrors: int, width_px: int, height_px: int
) -> tuple[Start, bool]:
    """The first estimate, and whether the print has black and white exchanged, which the mirrors' geometry tells.

    Of a board whose numbers of columns and rows are both even, exchanged colours look like its mirror image.
    """
    starts, refusals = [], []
    for inverted in (False, True):
        found = []
        for in_picture in grids:
            boards = [_numbered(_inverted(grid) if inverted else grid, target) for grid in in_picture]
            found.append([board for board in boards if 0 < len(board.direct) + len(board.image) <= MOST_NUMBERINGS])
        try:
            start = first_estimate(
                found, target.corners_in_board_mm, mirrors=mirrors, width_px=width_px, height_px=height_px
            )
            starts.append((start, inverted))
        except InputError as error:
            refusals.append(error)
    if not starts:
        raise refusals[0]
    # Colours as stated are believed unless they explain the corners much worse.
    return min(starts, key=lambda pair: pair[0].error_px * (2.0 if pair[1] else 1.0))


def _inverted(grid: SeenGrid) -> SeenGrid:
    """The grid with black and white exchanged, as in the negative of its picture."""
    return replace(grid, places=grid.places + np.array([1, 0]))


def _negative(picture: Grey) -> Grey:
    return np.asarray(255 - picture, dtype=np.uint8)


def _steadied(
    pictures: Sequence[Grey], flat: Fitted, observations: Observations
) -> tuple[Fitted, Observations, FloatArray | None]:
    """The fit, the corners and the camera's rotations, where compensating these improves the fit; else None of them."""
    camera = flat.solution.estimate.camera
    turns = camera_rotations(pictures, camera)
    if turns is None:
        return flat, observations, None
    still = stabilised(observations, camera, turns)
    again = fit_as("joint", flat.solution.estimate, still, flat.model)
    if _squares(again.solution) < _squares(flat.solution):
        return again, still, turns
    return flat, observations, None


def select_direct_model(
    flat: Fitted, observations: Observations, *, level: str | None = None
) -> tuple[ModelSelection, Solution]:
    """Fit a given level, or select one by forward selection among `DIRECT_ADDITIONS`.

    Parameters
    ----------
    flat
        The fit of first-surface mirrors with the board as drawn.
    observations
        The corners.
    level
        Model to fit, `joint` with any of the additions; None selects one.

    Returns
    -------
    selection
        The selected model.
    drawn
        The fit of the same mirrors and camera with the board as drawn, in all frames.
    """
    comparisons, current = [smallest(flat)], flat
    for name in () if level is None else additions_of(level, DIRECT_ADDITIONS):
        larger = fit_with("plates" if name == "sheet" else name, current, observations)
        comparisons.append(compare(larger, current, observations))
        current = larger
    current, further, alarms, notes = forward(
        current, observations, DIRECT_ADDITIONS, extend=level is None, unplated="plates"
    )
    terms = replace(current.model.frame_terms, bow_per_mm=None)
    as_drawn = replace(current.model, board=flat.model.board, frame_terms=terms)
    estimate = current.solution.estimate
    start = replace(estimate, shape=np.zeros(0), bow_mm=np.zeros_like(estimate.bow_mm))
    drawn = fit(start, observations, as_drawn)
    return conclude(current, [*comparisons, *further], observations, alarms, notes), drawn


def _squares(solution: Solution) -> float:
    return float(np.sum(solution.standardised**2))


def _numbered(grid: SeenGrid, target: Checkerboard) -> FoundBoard:
    direct, image = (grid.numberings(target, mirrored=mirrored) for mirrored in (False, True))
    return FoundBoard(direct, image)


def _confirmed(pictures: Sequence[Grey], estimate: Estimate, target: Checkerboard) -> Observations:
    """All corners of all views, detected again where an estimate predicts them, which completes hidden boards."""
    board = Board.rigid(target.corners_in_board_mm)
    ids = np.arange(len(board.corners_in_board_mm))
    parts = []
    for frame, picture in enumerate(pictures):
        alone = estimate.of_frames(np.array([frame]))
        for view in range(DIRECT, len(estimate.virtual_centres_in_rig_mm)):
            predicted = residuals(alone, Observations.of_view(0, view, ids, np.zeros((len(ids), 2))), board)
            if not np.isfinite(predicted).all():
                continue
            corners = confirm(picture, predicted, target)
            if len(corners):
                parts.append(Observations.of_view(frame, view, corners.ids, corners.pixels, corners.sigma_px))
    return Observations.join(parts)
