"""Causes of a misfit, ranked by score tests.

A cause adds parameters to a fitted model: a lens term, a bent mirror, a picture taken in motion. Rao's score test
predicts from the derivatives at the fit how far they would lower the residuals, so no cause needs a fit of its own.
Poses, and all that the model already has, are projected out first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.corner_noise import with_noise_of_views
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    PLATE_INDEX,
    Fitted,
    as_second_surface,
    further_cameras,
    with_addition,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import (
    Board,
    Estimate,
    global_names,
    residuals,
    residuals_with_jacobians,
)

CauseKind = Literal[
    "picture", "mirror moved", "mirror bent", "lens", "spline", "pupil", "shutter", "plate", "bend", "warp", "size", "focus"
]
MAX_CORNERS = 8000
"""Corners of the test; of more, a regular part is taken."""
MIN_CORNERS = 8
"""Corners of a view for a field of errors of its own."""
TRIAL_PLATE_MM = 0.01
RANK = 1e-10
"""Smallest eigenvalue that counts, relative to the largest, of the normalised columns of a cause."""
LENSES = {"rational": "lens", "prism": "lens", "spline": "spline", "walk": "pupil"}


@dataclass(frozen=True)
class Cause:
    """A cause of a misfit.

    Attributes
    ----------
    kind
        What it is.
    name
        The picture or mirror, or the addition to the model; empty for others.
    share
        Fraction of the misfit that it explains: of the squared residuals beyond the noise of corners.
    gain
        Decrease of the Bayesian information criterion, predicted.
    bias_sigmas
        Shift of the mirrors without it, in stated standard deviations: rms of all parameters, along their correlations.
    """

    kind: CauseKind
    name: str
    share: float
    gain: float
    bias_sigmas: float


@dataclass(frozen=True)
class _Candidate:
    """Derivatives (rows, k) of standardised residuals by the parameters of a cause, and its number of alternatives."""

    kind: CauseKind
    name: str
    columns: FloatArray
    alternatives: int = 1


def ranked_causes(fitted: Fitted, observations: Observations, names: Sequence[str], mirrors: Sequence[str]) -> list[Cause]:
    """Rank all causes of which a fit shows a trace, the most probable first.

    Parameters
    ----------
    fitted
        The fitted model.
    observations
        The corners that it was fitted to.
    names
        Names of the frames.
    mirrors
        Names of the mirrors.
    """
    used = _inliers_and_rejected_views(fitted, observations)
    rows = with_noise_of_views(observations.where(used), fitted.solution.residuals[used])
    rows = rows.where(np.arange(len(rows)) % -(-len(rows) // MAX_CORNERS) == 0)
    test = _ScoreTest.of(fitted, rows)
    causes = [test.cause(candidate) for candidate in _candidates(fitted, rows, test, names, mirrors)]
    causes.append(test.shutter(rows.pixels[:, 1] / fitted.solution.estimate.camera.height_px - 0.5))
    return sorted((cause for cause in causes if cause.gain > 0.0), key=lambda cause: -cause.gain)


def _inliers_and_rejected_views(fitted: Fitted, observations: Observations) -> BoolArray:
    """Mask (n,) of the inliers, and of all corners of views that lost half of theirs: these have a common cause."""
    inliers = fitted.solution.inliers
    _, group, corners = np.unique(
        np.stack([observations.frame, observations.view]), axis=1, return_inverse=True, return_counts=True
    )
    rejected = np.bincount(group, weights=~inliers) > corners / 2.0
    return np.asarray(inliers | rejected[group])


@dataclass(frozen=True)
class _ScoreTest:
    """The residuals at a fit, and the space of all changes that its model allows.

    Attributes
    ----------
    r
        Standardised residuals (n,), x and y of each corner, outside that space.
    frames
        The rows of each frame.
    own
        Derivatives of these rows by the frame's own parameters, as orthonormal columns.
    by_frame
        Derivatives (n, 6) by the poses.
    shared
        Derivatives (n, g) by the globals without those of frames, as orthonormal columns.
    factor
        (g, g): derivatives by the globals are `shared` times it.
    information
        Inverse covariance of the mirrors' parameters, and `mirrors`, their places among the globals.
    raw
        Standardised residuals (n,).
    """

    r: FloatArray
    raw: FloatArray
    frames: list[slice]
    own: list[FloatArray]
    by_frame: FloatArray
    globals_: FloatArray
    shared: FloatArray
    factor: FloatArray
    mirrors: FloatArray
    information: FloatArray

    @classmethod
    def of(cls, fitted: Fitted, rows: Observations) -> _ScoreTest:
        solution, model = fitted.solution, fitted.model
        r, by_global, by_frame = _standardised(solution.estimate, rows, model.board)
        names = global_names(
            solution.estimate.camera.intrinsic_names,
            len(solution.estimate.virtual_centres_in_rig_mm),
            len(model.board.modes),
        )
        by_global = by_global[:, [names.index(name) for name in solution.parameters]]
        by_frame = by_frame[:, model.frame_terms.free]
        starts = np.flatnonzero(np.diff(rows.frame, prepend=-1))
        frames = [
            slice(2 * first, 2 * last) for first, last in zip(starts, [*starts[1:], len(rows)], strict=True)
        ]
        own = [np.linalg.qr(by_frame[part])[0] for part in frames]
        outside = _without(own, frames, by_global)
        shared, factor = np.linalg.qr(outside)
        rest = _without(own, frames, r[:, None])[:, 0]
        rest = rest - shared @ (shared.T @ rest)
        mirrors = np.array([i for i, name in enumerate(solution.parameters) if name.startswith("mirror ")], dtype=int)
        covariance = solution.covariance[np.ix_(mirrors, mirrors)]
        return cls(rest, r, frames, own, by_frame, by_global, shared, factor, mirrors, np.linalg.pinv(covariance))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residuals."""
        return float(len(self.r) - self.shared.shape[1] - sum(each.shape[1] for each in self.own))

    def cause(self, candidate: _Candidate) -> Cause:
        """Predict what a candidate explains."""
        columns = _without(self.own, self.frames, candidate.columns)
        scale = np.linalg.norm(columns, axis=0)
        columns = columns[:, scale > 1e-12] / scale[scale > 1e-12]
        inside = self.shared.T @ columns
        values, vectors = np.linalg.eigh(columns.T @ columns - inside.T @ inside)
        kept = values > max(RANK * values.max(initial=0.0), 1e-9)
        white = vectors[:, kept] / np.sqrt(values[kept])
        score = white.T @ (columns.T @ self.r)
        shift = np.linalg.solve(self.factor, inside @ (white @ score)) if self.factor.size else np.zeros(0)
        return self._cause(candidate, float(score @ score), int(kept.sum()), shift)

    def _cause(self, candidate: _Candidate, explained: float, parameters: int, shift: FloatArray) -> Cause:
        squares = float(self.r @ self.r)
        explained = min(explained, (1.0 - 1e-9) * squares)
        gain = self.freedom * np.log(squares / (squares - explained)) - parameters * np.log(self.freedom)
        of_mirrors = shift[self.mirrors]
        bias = float(of_mirrors @ self.information @ of_mirrors) / max(len(of_mirrors), 1)
        return Cause(
            candidate.kind,
            candidate.name,
            explained / max(squares - self.freedom, explained, 1e-12),
            float(gain - 2.0 * np.log(candidate.alternatives)),
            float(np.sqrt(max(bias, 0.0))),
        )

    def shutter(self, time: FloatArray) -> Cause:
        """Predict what a motion of the board in every frame explains, at times (c,) of corners in it."""
        moving = self.by_frame[:, :6] * np.repeat(time, 2)[:, None]
        own = [
            np.linalg.qr(np.concatenate([self.by_frame[part], moving[part]], axis=1))[0] for part in self.frames
        ]
        outside = _without(own, self.frames, self.globals_)
        rest = _without(own, self.frames, self.raw[:, None])[:, 0]
        step = np.linalg.lstsq(outside, rest, rcond=1e-12)[0]
        rest = rest - outside @ step
        explained = float(self.r @ self.r - rest @ rest)
        parameters = sum(each.shape[1] for each in own) - sum(each.shape[1] for each in self.own)
        return self._cause(_Candidate("shutter", "", moving), explained, parameters, step)


