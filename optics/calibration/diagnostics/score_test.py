"""Rao's score test of the causes of a misfit.

It predicts from the derivatives at a fit how far further parameters would lower the residuals, so no cause needs a fit
of its own. Poses, and all parameters of the model, are projected out first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.stats import f as f_distribution

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray
from mirrorcam.optics.calibration.solver.observations import IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import (
    FRAME_PARAMETERS,
    Board,
    Estimate,
    global_names,
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
NO_COLUMNS: FloatArray = np.zeros((0, 0))
MAX_CHANCE = 1e-3
"""Largest probability that frames with errors of their own would seem to show a cause."""
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


@dataclass(frozen=True)
class Candidate:
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
class ScoreTest:
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
    def of(cls, fitted: Fitted, rows: Observations) -> ScoreTest:
        solution, model = fitted.solution, fitted.model
        r, d_global, d_frame = standardised(solution.estimate, rows, model.board)
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

    def cause(self, candidate: Candidate) -> Cause:
        """Predict the effect of a candidate whose parameters all frames share."""
        return self._cause(candidate, *self._explained(candidate, *self._sums(candidate.columns)))

    def evident_causes(
        self, columns: FloatArray, affected: Sequence[BoolArray], candidates: Sequence[Candidate]
    ) -> Iterator[Cause]:
        """Predict the effect of parameters with derivatives (2n, k) that are equal in the affected frames (f,).

        Any systematic errors of the frames look like differences in such parameters. A cause is evident only if it
        explains significantly more than as many further differences between the frames do.
        """
        further = np.zeros((len(self.rest) - len(columns), columns.shape[1]))
        explained_by_all, all_parameters, _ = self._of_frames(np.concatenate([columns, further]))
        columns = self._outside(columns)
        others = (columns, self.shared, self.rest)
        gram, inside, score = (np.array([other[part].T @ columns[part] for part in self.frames]) for other in others)
        total, shared = gram.sum(axis=0), inside.sum(axis=0)
        norms = np.sqrt(np.maximum(np.diag(total), MIN_NORM**2))
        values = np.linalg.eigvalsh((total - shared.T @ shared) / np.outer(norms, norms))
        all_parameters -= int((values < MIN_EIGENVALUE).sum())  # the model already has those that the frames share
        for frames, candidate in zip(affected, candidates, strict=True):
            sums = [parts[frames].sum(axis=0) for parts in (gram, inside, score)]
            explained, parameters, shift = self._explained(candidate, *sums)
            if _is_evident(candidate, explained, parameters, explained_by_all, all_parameters):
                yield self._cause(candidate, explained, parameters, shift)

    def causes_of_pictures(self, candidates: Sequence[Candidate]) -> Iterator[Cause]:
        """Predict the effect of errors of single frames that are evidently larger than those of the others."""
        found = [self._explained(candidate, *self._sums(candidate.columns)) for candidate in candidates]
        explained_by_all = sum(explained for explained, _, _ in found)
        all_parameters = sum(parameters for _, parameters, _ in found)
        for candidate, (explained, parameters, shift) in zip(candidates, found, strict=True):
            if _is_evident(candidate, explained, parameters, explained_by_all, all_parameters):
                yield self._cause(candidate, explained, parameters, shift)

    def _sums(self, columns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products of columns (2n, k), outside the space of the frames, with themselves, `shared` and `rest`."""
        columns = self._outside(columns)
        return columns.T @ columns, self.shared.T @ columns, columns.T @ self.rest

    def _explained(
        self, candidate: Candidate, gram: FloatArray, inside: FloatArray, score: FloatArray
    ) -> tuple[float, float, FloatArray]:
        """Squared residuals that columns explain, their number, and the shift of the globals.

        From the products of the columns (2n, k) with themselves, `shared` and `rest`.
        """
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
        return float(explained @ explained), parameters, shift

    def cause_of_frames(self, candidate: Candidate) -> Cause:
        """Predict the effect of a candidate with parameters of its own for each frame."""
        return self._cause(candidate, *self._of_frames(candidate.columns))

    def _of_frames(self, columns: FloatArray) -> tuple[float, float, FloatArray]:
        """Like `_explained`, for columns (r, k) with parameters of their own for each frame."""
        own = [
            np.linalg.qr(np.concatenate([basis, columns[part]], axis=1))[0]
            for basis, part in zip(self.own, self.frames, strict=True)
        ]
        parameters = sum(basis.shape[1] for basis in own) - sum(basis.shape[1] for basis in self.own)
        d_global = _outside(own, self.frames, self.d_global)
        rest = _outside(own, self.frames, self.residuals[:, None])[:, 0]
        step = np.linalg.lstsq(d_global, rest, rcond=1e-12)[0]
        rest = rest - d_global @ step
        return float(self.rest @ self.rest - rest @ rest), parameters, np.asarray(step, dtype=np.float64)

    def cause_of_lens(self, addition: str, lens: Estimate, rows: Observations, board: Board) -> Cause:
        """Predict the effect of a different lens, with an estimate that has the nearest one."""
        r, d_global, _ = standardised(lens, rows, board)
        count = lens.camera.intrinsics.size
        lens_columns = self._outside(d_global[:, :count])
        columns = np.concatenate([lens_columns, self._outside(self.d_global[:, self.intrinsics :])], axis=1)
        rest = self._outside(np.append(r, self.residuals[len(r) :])[:, None])[:, 0]
        rest = rest - columns @ np.linalg.lstsq(columns, rest, rcond=1e-12)[0]
        candidate = Candidate(KIND_OF_ADDITION[addition], columns, addition=addition)
        explained = float(self.rest @ self.rest - rest @ rest)
        return self._cause(candidate, explained, max(count - self.intrinsics, 1), np.zeros(len(self.factor)))

    def _outside(self, columns: FloatArray) -> FloatArray:
        """Project columns, 0 in further rows, out of the space of each frame's own parameters."""
        further = np.zeros((len(self.rest) - len(columns), columns.shape[1]))
        return _outside(self.own, self.frames, np.concatenate([columns, further]))

    def _cause(self, candidate: Candidate, explained: float, parameters: float, shift: FloatArray) -> Cause:
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


def _is_evident(
    candidate: Candidate, explained: float, parameters: float, explained_by_all: float, all_parameters: float
) -> bool:
    """Whether a cause explains significantly more than other parameters of its kind, of all frames, by an F test."""
    others, other_parameters = explained_by_all - explained, all_parameters - parameters
    if parameters <= 0.0 or other_parameters <= 0.0:
        return False
    ratio = explained / parameters * other_parameters / max(others, MIN_NORM)
    return bool(candidate.alternatives * f_distribution.sf(ratio, parameters, other_parameters) < MAX_CHANCE)


def standardised(estimate: Estimate, rows: Observations, board: Board) -> tuple[FloatArray, FloatArray, FloatArray]:
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
