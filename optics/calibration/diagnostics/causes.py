"""Causes of a misfit, ranked by score tests.

A cause adds parameters to a fitted model: a lens term, a bent mirror, a picture taken in motion. Rao's score test
predicts from the derivatives at the fit how far they would lower the residuals, so no cause needs a fit of its own.
Poses, and all parameters of the model, are projected out first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

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
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import (
    Board,
    Estimate,
    global_names,
    residuals,
    residuals_with_jacobians,
)

CauseKind = Literal[
    "picture",
    "mirror moved",
    "mirror bent",
    "bend",
    "lens",
    "spline",
    "pupil",
    "colour",
    "shutter",
    "plate",
    "warp",
    "size",
    "bow",
    "turn",
    "board",
    "focus",
]
KIND_OF_ADDITION: dict[str, CauseKind] = {
    "rational": "lens",
    "prism": "lens",
    "fisheye": "lens",
    "spline": "spline",
    "walk": "pupil",
    "colour": "colour",
    "sheet": "plate",
    "bend": "bend",
    "warp": "warp",
    "bow": "bow",
    "motion": "shutter",
    "turn": "turn",
    "board": "board",
}
"""Kind of cause that each addition to a model removes."""
MAX_CORNERS = 8000
"""Corners of the test; of more, every second, third, ... is taken."""
MIN_CORNERS = 8
"""Corners of a view for a field of errors of its own."""
TRIAL_PLATE_MM = 0.01
NO_COLUMNS: FloatArray = np.zeros((0, 0))
MIN_NORM = 1e-12
"""Smallest norm of a column that counts."""
MIN_EIGENVALUE = 1e-9
"""Smallest eigenvalue that counts, of the normal matrix of normalised columns of a cause."""


@dataclass(frozen=True)
class Cause:
    """A cause of a misfit.

    Attributes
    ----------
    kind
        The kind of cause.
    mirror
        Index of the mirror; None if the cause concerns no single mirror.
    frame
        Number of the frame, or of the first frame after a motion; None if the cause concerns all frames.
    addition
        Addition to the model that removes the cause; empty if there is none.
    fraction
        Fraction of the misfit that it explains: of the squared residuals beyond the noise of corners.
    gain
        Predicted decrease of the Bayesian information criterion.
    bias_sigmas
        Shift of the mirrors (of a bare camera, its intrinsics) due to it, in their stated standard deviations: rms of
        all parameters, decorrelated.
    """

    kind: CauseKind
    mirror: int | None
    frame: int | None
    addition: str
    fraction: float
    gain: float
    bias_sigmas: float


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
    test = _ScoreTest.of(fitted, rows)
    causes = [test.cause(candidate) for candidate in _candidates(fitted, rows, test)]
    causes += [*_causes_of_moved_mirrors(fitted, rows, test), *_causes_of_frames(fitted, rows, test)]
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


@dataclass(frozen=True)
class _Candidate:
    """Derivatives (2n, k) of standardised residuals with respect to the parameters of a cause.

    `alternatives` is the number of such candidates, of which the best is chosen.
    """

    kind: CauseKind
    columns: FloatArray
    mirror: int | None = None
    frame: int | None = None
    addition: str = ""
    alternatives: int = 1


@dataclass(frozen=True)
class _ScoreTest:
    """The residuals at a fit, and the space of all changes that its model allows.

    Attributes
    ----------
    residuals
        Standardised residuals (2n,), x and y of each corner.
    rest
        Their part (2n,) outside that space.
    frames
        Rows of each frame.
    d_frame
        Derivatives (2n, 24) with respect to the parameters of their frame.
    own
        Orthonormal basis (m, d) of the free ones, for each frame.
    d_global
        Derivatives (2n, g) with respect to the free globals.
    shared
        Orthonormal basis (2n, g) of these outside the space of the frames.
    factor
        (g, g): derivatives outside that space are `shared` times it.
    floor
        Squared residuals that are negligible: without noise, rounding errors would become significant.
    intrinsics
        Number of free intrinsics, which are the first globals.
    mirrors
        Indices (m,) of the mirrors' parameters among the globals (of a bare camera, of its intrinsics), and their
        `information` (m, m).
    """

    residuals: FloatArray
    rest: FloatArray
    frames: list[slice]
    d_frame: FloatArray
    own: list[FloatArray]
    d_global: FloatArray
    shared: FloatArray
    factor: FloatArray
    floor: float
    intrinsics: int
    mirrors: IntArray
    information: FloatArray

    @classmethod
    def of(cls, fitted: Fitted, rows: Observations) -> _ScoreTest:
        solution, model = fitted.solution, fitted.model
        r, d_global, d_frame = _standardised(solution.estimate, rows, model.board)
        names = global_names(
            solution.estimate.camera.intrinsic_names,
            len(solution.estimate.virtual_centres_in_rig_mm),
            len(model.board.modes),
        )
        d_global = d_global[:, [names.index(name) for name in solution.parameters]]
        starts = np.flatnonzero(np.diff(rows.frame, prepend=-1))
        frames = [slice(2 * first, 2 * last) for first, last in zip(starts, [*starts[1:], len(rows)], strict=True)]
        own = [np.linalg.qr(d_frame[part][:, model.frame_terms.free])[0] for part in frames]
        shared, factor = np.linalg.qr(_outside(own, frames, d_global))
        rest = _outside(own, frames, r[:, None])[:, 0]
        rest = rest - shared @ (shared.T @ rest)
        mirrors = np.flatnonzero([name.startswith("mirror ") for name in solution.parameters])
        if not len(solution.estimate.virtual_centres_in_rig_mm):
            mirrors = np.arange(len(model.intrinsics))
        information = np.asarray(np.linalg.pinv(solution.covariance[np.ix_(mirrors, mirrors)]), dtype=np.float64)
        floor = 2.0 * float(np.sum((NEGLIGIBLE_PX / rows.sigma_px) ** 2))
        intrinsics = len(model.intrinsics)
        return cls(r, rest, frames, d_frame, own, d_global, shared, factor, floor, intrinsics, mirrors, information)

    @cached_property
    def squares(self) -> float:
        """Squared residuals outside that space, with the negligible ones."""
        return float(self.rest @ self.rest) + self.floor

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom of the residuals."""
        return float(len(self.rest) - self.shared.shape[1] - sum(basis.shape[1] for basis in self.own))

    def cause(self, candidate: _Candidate) -> Cause:
        """Predict the effect of a candidate whose parameters all frames share."""
        columns = _outside(self.own, self.frames, candidate.columns)
        return self._from_sums(candidate, columns.T @ columns, self.shared.T @ columns, columns.T @ self.rest)

    def causes_of_changes(
        self, columns: FloatArray, firsts: Sequence[int], candidates: Sequence[_Candidate]
    ) -> Iterator[Cause]:
        """Predict the effect of changes of shared parameters, with derivatives (2n, k), each from a first frame on."""
        columns = _outside(self.own, self.frames, columns)
        others = (columns, self.shared, self.rest)
        sums = (np.array([other[part].T @ columns[part] for part in self.frames]) for other in others)
        gram, inside, score = (np.cumsum(parts[::-1], axis=0)[::-1] for parts in sums)
        for first, candidate in zip(firsts, candidates, strict=True):
            yield self._from_sums(candidate, gram[first], inside[first], score[first])

    def _from_sums(self, candidate: _Candidate, gram: FloatArray, inside: FloatArray, score: FloatArray) -> Cause:
        """Predict the effect of columns (2n, k) from their products with themselves, `shared` and `rest`."""
        norms = np.sqrt(np.diag(gram))
        used = norms > MIN_NORM
        norms, inside = norms[used], inside[:, used] / norms[used]
        values, vectors = np.linalg.eigh(gram[np.ix_(used, used)] / np.outer(norms, norms) - inside.T @ inside)
        determined = values > MIN_EIGENVALUE
        white = vectors[:, determined] / np.sqrt(values[determined])
        explained = white.T @ (score[used] / norms)
        shift: FloatArray = np.zeros(0)
        if self.factor.size:
            shift = np.asarray(np.linalg.solve(self.factor, inside @ (white @ explained)), dtype=np.float64)
        return self._cause(candidate, float(explained @ explained), int(determined.sum()), shift)

    def cause_of_frames(self, candidate: _Candidate) -> Cause:
        """Predict the effect of a candidate with parameters of its own for each frame."""
        own = [
            np.linalg.qr(np.concatenate([basis, candidate.columns[part]], axis=1))[0]
            for basis, part in zip(self.own, self.frames, strict=True)
        ]
        parameters = sum(basis.shape[1] for basis in own) - sum(basis.shape[1] for basis in self.own)
        d_global = _outside(own, self.frames, self.d_global)
        rest = _outside(own, self.frames, self.residuals[:, None])[:, 0]
        step = np.linalg.lstsq(d_global, rest, rcond=1e-12)[0]
        rest = rest - d_global @ step
        explained = float(self.rest @ self.rest - rest @ rest)
        return self._cause(candidate, explained, parameters, np.asarray(step, dtype=np.float64))

    def cause_of_lens(self, addition: str, lens: Estimate, rows: Observations, board: Board) -> Cause:
        """Predict the effect of a different lens, with an estimate that has the nearest one."""
        r, d_global, _ = _standardised(lens, rows, board)
        count = lens.camera.intrinsics.size
        columns = np.concatenate([d_global[:, :count], self.d_global[:, self.intrinsics :]], axis=1)
        columns = _outside(self.own, self.frames, columns)
        rest = _outside(self.own, self.frames, r[:, None])[:, 0]
        rest = rest - columns @ np.linalg.lstsq(columns, rest, rcond=1e-12)[0]
        candidate = _Candidate(KIND_OF_ADDITION[addition], columns, addition=addition)
        explained = float(self.rest @ self.rest - rest @ rest)
        return self._cause(candidate, explained, max(count - self.intrinsics, 1), np.zeros(len(self.factor)))

    def _cause(self, candidate: _Candidate, explained: float, parameters: int, shift: FloatArray) -> Cause:
        squares, freedom = float(self.squares), float(self.freedom)
        gain = freedom * np.log(squares / (squares - explained)) - parameters * np.log(freedom)
        shift = shift[self.mirrors]
        return Cause(
            candidate.kind,
            candidate.mirror,
            candidate.frame,
            candidate.addition,
            explained / max(squares - freedom, explained, 1e-12),
            float(gain - 2.0 * np.log(candidate.alternatives)),
            float(np.sqrt(max(float(shift @ self.information @ shift), 0.0) / max(len(shift), 1))),
        )