def _standardised(
    estimate: Estimate, rows: Observations, board: Board
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standardised residuals (2 n,) and their derivatives (2 n, g) and (2 n, 12), x and y of each corner."""
    weights = np.repeat(1.0 / rows.sigma_px, 2)
    r, by_global, by_frame = residuals_with_jacobians(estimate, rows, board)
    return (
        r.reshape(-1) * weights,
        by_global.reshape(len(weights), -1) * weights[:, None],
        by_frame.reshape(len(weights), -1) * weights[:, None],
    )


def _without(own: list[FloatArray], frames: list[slice], columns: FloatArray) -> FloatArray:
    """Project columns (n, k) out of the space of each frame's own parameters."""
    outside = columns.copy()
    for basis, part in zip(own, frames, strict=True):
        outside[part] -= basis @ (basis.T @ columns[part])
    return outside


def _candidates(
    fitted: Fitted, rows: Observations, test: _ScoreTest, names: Sequence[str], mirrors: Sequence[str]
) -> Iterator[_Candidate]:
    """All causes but the shutter."""
    solution, model = fitted.solution, fitted.model
    estimate, additions = solution.estimate, fitted.name.split("+")
    board, modes = _deformable(model.board)
    shaped = replace(estimate, shape=np.concatenate([estimate.shape, np.zeros(len(board.modes) - len(estimate.shape))]))
    _, by_global, _ = _standardised(shaped, rows, board)
    intrinsics = estimate.camera.intrinsic_names
    count, lens = len(estimate.virtual_centres_in_rig_mm), len(intrinsics)
    curvature, sheet = lens + 3 * count, lens + 6 * count
    fixed = [place for place, name in enumerate(intrinsics) if name not in model.intrinsics]
    if fixed:
        yield _Candidate("lens", "+".join(intrinsics[place] for place in fixed), by_global[:, fixed])
    for addition in further_cameras(estimate.camera, additions):
        if addition in LENSES:
            extended = replace(estimate, camera=with_addition(estimate.camera, addition))
            columns = _standardised(extended, rows, model.board)[1][:, : extended.camera.intrinsics.size]
            yield _Candidate(LENSES[addition], addition, columns)
    direct = np.repeat(rows.view == DIRECT, 2)
    if direct.any() and not direct.all() and not rows.direct_and_mirrored:
        yield _Candidate("focus", "", np.where(direct[:, None], by_global[:, :4], 0.0))
    if not model.curvature:
        yield _Candidate("bend", "", by_global[:, curvature:sheet])
        for mirror in range(count):
            columns = by_global[:, curvature + 3 * mirror : curvature + 3 * mirror + 3]
            yield _Candidate("mirror bent", mirrors[mirror], columns, count)
    if not model.thickness:
        yield _Candidate("plate", "", _by_plate(estimate, rows, by_global[:, sheet], model.board)[:, None])
    for kind, places in modes.items():
        yield _Candidate(kind, "", by_global[:, [sheet + 1 + place for place in places]])
    yield from _moved_mirrors(rows, by_global, lens, mirrors)
    for frame, part in zip(np.unique(rows.frame), test.frames, strict=True):
        yield _Candidate("picture", names[frame], _fields_of(rows, part), len(test.frames))


def _deformable(board: Board) -> tuple[Board, dict[CauseKind, list[int]]]:
    """The board with modes for a warp and for a print that is scaled differently along x and y, unless it has modes."""
    if len(board.modes):
        return board, {}
    size = np.zeros((2, *board.corners_in_board_mm.shape))
    x, y = board.corners_from_centre.T
    size[0, :, 0], size[1, :, 0] = x, y
    modes = np.concatenate([Board.warped(board.corners_in_board_mm).modes, size])
    return Board(board.corners_in_board_mm, modes), {"warp": [0, 1], "size": [2, 3]}


def _by_plate(estimate: Estimate, rows: Observations, by_sheet: FloatArray, board: Board) -> FloatArray:
    """Derivatives (2 n,) by the thickness of all plates; for first-surface mirrors, by plates in front of them."""
    if (estimate.thickness_mm > 0.0).any():
        return by_sheet
    behind = as_second_surface(estimate, TRIAL_PLATE_MM, PLATE_INDEX)
    change = residuals(behind, rows, board) - residuals(estimate, rows, board)
    return np.asarray(rows.standardised(change).reshape(-1) / TRIAL_PLATE_MM)


def _moved_mirrors(
    rows: Observations, by_global: FloatArray, lens: int, mirrors: Sequence[str]
) -> Iterator[_Candidate]:
    """Each mirror elsewhere from some frame on."""
    for mirror, name in enumerate(mirrors):
        frames = np.unique(rows.frame[rows.view == mirror])
        columns = by_global[:, lens + 3 * mirror : lens + 3 * mirror + 3]
        for first in frames[1:]:
            later = np.repeat(rows.frame >= first, 2)[:, None]
            yield _Candidate("mirror moved", name, np.where(later, columns, 0.0), len(mirrors) * (len(frames) - 1))


def _fields_of(rows: Observations, part: slice) -> FloatArray:
    """A frame's errors: a shift that is linear in x and y, in each view."""
    frame = slice(part.start // 2, part.stop // 2)
    view, pixels, sigma = rows.view[frame], rows.pixels[frame], rows.sigma_px[frame]
    blocks = []
    for number in np.unique(view):
        of_view = view == number
        if of_view.sum() < MIN_CORNERS:
            continue
        centred = pixels - pixels[of_view].mean(axis=0)
        for field in (np.ones(len(view)), *(centred / max(np.abs(centred[of_view]).max(), 1.0)).T):
            for axis in range(2):
                block = np.zeros((len(view), 2))
                block[:, axis] = np.where(of_view, field / sigma, 0.0)
                blocks.append(block.reshape(-1))
    columns = np.zeros((2 * len(rows), len(blocks)))
    if blocks:
        columns[part] = np.stack(blocks, axis=1)
    return columns
