"""Causes of a misfit, ranked by score tests.

A cause adds parameters to a fitted model: a lens term, a bent mirror, a picture taken in motion. Rao's score test
predicts from the derivatives at the fit how far they would lower the residuals, so no cause needs a fit of its own.
Poses, and all parameters of the model, are projected out first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
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
    FRAME_PARAMETERS,
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
    "board changed",
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
PINHOLE = 4
"""Number of the pinhole's intrinsics fx, fy, cx and cy, which come first."""
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
        Number of the frame, or of the first frame after a change; None if the cause concerns all frames, or a focus
        that differs between frames with and without mirrors.
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


@dataclass(frozen=True)
class _Candidate:
    """Derivatives (2n, k) of standardised residuals with respect to the parameters of a cause.

    `alternatives` is the number of such candidates, of which the best is chosen. `priors` (k,) are those of the
    parameters, as in `Model.intrinsic_priors`; empty without.
    """

    kind: CauseKind
    columns: FloatArray
    mirror: int | None = None
    frame: int | None = None
    addition: str = ""
    alternatives: int = 1
    priors: FloatArray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class _ScoreTest:
    """The residuals at a fit, and the space of all changes that its model allows.

    The residuals (r,) belong to the corners, x and y of each, then to all priors.

    Attributes
    ----------
    residuals
        Standardised residuals (r,).
    rest
        Their part (r,) outside that space.
    corners
        Rows of the corners of each frame.
    frames
        Indices of all rows of each frame.
    d_frame
        Derivatives (r, 24) with respect to the parameters of their frame.
    own
        Orthonormal basis (m, d) of the free ones, for each frame.
    d_global
        Derivatives (r, g) with respect to the free globals.
    shared
        Orthonormal basis (r, g) of these outside the space of the frames.
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
    corners: list[slice]
    frames: list[IntArray]
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
        corners = [slice(2 * first, 2 * last) for first, last in zip(starts, [*starts[1:], len(rows)], strict=True)]
        (priors, d_global_priors, d_frame_priors), of_frames = _priors(fitted, rows.frame[starts])
        frames = [
            np.append(np.arange(part.start, part.stop), len(r) + of_frame)
            for part, of_frame in zip(corners, of_frames, strict=True)
        ]
        r = np.concatenate([r, priors])
        d_global = np.concatenate([d_global, d_global_priors])
        d_frame = np.concatenate([d_frame, d_frame_priors])
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
        return cls(
            r, rest, corners, frames, d_frame, own, d_global, shared, factor, floor, intrinsics, mirrors, information
        )

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
        columns = self._outside(candidate.columns)
        return self._from_sums(candidate, columns.T @ columns, self.shared.T @ columns, columns.T @ self.rest)

    def causes_of_changes(
        self, columns: FloatArray, firsts: Sequence[int], candidates: Sequence[_Candidate]
    ) -> Iterator[Cause]:
        """Predict the effect of changes of shared parameters, with derivatives (2n, k), each from a first frame on."""
        columns = self._outside(columns)
        others = (columns, self.shared, self.rest)
        sums = (np.array([other[part].T @ columns[part] for part in self.frames]) for other in others)
        gram, inside, score = (np.cumsum(parts[::-1], axis=0)[::-1] for parts in sums)
        for first, candidate in zip(firsts, candidates, strict=True):
            yield self._from_sums(candidate, gram[first], inside[first], score[first])

    def _from_sums(self, candidate: _Candidate, gram: FloatArray, inside: FloatArray, score: FloatArray) -> Cause:
        """Predict the effect of columns (2n, k) from their products with themselves, `shared` and `rest`."""
        priors = candidate.priors**2 if candidate.priors.size else np.zeros(len(gram))
        norms = np.sqrt(np.diag(gram) + priors)
        used = norms > MIN_NORM
        norms, inside, priors = norms[used], inside[:, used] / norms[used], priors[used] / norms[used] ** 2
        matrix = gram[np.ix_(used, used)] / np.outer(norms, norms) - inside.T @ inside
        values, vectors = np.linalg.eigh(matrix + np.diag(priors))
        determined = values > MIN_EIGENVALUE
        white = vectors[:, determined] / np.sqrt(values[determined])
        explained = white.T @ (score[used] / norms)
        shift: FloatArray = np.zeros(0)
        if self.factor.size:
            shift = np.asarray(np.linalg.solve(self.factor, inside @ (white @ explained)), dtype=np.float64)
        parameters = float(determined.sum() - np.sum(priors[:, None] * white**2))  # that corners, not priors, determine
        return self._cause(candidate, float(explained @ explained), parameters, shift)

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
        lens_columns = self._outside(d_global[:, :count])
        columns = np.concatenate([lens_columns, self._outside(self.d_global[:, self.intrinsics :])], axis=1)
        rest = self._outside(np.append(r, self.residuals[len(r) :])[:, None])[:, 0]
        rest = rest - columns @ np.linalg.lstsq(columns, rest, rcond=1e-12)[0]
        candidate = _Candidate(KIND_OF_ADDITION[addition], columns, addition=addition)
        explained = float(self.rest @ self.rest - rest @ rest)
        return self._cause(candidate, explained, max(count - self.intrinsics, 1), np.zeros(len(self.factor)))

    def _outside(self, columns: FloatArray) -> FloatArray:
        """Project columns, 0 in further rows, out of the space of each frame's own parameters."""
        further = np.zeros((len(self.rest) - len(columns), columns.shape[1]))
        return _outside(self.own, self.frames, np.concatenate([columns, further]))

    def _cause(self, candidate: _Candidate, explained: float, parameters: float, shift: FloatArray) -> Cause:
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


