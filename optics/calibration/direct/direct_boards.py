"""Boards in pictures that show them directly and in mirrors, with all of their possible numberings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.progress import Progress
from mirrorcam.optics.calibration.detection.board_growing import grow_board, softened
from mirrorcam.optics.calibration.detection.board_warp import BoardWarp, corner_print_xy
from mirrorcam.optics.calibration.detection.charuco import find_marked_boards as find_with_markers
from mirrorcam.optics.calibration.detection.checkerboard import (
    Grey,
    confirm,
    find_checkerboards,
    non_collinear,
)
from mirrorcam.optics.calibration.detection.detections import DetectedGrid
from mirrorcam.optics.calibration.detection.other_boards import other_board
from mirrorcam.optics.calibration.direct.direct_start import NumberedBoard, Start, first_direct_estimate
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard

MAX_FLIPPED = 0.003  # rms error of the first estimate from flipped pictures, relative to the picture's diagonal
MIN_DISTANCE_MM, MAX_DISTANCE_MM = 60.0, 20000.0  # at which cameras with mirrors show boards in focus
MIN_COMPLETE = 0.95  # of the corners in the pictures, fraction that must be found in softened ones
MAX_SMOOTHER = 0.97  # their roughness in softened pictures relative to that in the pictures, if these are sharpened
MAX_NUMBERINGS = 8  # of a partly visible board that is used to locate the mirrors
FLIPPED = "the pictures are flipped left to right, as from a selfie camera: switch that off, or flip all of them back"
INVERTED = (
    "the board in the pictures has black and white exchanged, as if cols and rows of board were exchanged: its "
    "corners are numbered as if its top left square were black"
)
SMOOTHER = (
    "corners lie straighter in softened pictures, as where a camera sharpens or its pixels alias: softened ones were "
    "used; switch sharpening off if you can"
)


@dataclass(frozen=True)
class DetectedBoard:
    """A board in a picture: its numberings with the stated colours, and with black and white exchanged."""

    stated: NumberedBoard
    inverted: NumberedBoard

    @property
    def any_numbering(self) -> Corners | None:
        """One of its numberings; None if there is none."""
        numberings = [*self.stated.direct, *self.stated.image, *self.inverted.direct, *self.inverted.image]
        return numberings[0] if numberings else None

    def flipped(self, width_px: int) -> DetectedBoard:
        """Return the board in the picture flipped left to right, which swaps direct and mirrored numberings."""
        return DetectedBoard(_flipped(self.stated, width_px), _flipped(self.inverted, width_px))


def _flipped(board: NumberedBoard, width_px: int) -> NumberedBoard:
    direct, image = (
        [
            replace(corners, pixels=np.array([width_px - 1.0, 0.0]) + corners.pixels * [-1.0, 1.0])
            for corners in numberings
        ]
        for numberings in (board.image, board.direct)
    )
    return NumberedBoard(direct, image)


def boards_in(
    pictures: Sequence[Grey], board: CalibrationBoard, *, max_boards: int, progress: Progress
) -> list[list[DetectedBoard]]:
    """Detect boards in each picture, up to `max_boards` of each handedness; raises InputError if there are none."""
    all_boards = []
    for number, picture in enumerate(pictures):
        if isinstance(board, Checkerboard):
            boards = _checkerboards(picture, board)
        else:
            boards = _with_markers(picture, board, max_boards)
        all_boards.append([detected for detected in boards if detected.any_numbering is not None])
        progress(number + 1, len(pictures))
    if not any(all_boards):
        raise InputError(
            other_board(pictures, board, mirrored=None, found=False)
            or f"no {board.cols} x {board.rows} {board.name} found in any of {len(pictures)} pictures"
        )
    return all_boards


def more_mirrors(boards: Sequence[Sequence[DetectedBoard]], names: Sequence[str], mirrors: int) -> str:
    """Return a clause for an error if a picture shows more boards than mirrors and double reflections can produce."""
    count, number = max((len(in_picture), -number) for number, in_picture in enumerate(boards))
    if count <= 1 + mirrors**2:
        return ""
    return f"; {names[-number]} shows {count} boards, expected more than --direct-view {mirrors}"


def _with_markers(picture: Grey, board: Charuco | AprilGrid, max_boards: int) -> list[DetectedBoard]:
    """Detect ChArUco boards and AprilGrids, whose markers reveal whether they are mirrored."""
    direct, image = (
        [
            detected
            for detected in find_with_markers(picture, board, mirrored=mirrored, max_boards=max_boards)
            if len(non_collinear(detected))
        ]
        for mirrored in (False, True)
    )
    numbered = [NumberedBoard([detected], []) for detected in direct]
    numbered += [NumberedBoard([], [detected]) for detected in image]
    return [DetectedBoard(stated, NumberedBoard([], [])) for stated in numbered]


def _checkerboards(picture: Grey, board: Checkerboard) -> list[DetectedBoard]:
    grids = find_checkerboards(picture, board)
    return [DetectedBoard(_numbered(grid, board), _numbered(_inverted(grid), board)) for grid in grids]


def _numbered(grid: DetectedGrid, board: Checkerboard) -> NumberedBoard:
    direct, image = (grid.numberings(board, mirrored=mirrored) for mirrored in (False, True))
    return NumberedBoard(direct, image)


def _inverted(grid: DetectedGrid) -> DetectedGrid:
    """Exchange black and white in a grid, as in the negative of its picture."""
    step = np.array([1, 0])
    return replace(grid, grid_xy=grid.grid_xy + step, limits=grid.limits + step)


def negative(picture: Grey) -> Grey:
    """Exchange black and white in a picture."""
    return np.asarray(255 - picture, dtype=np.uint8)


def first_estimate_of(
    boards: Sequence[Sequence[DetectedBoard]], board: CalibrationBoard, *, mirrors: int, width_px: int, height_px: int
) -> tuple[Start, bool]:
    """Return the first estimate, and whether the print has black and white exchanged, as the mirrors' geometry shows.

    If a board's numbers of columns and rows are both even, exchanged colours look like its mirror image. Raises
    InputError if the boards do not determine the camera, or show too few mirrors.
    """
    starts, refusals = [], []
    for inverted in (False, True):
        numbered = [
            [
                found
                for found in (detected.inverted if inverted else detected.stated for detected in in_picture)
                if 0 < len(found.direct) + len(found.image) <= MAX_NUMBERINGS
            ]
            for in_picture in boards
        ]
        if not any(numbered):
            continue
        try:
            start = first_direct_estimate(
                numbered, board.corners_in_board_mm, mirrors=mirrors, width_px=width_px, height_px=height_px
            )
            starts.append((start, inverted))
        except InputError as error:
            refusals.append(error)
    if not starts:
        raise refusals[0] if refusals else InputError("the parts of boards in the pictures cannot be numbered")
    # The stated colours are assumed unless they fit the corners much worse.
    return min(starts, key=lambda pair: pair[0].error_px * (2.0 if pair[1] else 1.0))


def fits_flipped(
    boards: Sequence[Sequence[DetectedBoard]], board: CalibrationBoard, *, mirrors: int, width_px: int, height_px: int
) -> bool:
    """Return whether boards that give no first estimate give one after exchanging left and right."""
    flipped = [[detected.flipped(width_px) for detected in in_picture] for in_picture in boards]
    try:
        start, _ = first_estimate_of(flipped, board, mirrors=mirrors, width_px=width_px, height_px=height_px)
    except InputError:
        return False
    return start.error_px < MAX_FLIPPED * float(np.hypot(width_px, height_px))


def distance_note(estimate: Estimate, board: CalibrationBoard) -> tuple[str, ...]:
    """Note a board so near to or far from the camera that its size seems to be in a unit other than mm."""
    centre = np.append(board.corners_in_board_mm.mean(axis=0), 1.0)
    distance_mm = float(np.median((estimate.rig_from_board @ centre)[:, 2]))
    if MIN_DISTANCE_MM < distance_mm < MAX_DISTANCE_MM:
        return ()
    return (
        f"the board of {board.layout_text} is {distance_mm:.3g} mm from the camera: is its size in mm? Without a "
        "layout, pictures do not reveal it",
    )


def confirmed_corners(pictures: Sequence[Grey], start: Start, board: CalibrationBoard) -> tuple[Observations, bool]:
    """Detect all corners of a checkerboard again, starting near their predictions, in all views.

    This completes partly detected boards; boards with markers are already complete. A camera that sharpens its pictures
    gives edges halos, which the print lacks. Then the corners in softened pictures lie on smoother surfaces.

    Returns the corners, and whether they are those of the softened pictures.
    """
    if not isinstance(board, Checkerboard):
        return start.observations, False
    plain, soft = (
        _confirmed(copies, start, board) for copies in (pictures, [softened(picture) for picture in pictures])
    )
    is_sharpened = len(soft) >= MIN_COMPLETE * len(plain) and _roughness(soft, plain, board) < MAX_SMOOTHER
    return (soft, True) if is_sharpened else (plain, False)


def _confirmed(pictures: Sequence[Grey], start: Start, board: Checkerboard) -> Observations:
    estimate, print_xy = start.estimate, corner_print_xy(board)
    flat = Board.rigid(board.corners_in_board_mm)
    ids = np.arange(len(flat.corners_in_board_mm))
    parts = []
    for frame, picture in enumerate(pictures):
        grey = np.asarray(picture, dtype=np.float32)
        single_frame = estimate.of_frames(np.array([frame]))
        for view in range(DIRECT, len(estimate.virtual_centres_in_rig_mm)):
            predicted = residuals(single_frame, Observations.of_view(0, view, ids, np.zeros((len(ids), 2))), flat)
            if not np.isfinite(predicted).all():
                continue
            near = confirm(picture, predicted, board)
            if not len(near):
                continue
            corners = grow_board(grey, print_xy[near.ids], near.pixels, board, mirrored=view != DIRECT)
            if len(non_collinear(corners)):
                parts.append(Observations.of_view(frame, view, corners.ids, corners.pixels, corners.sigma_px))
    return Observations.join(parts)


def _roughness(observations: Observations, others: Observations, board: Checkerboard) -> float:
    """Rms distance of the corners from the smooth surface of their view, relative to others of the same views.

    The geometric mean over the views.
    """
    print_xy = corner_print_xy(board)
    ratios = []
    for frame, view in np.unique(np.stack([observations.frame, observations.view]), axis=1).T:
        rms = []
        for rows in (observations, others):
            in_view = (rows.frame == frame) & (rows.view == view)
            warp = BoardWarp.fit(print_xy[rows.corner[in_view]], rows.pixels[in_view])
            if warp is not None:
                rms.append(np.sqrt(np.mean((warp.map(print_xy[rows.corner[in_view]]) - rows.pixels[in_view]) ** 2)))
        if len(rms) == 2:
            ratios.append(rms[0] / max(rms[1], 1e-9))
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0
