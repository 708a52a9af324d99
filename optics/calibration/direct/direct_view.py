"""Calibration of a camera that sees a board both directly and in its mirrors, without a layout.

From a first estimate (`direct_start`), one camera, 3 parameters per mirror and one pose per picture are solved jointly.
If the corners support it, so are a common thickness of second-surface mirrors, and the board's corners: paper is
printed and glued less accurately than its corners are measured here. Rotations of the camera between pictures are
compensated by means of the static scene.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text, grouped_names
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_direct_view
from mirrorcam.optics.calibration.detection.frame_choice import most_informative
from mirrorcam.optics.calibration.detection.next_pose import NextPose
from mirrorcam.optics.calibration.detection.other_boards import other_board
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.model_comparison import compare, smallest_model
from mirrorcam.optics.calibration.diagnostics.model_selection import (
    ModelSelection,
    finished_selection,
    forward_selection,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    Fitted,
    fit_as,
    fit_with,
)
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, DIRECT_ADDITIONS, RequestedModel
from mirrorcam.optics.calibration.direct.direct_boards import (
    FLIPPED,
    INVERTED,
    DetectedBoard,
    boards_in,
    confirmed_corners,
    distance_note,
    first_estimate_of,
    fits_flipped,
    more_mirrors,
    negative,
)
from mirrorcam.optics.calibration.direct.direct_result import direct_result
from mirrorcam.optics.calibration.direct.motion import (
    camera_rotations,
    corner_velocities,
    corrected_to_middle_row,
    rolling_shutter,
    stabilised,
)
from mirrorcam.optics.calibration.direct.next_direct_pose import next_direct_pose
from mirrorcam.optics.calibration.solver.initial_estimates import camera_from_flat_board
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, UndeterminedError, fit
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.targets import Target

INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")


def calibrate_with_direct_view(
    pictures: Sequence[Grey],
    target: Target,
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
    target
        The board; lengths are in the unit of `target.square_mm`.
    mirrors
        Number of mirrors.
    names
        Names of the pictures, for notes.
    base
        Pictures of the board by the same camera without mirrors, which improve the intrinsics.
    base_names
        Names of `base`, for messages.
    max_pictures
        Maximum number of pictures to use, chosen so that boards cover the picture and differ in pose; None for all.
    model
        Model to fit, with any of `DIRECT_ADDITIONS`. Default: the largest one that the pictures support.
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
    model.check_direct()
    boards = boards_in(pictures, target, max_boards=mirrors + 1, progress=progress)
    # Pictures with the most corners come first: those taken first may not show the board yet.
    pictures_by_corners = [
        pictures[number] for number in sorted(range(len(pictures)), key=lambda number: -_corner_count(boards[number]))
    ]
    if other := other_board(pictures_by_corners, target, mirrored=None, found=True):
        raise InputError(other)
    corners_mm = target.corners_in_board_mm
    height, width = pictures[0].shape
    notes: tuple[str, ...] = ()
    used = list(range(len(pictures)))
    if max_pictures is not None and len(pictures) > max_pictures:
        detected = [
            [board.any_numbering for board in in_picture if board.any_numbering is not None] for in_picture in boards
        ]
        used = most_informative(detected, corners_mm, width_px=width, max_frames=max_pictures)
        notes = (f"{len(used)} of {len(pictures)} pictures used: {grouped_names([names[number] for number in used])}",)
        boards = [boards[number] for number in used]
        pictures, names = [pictures[number] for number in used], [names[number] for number in used]
    try:
        start, inverted = first_estimate_of(boards, target, mirrors=mirrors, width_px=width, height_px=height)
    except InputError as error:
        # The stated board was found but gives no estimate: parts of a larger checkerboard can look like it.
        other = other_board(pictures_by_corners, target, mirrored=None, found=True, fits=False)
        if other is None and fits_flipped(boards, target, mirrors=mirrors, width_px=width, height_px=height):
            other = FLIPPED
        raise InputError(other or f"{error}{more_mirrors(boards, names, mirrors)}") from None
    if inverted:
        notes += (INVERTED,)
    notes += distance_note(start.estimate, target)
    used_pictures = [negative(pictures[number]) if inverted else pictures[number] for number in start.pictures]
    rigid = Model(INTRINSICS, thickness=False, curvature=False, board=Board.rigid(corners_mm))
    try:
        observations = confirmed_corners(used_pictures, start, target)
        base_corners = [detect_direct_view(negative(picture) if inverted else picture, target) for picture in base]
        base_corners = [rows for rows in base_corners if len(rows)]
        if on_hint is not None:
            used_names = [names[number] for number in start.pictures]
            hint = next_direct_pose(
                start.estimate, observations, target, intrinsics=INTRINSICS, pictures=used_names, base=base_corners
            )
            if hint is not None:
                on_hint(names[-1], hint)
        start_poses = start.estimate.with_poses(start.estimate.rig_from_board)
        flat = fit_as("joint", start_poses, observations, rigid)
        rigid = replace(rigid, intrinsics=flat.solution.estimate.camera.intrinsic_names)
        flat = fit_as("joint", flat.solution.estimate, observations, rigid)
        flat, observations, rotations = _compensate_rotations(used_pictures, flat, observations)
        flat, observations = _with_base(flat, observations, base_corners)
        selection, flat_solution = select_direct_model(flat, observations, model=model)
        shutter = None
        if adjacent is not None:
            numbers = [used[number] for number in start.pictures]
            triplets = [
                None if pair is None else (pair[0], pictures[n], pair[1])
                for n, pair in zip(start.pictures, adjacent(numbers), strict=True)
            ]
            velocity = corner_velocities(observations, triplets)
            shutter = rolling_shutter(selection, observations, velocity, height)
            if shutter is not None and shutter.supported:
                observations = corrected_to_middle_row(observations, velocity, shutter.readout, height)
                flat = fit_as("joint", flat.solution.estimate, observations, rigid)
                selection, flat_solution = select_direct_model(flat, observations, model=model)
        result = direct_result(
            selection,
            flat_solution,
            observations,
            pictures=start.pictures,
            names=names,
            rotations=rotations,
            shutter=shutter,
        )
    except UndeterminedError as error:
        more = more_mirrors(boards, names, mirrors)
        raise InputError(f"the pictures do not determine camera and mirrors: {error}{more}") from None
    except InvalidValue as error:
        # Parts of a different board that look like the stated one lead to impossible mirrors.
        other = other_board(pictures, target, mirrored=None, found=False)
        raise InputError(other or f"the pictures lead to impossible mirrors: {error}") from None
    return replace(result, notes=(*notes, *result.notes))


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


def _with_base(flat: Fitted, observations: Observations, base: Sequence[Observations]) -> tuple[Fitted, Observations]:
    """Add the corners of pictures without mirrors, each as frame 0, and fit again."""
    estimate = flat.solution.estimate
    poses, parts = [*estimate.rig_from_board], [observations]
    for rows in base:
        corners = Corners(rows.corner, rows.pixels, rows.sigma_px)
        pose = camera_from_flat_board(estimate.camera, corners, flat.model.board.corners_in_board_mm)
        if pose is not None:
            parts.append(rows.with_frame_offset(len(poses)))
            poses.append(pose)
    if len(parts) == 1:
        return flat, observations
    joined = Observations.join(parts)
    return fit_as("joint", estimate.with_poses(np.array(poses)), joined, flat.model), joined


def _compensate_rotations(
    pictures: Sequence[Grey], flat: Fitted, observations: Observations
) -> tuple[Fitted, Observations, FloatArray | None]:
    """Return fit, corners and camera rotations, compensated if that improves the fit; otherwise rotations are None."""
    camera = flat.solution.estimate.camera
    rotations = camera_rotations(pictures, camera)
    if rotations is None:
        return flat, observations, None
    compensated = stabilised(observations, camera, rotations)
    refitted = fit_as("joint", flat.solution.estimate, compensated, flat.model)
    if _squares(refitted.solution) < _squares(flat.solution):
        return refitted, compensated, rotations
    return flat, observations, None


def select_direct_model(
    flat: Fitted, observations: Observations, *, model: RequestedModel = AUTO
) -> tuple[ModelSelection, Solution]:
    """Fit the requested model and, if it is automatic, extend it with `DIRECT_ADDITIONS`.

    Parameters
    ----------
    flat
        The fit of first-surface mirrors with the board as drawn.
    observations
        The corners.
    model
        Model to fit, with any of the additions.

    Returns
    -------
    selection
        The selected model.
    flat_solution
        The fit of the same mirrors and camera with the board as drawn in all frames.
    """
    comparisons, current = [smallest_model(flat)], flat
    for name in model.additions:
        larger = fit_with("plates" if name == "sheet" else name, current, observations)
        comparisons.append(compare(larger, current, observations))
        current = larger
    current, further, alarms, notes = forward_selection(
        current, observations, DIRECT_ADDITIONS, extend=model.auto, plate_addition="plates"
    )
    terms = replace(current.model.frame_terms, bow_per_mm=None)
    as_drawn = replace(current.model, board=flat.model.board, frame_terms=terms)
    estimate = current.solution.estimate
    start = replace(estimate, shape=np.zeros(0), bow_mm=np.zeros_like(estimate.bow_mm))
    flat_solution = fit(start, observations, as_drawn)
    return finished_selection(current, [*comparisons, *further], observations, alarms, notes), flat_solution


def _squares(solution: Solution) -> float:
    return float(np.sum(solution.standardised**2))