def _priors(fitted: Fitted, numbers: IntArray) -> tuple[tuple[FloatArray, FloatArray, FloatArray], list[IntArray]]:
    """The residuals (p,) of a model's priors, their derivatives (p, g) and (p, 24), and the indices of each frame's."""
    estimate, model = fitted.solution.estimate, fitted.model
    terms, size = model.frame_terms, len(fitted.solution.parameters)
    with_prior = np.flatnonzero(terms.weights)
    count = len(with_prior)
    of_frames = terms.values(estimate)[numbers][:, with_prior].reshape(-1)
    d_frame = np.zeros((count, FRAME_PARAMETERS))
    d_frame[np.arange(count), terms.free[with_prior]] = terms.weights[with_prior]
    intrinsics = np.eye(len(model.intrinsics), size) * model.intrinsic_priors(estimate.camera)[:, None]
    residuals_of_all = [of_frames, model.intrinsic_values(estimate.camera)]
    d_global = [np.zeros((len(of_frames), size)), intrinsics]
    if (prior := model.prior_of_centres) is not None:
        start = fitted.solution.parameters.index("mirror 0 x_mm")
        residuals_of_all.append(np.array([prior.value(estimate.virtual_centres_in_rig_mm)]))
        d_global.append(np.zeros((1, size)))
        d_global[-1][0, start : start + prior.coefficients.size] = prior.coefficients.reshape(-1)
    values, d_values = np.concatenate(residuals_of_all), np.concatenate(d_global)
    d_frames = np.concatenate(
        [np.tile(d_frame, (len(numbers), 1)), np.zeros((len(values) - len(of_frames), FRAME_PARAMETERS))]
    )
    return (values, d_values, d_frames), list(np.arange(len(of_frames)).reshape(len(numbers), count))


def _outside(own: list[FloatArray], frames: list[IntArray], columns: FloatArray) -> FloatArray:
    """Project columns (r, k) out of the space of each frame's own parameters."""
    outside = columns.copy()
    for basis, part in zip(own, frames, strict=True):
        outside[part] -= basis @ (basis.T @ columns[part])
    return outside


