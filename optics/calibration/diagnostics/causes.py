"""Causes of a misfit, ranked by score tests.

A cause adds parameters to a fitted model: a lens term, a bent mirror, a picture taken in motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.corner_noise import with_view_noise
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    PLATE_INDEX,
    Fitted,
    as_second_surface,
    further_cameras,
    with_addition,
)
from mirrorcam.optics.calibration.diagnostics.score_test import (
    KIND_OF_ADDITION,
    NO_COLUMNS,
    Candidate,
    Cause,
    CauseKind,
    ScoreTest,
    standardised,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals

MAX_CORNERS = 8000
"""Corners of the test; of more, every second, third, ... is taken."""
MIN_CORNERS = 8
"""Corners of a view for a field of errors of its own."""
TRIAL_PLATE_MM = 0.01
PINHOLE = 4
"""Number of the pinhole's intrinsics fx, fy, cx and cy, which come first."""


def ranked_causes(fitted: Fitted, observations: Observations) -> list[Cause]:
    """Rank all causes of which a fit shows a trace, the most probable first.

    Parameters
    ----------
    fitted
        The fitted model.
    observations
        The corners that it was fitted to.
    """
    used = _inliers_and_rejected_views(fitted, observations)
    rows = with_view_noise(observations.where(used), fitted.solution.residuals[used])
    rows = rows.where(np.arange(len(rows)) % -(-len(rows) // MAX_CORNERS) == 0)
    test = ScoreTest.of(fitted, rows)
    causes = [*_shared_causes(fitted, rows, test), *_causes_of_pictures(rows, test)]
    causes += [*_causes_of_moved_mirrors(fitted, rows, test), *_causes_of_changed_focus(fitted, rows, test)]
    causes += [*_causes_of_changed_board(fitted, rows, test), *_causes_of_frames(fitted, rows, test)]
    estimate = fitted.solution.estimate
    if "fisheye" in further_cameras(estimate.camera, fitted.name.split("+")):
        fisheye = replace(estimate, camera=with_addition(estimate.camera, "fisheye"))
        causes.append(test.cause_of_lens("fisheye", fisheye, rows, fitted.model.board))
    return sorted((cause for cause in causes if cause.gain > 0.0), key=lambda cause: -cause.gain)


def _inliers_and_rejected_views(fitted: Fitted, observations: Observations) -> BoolArray:
    """Mask (n,) of the inliers, and of all corners of views that lost half of theirs: these have a common cause."""
    inliers = fitted.solution.inliers
    _, group, corners = np.unique(
        np.stack([observations.frame, observations.view]), axis=1, return_inverse=True, return_counts=True
    )
    rejected = np.bincount(group, weights=~inliers) > corners / 2.0
    return np.asarray(inliers | rejected[group])


def _shared_causes(fitted: Fitted, rows: Observations, test: ScoreTest) -> Iterator[Cause]:
    """Yield all causes whose parameters the frames share."""
    solution, model = fitted.solution, fitted.model
    estimate, additions = solution.estimate, fitted.name.split("+")
    board, modes = _deformable(model.board, free=_determines_corners(rows))
    shape = np.concatenate([estimate.shape, np.zeros(len(board.modes) - len(estimate.shape))])
    _, d_global, _ = standardised(replace(estimate, shape=shape), rows, board)
    intrinsics = estimate.camera.intrinsic_names
    count, lens = len(estimate.virtual_centres_in_rig_mm), len(intrinsics)
    curvature, sheet = lens + 3 * count, lens + 6 * count
    for addition in further_cameras(estimate.camera, additions):
        if addition != "fisheye":
            camera = with_addition(estimate.camera, addition)
            columns = standardised(replace(estimate, camera=camera), rows, model.board)[1][:, : camera.intrinsics.size]
            priors = 1.0 / camera.prior_sigmas
            yield test.cause(Candidate(KIND_OF_ADDITION[addition], columns, addition=addition, priors=priors))
    if count and not model.curvature:
        yield test.cause(Candidate("bend", d_global[:, curvature:sheet], addition="bend"))
        for mirror in range(count):
            start = curvature + 3 * mirror
            columns = d_global[:, start : start + 3]
            yield test.cause(Candidate("mirror bent", columns, mirror=mirror, addition="bend", alternatives=count))
    if count and not model.thickness:
        columns = _d_plate(estimate, rows, d_global[:, sheet], model.board)[:, None]
        yield test.cause(Candidate("plate", columns, addition="sheet"))
    for kind, part in modes.items():
        columns = d_global[:, sheet + 1 + part.start : sheet + 1 + part.stop]
        if kind in KIND_OF_ADDITION:
            yield test.cause(Candidate(kind, columns, addition=kind))
        else:
            every = np.ones(len(test.frames), dtype=bool)
            yield from test.evident_causes(columns, [every], [Candidate(kind, NO_COLUMNS)])


def _causes_of_pictures(rows: Observations, test: ScoreTest) -> Iterator[Cause]:
    """Yield the causes that a single frame contradicts the others."""
    pictures = zip(np.unique(rows.frame).tolist(), test.corners, strict=True)
    yield from test.causes_of_pictures(
        [
            Candidate("picture", _affine_fields(rows, part), frame=frame, alternatives=len(test.frames))
            for frame, part in pictures
        ]
    )


def _causes_of_moved_mirrors(fitted: Fitted, rows: Observations, test: ScoreTest) -> Iterator[Cause]:
    """Yield the causes that a mirror moved before a frame was taken."""
    numbers, mirrors = np.unique(rows.frame), len(fitted.solution.estimate.virtual_centres_in_rig_mm)
    for mirror in range(mirrors):
        later = np.unique(rows.frame[rows.view == mirror])[1:].tolist()
        start = fitted.solution.parameters.index(f"mirror {mirror} x_mm")
        changes = test.evident_causes(
            test.d_global[: 2 * len(rows), start : start + 3],
            [numbers >= frame for frame in later],
            [
                Candidate("mirror moved", NO_COLUMNS, mirror, frame, alternatives=mirrors * len(later))
                for frame in later
            ],
        )
        yield from changes


def _causes_of_changed_focus(fitted: Fitted, rows: Observations, test: ScoreTest) -> Iterator[Cause]:
    """Yield the causes that focus or zoom changed before a frame was taken.

    A change between the frames with and without mirrors is a candidate of its own.
    """
    numbers = np.unique(rows.frame)
    bare = np.isin(numbers, rows.frame[_is_bare(rows)])
    changes = [numbers >= first for first in numbers[1:] if not np.array_equal(numbers >= first, bare)]
    _, d_global, _ = standardised(fitted.solution.estimate, rows, fitted.model.board)
    candidates = [
        Candidate("focus", NO_COLUMNS, frame=int(numbers[later][0]), alternatives=len(changes)) for later in changes
    ]
    if bare.any() and not bare.all():
        changes, candidates = [*changes, bare], [*candidates, Candidate("focus", NO_COLUMNS)]
    yield from test.evident_causes(d_global[:, :PINHOLE], changes, candidates)


def _causes_of_changed_board(fitted: Fitted, rows: Observations, test: ScoreTest) -> Iterator[Cause]:
    """Yield the causes that the board changed its shape before a frame was taken."""
    estimate, drawn = fitted.solution.estimate, fitted.model.board
    corners_mm = drawn.corners_in_board_mm
    board = Board.free(corners_mm) if _determines_corners(rows) else Board.warped(corners_mm)
    if len(drawn.modes) >= len(board.modes):
        board, shape = drawn, estimate.shape
    else:
        board = Board(corners_mm, np.concatenate([drawn.modes, board.modes]))
        shape = np.concatenate([estimate.shape, np.zeros(len(board.modes) - len(estimate.shape))])
    _, d_global, _ = standardised(replace(estimate, shape=shape), rows, board)
    numbers = np.unique(rows.frame)
    firsts = numbers[1:].tolist()
    candidates = [Candidate("board changed", NO_COLUMNS, frame=first, alternatives=len(firsts)) for first in firsts]
    changes = [numbers >= first for first in firsts]
    yield from test.evident_causes(d_global[:, -len(board.modes) :], changes, candidates)


def _determines_corners(rows: Observations) -> bool:
    """Whether frames determine the corners of their board: they see it directly as well as in mirrors, or only so."""
    return rows.direct_and_mirrored or not (rows.view != DIRECT).any()


def _is_bare(rows: Observations) -> BoolArray:
    """Mask (n,) of the corners in frames without mirrors."""
    return np.asarray(~np.isin(rows.frame, rows.frame[rows.view != DIRECT]))


def _deformable(board: Board, *, free: bool) -> tuple[Board, dict[CauseKind, slice]]:
    """The board with further modes: a warp, a print that is sheared or stretched, and if `free`, free corners.

    A board with modes already gets only free corners, if it does not have them.
    """
    corners_mm = board.corners_in_board_mm
    modes: dict[CauseKind, FloatArray] = {}
    if not len(board.modes):
        size = np.zeros((2, *corners_mm.shape))
        size[0, :, 0], size[1, :, 0] = board.corners_from_centre.T
        modes = {"warp": Board.warped(corners_mm).modes, "size": size}
    corners = Board.free(corners_mm).modes if free else board.modes
    if len(corners) > len(board.modes):
        modes["board"] = corners
    ends = len(board.modes) + np.cumsum([len(part) for part in modes.values()], dtype=np.int64)
    parts = {kind: slice(end - len(part), end) for (kind, part), end in zip(modes.items(), ends, strict=True)}
    return Board(corners_mm, np.concatenate([board.modes, *modes.values()])), parts


def _d_plate(estimate: Estimate, rows: Observations, d_sheet: FloatArray, board: Board) -> FloatArray:
    """Derivatives (2n,) with respect to the thickness of all plates; of first-surface mirrors, of plates to come."""
    if (estimate.thickness_mm > 0.0).any():
        return d_sheet
    behind_plate = as_second_surface(estimate, TRIAL_PLATE_MM, PLATE_INDEX)
    change = residuals(behind_plate, rows, board) - residuals(estimate, rows, board)
    return np.asarray(rows.standardised(change).reshape(-1) / TRIAL_PLATE_MM)


def _affine_fields(rows: Observations, part: slice) -> FloatArray:
    """Columns (2n, 6v) for errors of a frame that are affine in x and y in each of its views (v)."""
    frame = slice(part.start // 2, part.stop // 2)
    view, pixels, sigma_px = rows.view[frame], rows.pixels[frame], rows.sigma_px[frame]
    columns = []
    for number in np.unique(view):
        of_view = view == number
        if of_view.sum() < MIN_CORNERS:
            continue
        centred = pixels - pixels[of_view].mean(axis=0)
        for values in (np.ones(len(view)), *(centred / max(np.abs(centred[of_view]).max(), 1.0)).T):
            standardised = np.where(of_view, values / sigma_px, 0.0)
            columns += [np.outer(standardised, axis).reshape(-1) for axis in np.eye(2)]
    fields = np.zeros((2 * len(rows), len(columns)))
    if columns:
        fields[part] = np.stack(columns, axis=1)
    return fields


def _causes_of_frames(fitted: Fitted, rows: Observations, test: ScoreTest) -> Iterator[Cause]:
    """Yield the causes with parameters of their own for each frame."""
    terms = fitted.model.frame_terms
    if not terms.has_motion:
        yield test.cause_of_frames(Candidate("shutter", test.d_frame[:, 12:18], addition="motion"))
    if terms.bow_per_mm is None:
        yield test.cause_of_frames(Candidate("bow", test.d_frame[:, 9:12], addition="bow"))
    if terms.rotation_per_rad is None and rows.direct_and_mirrored:
        yield test.cause_of_frames(Candidate("turn", test.d_frame[:, 6:9], addition="turn"))