def _standardised(estimate: Estimate, rows: Observations, board: Board) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standardised residuals (2n,) and their derivatives (2n, g) and (2n, 24), x and y of each corner."""
    weights = np.repeat(1.0 / rows.sigma_px, 2)
    r, d_global, d_frame = residuals_with_jacobians(estimate, rows, board)
    return (
        r.reshape(-1) * weights,
        d_global.reshape(len(weights), -1) * weights[:, None],
        d_frame.reshape(len(weights), -1) * weights[:, None],
    )


def _outside(own: list[FloatArray], frames: list[slice], columns: FloatArray) -> FloatArray:
    """Project columns (2n, k) out of the space of each frame's own parameters."""
    outside = columns.copy()
    for basis, part in zip(own, frames, strict=True):
        outside[part] -= basis @ (basis.T @ columns[part])
    return outside


def _candidates(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[_Candidate]:
    """Yield all causes whose parameters the frames share, and those of single frames."""
    solution, model = fitted.solution, fitted.model
    estimate, additions = solution.estimate, fitted.name.split("+")
    board, modes = _deformable(model.board, free=rows.direct_and_mirrored or not (rows.view != DIRECT).any())
    shape = np.concatenate([estimate.shape, np.zeros(len(board.modes) - len(estimate.shape))])
    _, d_global, _ = _standardised(replace(estimate, shape=shape), rows, board)
    intrinsics = estimate.camera.intrinsic_names
    count, lens = len(estimate.virtual_centres_in_rig_mm), len(intrinsics)
    curvature, sheet = lens + 3 * count, lens + 6 * count
    for addition in further_cameras(estimate.camera, additions):
        if addition != "fisheye":
            extended = replace(estimate, camera=with_addition(estimate.camera, addition))
            columns = _standardised(extended, rows, model.board)[1][:, : extended.camera.intrinsics.size]
            yield _Candidate(KIND_OF_ADDITION[addition], columns, addition=addition)
    bare = np.repeat(~np.isin(rows.frame, rows.frame[rows.view != DIRECT]), 2)
    if bare.any() and not bare.all():
        yield _Candidate("focus", np.where(bare[:, None], d_global[:, :4], 0.0))
    if count and not model.curvature:
        yield _Candidate("bend", d_global[:, curvature:sheet], addition="bend")
        for mirror in range(count):
            start = curvature + 3 * mirror
            columns = d_global[:, start : start + 3]
            yield _Candidate("mirror bent", columns, mirror=mirror, addition="bend", alternatives=count)
    if count and not model.thickness:
        yield _Candidate("plate", _d_plate(estimate, rows, d_global[:, sheet], model.board)[:, None], addition="sheet")
    for kind, part in modes.items():
        addition = kind if kind in KIND_OF_ADDITION else ""
        yield _Candidate(kind, d_global[:, sheet + 1 + part.start : sheet + 1 + part.stop], addition=addition)
    for frame, part in zip(np.unique(rows.frame).tolist(), test.frames, strict=True):
        yield _Candidate("picture", _affine_fields(rows, part), frame=frame, alternatives=len(test.frames))


def _causes_of_moved_mirrors(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[Cause]:
    """Yield the causes that a mirror moved before a frame was taken."""
    numbers, mirrors = np.unique(rows.frame), len(fitted.solution.estimate.virtual_centres_in_rig_mm)
    for mirror in range(mirrors):
        later = np.unique(rows.frame[rows.view == mirror])[1:].tolist()
        start = fitted.solution.parameters.index(f"mirror {mirror} x_mm")
        changes = test.causes_of_changes(
            test.d_global[:, start : start + 3],
            [int(np.searchsorted(numbers, frame)) for frame in later],
            [
                _Candidate("mirror moved", NO_COLUMNS, mirror, frame, alternatives=mirrors * len(later))
                for frame in later
            ],
        )
        yield from changes


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
        for field in (np.ones(len(view)), *(centred / max(np.abs(centred[of_view]).max(), 1.0)).T):
            standardised = np.where(of_view, field / sigma_px, 0.0)
            columns += [np.outer(standardised, axis).reshape(-1) for axis in np.eye(2)]
    fields = np.zeros((2 * len(rows), len(columns)))
    if columns:
        fields[part] = np.stack(columns, axis=1)
    return fields


def _causes_of_frames(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[Cause]:
    """Yield the causes with parameters of their own for each frame."""
    terms = fitted.model.frame_terms
    if not terms.has_motion:
        yield test.cause_of_frames(_Candidate("shutter", test.d_frame[:, 12:18], addition="motion"))
    if terms.bow_per_mm is None:
        yield test.cause_of_frames(_Candidate("bow", test.d_frame[:, 9:12], addition="bow"))
    if terms.rotation_per_rad is None and rows.direct_and_mirrored:
        yield test.cause_of_frames(_Candidate("turn", test.d_frame[:, 6:9], addition="turn"))