def _candidates(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[_Candidate]:
    """Yield all causes whose parameters the frames share, and those of single frames."""
    solution, model = fitted.solution, fitted.model
    estimate, additions = solution.estimate, fitted.name.split("+")
    board, modes = _deformable(model.board, free=_determines_corners(rows))
    shape = np.concatenate([estimate.shape, np.zeros(len(board.modes) - len(estimate.shape))])
    _, d_global, _ = _standardised(replace(estimate, shape=shape), rows, board)
    intrinsics = estimate.camera.intrinsic_names
    count, lens = len(estimate.virtual_centres_in_rig_mm), len(intrinsics)
    curvature, sheet = lens + 3 * count, lens + 6 * count
    for addition in further_cameras(estimate.camera, additions):
        if addition != "fisheye":
            camera = with_addition(estimate.camera, addition)
            columns = _standardised(replace(estimate, camera=camera), rows, model.board)[1][:, : camera.intrinsics.size]
            priors = 1.0 / camera.prior_sigmas
            yield _Candidate(KIND_OF_ADDITION[addition], columns, addition=addition, priors=priors)
    bare = np.repeat(_is_bare(rows), 2)
    if bare.any() and not bare.all():
        yield _Candidate("focus", np.where(bare[:, None], d_global[:, :PINHOLE], 0.0))
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
    for frame, part in zip(np.unique(rows.frame).tolist(), test.corners, strict=True):
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


def _causes_of_changed_focus(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[Cause]:
    """Yield the causes that focus or zoom changed before a frame was taken.

    A change before the first of the frames without mirrors, if these are the last ones, is a candidate of its own.
    """
    numbers, bare = np.unique(rows.frame), np.unique(rows.frame[_is_bare(rows)])
    firsts = [n for n in range(1, len(numbers)) if not np.array_equal(numbers[n:], bare)]
    _, d_global, _ = _standardised(fitted.solution.estimate, rows, fitted.model.board)
    candidates = [
        _Candidate("focus", NO_COLUMNS, frame=int(numbers[first]), alternatives=len(firsts)) for first in firsts
    ]
    yield from test.causes_of_changes(d_global[:, :PINHOLE], firsts, candidates)


def _causes_of_changed_board(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[Cause]:
    """Yield the causes that the board changed its shape before a frame was taken."""
    estimate, drawn = fitted.solution.estimate, fitted.model.board
    corners_mm = drawn.corners_in_board_mm
    board = Board.free(corners_mm) if _determines_corners(rows) else Board.warped(corners_mm)
    if len(drawn.modes) >= len(board.modes):
        board, shape = drawn, estimate.shape
    else:
        board = Board(corners_mm, np.concatenate([drawn.modes, board.modes]))
        shape = np.concatenate([estimate.shape, np.zeros(len(board.modes) - len(estimate.shape))])
    _, d_global, _ = _standardised(replace(estimate, shape=shape), rows, board)
    numbers = np.unique(rows.frame)
    firsts = range(1, len(numbers))
    candidates = [
        _Candidate("board changed", NO_COLUMNS, frame=int(numbers[first]), alternatives=len(firsts)) for first in firsts
    ]
    yield from test.causes_of_changes(d_global[:, -len(board.modes) :], firsts, candidates)


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


def _causes_of_frames(fitted: Fitted, rows: Observations, test: _ScoreTest) -> Iterator[Cause]:
    """Yield the causes with parameters of their own for each frame."""
    terms = fitted.model.frame_terms
    if not terms.has_motion:
        yield test.cause_of_frames(_Candidate("shutter", test.d_frame[:, 12:18], addition="motion"))
    if terms.bow_per_mm is None:
        yield test.cause_of_frames(_Candidate("bow", test.d_frame[:, 9:12], addition="bow"))
    if terms.rotation_per_rad is None and rows.direct_and_mirrored:
        yield test.cause_of_frames(_Candidate("turn", test.d_frame[:, 6:9], addition="turn"))
