"""The ladder of models: what may vary, from the paper's three numbers per mirror up, and what the data support.

paper: virtual centres and board poses, with the camera held. joint: intrinsics, too. Above that, in any order:
sheet: the thickness of second-surface mirrors. bend: the curvature of each mirror. warp: two bows of the board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.diagnostics.cross_validation import balanced_folds, held_out_residuals
from mirrorcam.optics.calibration.diagnostics.error_correlation import correlated_errors
from mirrorcam.optics.calibration.diagnostics.free_views import FreeViews, free_views
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NOTHING_PX
from mirrorcam.optics.calibration.solver.levenberg_marquardt import (
    BoolArray,
    Solution,
    UndeterminedError,
    fit,
    minimise,
)
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.camera import INTRINSIC_NAMES
from mirrorcam.optics.geometry.plate import rise_mm

ADDITIONS = ("sheet", "bend", "warp")
FOLDS = 3
SUPPORTED_CHANCE = 1e-3
BEYOND_NOISE = 2.0
"""Standard errors by which held-out frames must be explained better."""
MATERIAL = 0.1
"""Part of the noise that mirrors must leave unexplained beyond it before it is worth an alarm."""
THINNEST_MM = 0.1  # no sheet that holds a mirror is thinner
GLASS_MM, GLASS_INDEX = 1.0, 1.49
"""A sheet to start from where the layout has none; its index is that of acrylic."""


@dataclass(frozen=True)
class ModelComparison:
    """One model tried: what it frees, how well it fits, and whether the data support it over `against`.

    `rms_px` per axis over the corners that took part and `sigma_px`, which counts the unknowns. Against the model
    below it, on the same corners: `drop`, by how many sigma^2 the sum of squares falls; `chance` of that from noise
    alone (F test of the likelihood ratio); `information_gain`, by how much the Bayesian information criterion falls.
    `held_out_rms_px` is that of frames predicted by a fit without them, `held_out_gain` the improvement in standard
    errors; NaN where not computed (the likelihood already rejects the model, or another comparison gains more).
    """

    name: str
    against: str | None
    parameters: int
    rms_px: float
    sigma_px: float
    drop: float
    chance: float
    information_gain: float
    held_out_rms_px: float
    held_out_gain: float
    supported: bool


@dataclass(frozen=True)
class ModelSelection:
    """The selected level, its model and solution, every comparison made, the free-view check, alarms and notes.

    The covariance of the solution is `widened`, as a factor of its standard deviations, against what independent errors
    of all corners would make it.
    """

    level: str
    model: Model
    solution: Solution
    comparisons: tuple[ModelComparison, ...]
    free_views: FreeViews | None
    alarms: tuple[str, ...]
    notes: tuple[str, ...]
    widened: float = 1.0

    def widened_to(self, factor: float) -> ModelSelection:
        """The same with standard deviations at least so many times what independent errors would make them."""
        further = max(factor / self.widened, 1.0)
        solution = replace(self.solution, covariance=further**2 * self.solution.covariance)
        return replace(self, solution=solution, widened=further * self.widened)


@dataclass(frozen=True)
class Fitted:
    """A model under the name of its level, and its fit."""

    name: str
    model: Model
    solution: Solution


def additions_of(level: str) -> tuple[str, ...]:
    """The additions to `joint` that a level names, as in "joint+sheet+warp"; raises InputError for anything else."""
    first, *additions = level.split("+")
    known = first in {"paper", "joint"} and all(name in ADDITIONS for name in additions)
    if not known or (first == "paper" and additions) or len(set(additions)) < len(additions):
        raise InputError(f"level {level!r}, expected paper, or joint with any of {', '.join(ADDITIONS)} (joint+bend)")
    return tuple(additions)


def select_model(
    start: Estimate,
    observations: Observations,
    corners_in_board_mm: FloatArray,
    *,
    intrinsics: tuple[str, ...] = INTRINSIC_NAMES,
    level: str | None = None,
) -> ModelSelection:
    """Fit at a `level`, or, without one, as far up the ladder as the data support.

    The camera was found from the same corners as the rest, so that `joint` is the lowest level that tells the truth
    about its uncertainty: `paper` is taken only when asked for, or where the corners leave the intrinsics open. Above
    it the addition that gains most information is taken as long as one is supported: its likelihood ratio is no noise,
    and frames held out are predicted better. Raises UndeterminedError where the corners do not suffice.
    """
    asked = None if level is None else additions_of(level)
    paper = fit_as("paper", start, observations, _model((), (), corners_in_board_mm))
    comparisons = [first_comparison(paper)]
    try:
        current = fit_as("joint", paper.solution.estimate, observations, _model(intrinsics, (), corners_in_board_mm))
    except UndeterminedError:
        if asked is not None and level != "paper":
            raise
        note = "the corners leave the intrinsics open: they are held as they were"
        return conclude(paper, comparisons, observations, [], [note])
    comparisons.append(compare(current, paper, observations))
    if level == "paper":
        note = "the intrinsics are held: what they may be off is in no uncertainty"
        doubts = [_alarm(current, "joint")] if comparisons[-1].supported else []
        return conclude(paper, comparisons, observations, doubts, [note])
    if asked:
        for name in asked:
            taken = _added(current, name, observations, intrinsics, corners_in_board_mm)
            comparisons.append(compare(taken, current, observations))
            current = taken
    left = [name for name in ADDITIONS if name not in current.name.split("+")]
    alarms: list[str] = []
    notes: list[str] = []
    while left:
        tried, open_ones = _tried(current, left, observations, intrinsics, corners_in_board_mm)
        notes += open_ones
        best = None
        judged = [(fitted, _judged(fitted, current, observations)) for fitted in tried]
        # Held-out frames are the dearer witness: asked about the most informative first, no further once one agrees.
        for fitted, comparison in sorted(judged, key=lambda pair: -pair[1].information_gain):
            comparisons.append(comparison if best is not None else _held_out(comparison, fitted, current, observations))
            if comparisons[-1].supported:
                best = fitted
        if best is None:
            break
        addition = best.name.removeprefix(f"{current.name}+")
        if addition == "glass" or level is not None:
            alarms.append(_alarm(best, addition))
            break
        current = best
        left.remove(addition)
    if "sheet" in current.name.split("+"):
        alarms += _no_sheet(current)
    return conclude(current, comparisons, observations, alarms, notes)


def _model(intrinsics: tuple[str, ...], additions: Sequence[str], corners_in_board_mm: FloatArray) -> Model:
    board = Board.warped(corners_in_board_mm) if "warp" in additions else Board.rigid(corners_in_board_mm)
    return Model(
        intrinsics, thickness="sheet" in additions or "glass" in additions, curvature="bend" in additions, board=board
    )


def fit_as(name: str, start: Estimate, observations: Observations, model: Model) -> Fitted:
    """The fit of a model under the name of its level."""
    return Fitted(name, model, fit(start, observations, model))


def _tried(
    current: Fitted,
    left: Sequence[str],
    observations: Observations,
    intrinsics: tuple[str, ...],
    corners_in_board_mm: FloatArray,
) -> tuple[list[Fitted], list[str]]:
    """The fits with one more addition each, and a note on each addition that the corners leave open.

    Where the layout has no sheet to vary, "glass" stands in: sheets where it says there are none.
    """
    sheets = (current.solution.estimate.thickness_mm > 0.0).any()
    found, notes = [], []
    for name in left:
        addition = "glass" if name == "sheet" and not sheets else name
        try:
            found.append(_added(current, addition, observations, intrinsics, corners_in_board_mm))
        except UndeterminedError as error:
            notes.append(f"{current.name}+{addition} not tried: {error}")
    return found, notes


def _added(
    current: Fitted,
    addition: str,
    observations: Observations,
    intrinsics: tuple[str, ...],
    corners_in_board_mm: FloatArray,
) -> Fitted:
    estimate = current.solution.estimate
    if addition == "sheet" and not (estimate.thickness_mm > 0.0).any():
        raise InputError("level sheet: the layout has no second-surface mirror, expected one whose thickness can vary")
    if addition == "warp":
        estimate = replace(estimate, shape=np.zeros(2))
    if addition == "glass":
        estimate = _behind_glass(estimate)
    name = f"{current.name}+{addition}"
    return fit_as(name, estimate, observations, _model(intrinsics, name.split("+"), corners_in_board_mm))


def _behind_glass(estimate: Estimate) -> Estimate:
    """The same mirrors, coated behind sheets, that look alike along the middle of each."""
    centres = estimate.virtual_centres_in_rig_mm
    distance = np.linalg.norm(centres, axis=1) / 2.0
    foot = centres / 2.0
    middles = estimate.middles_in_rig_mm
    across = np.linalg.norm(middles - foot - _along(middles - foot, centres), axis=1)
    rise = rise_mm(across / distance, GLASS_MM, GLASS_INDEX)
    mirrors = len(centres)
    return replace(
        estimate,
        virtual_centres_in_rig_mm=centres * (1.0 + rise / distance)[:, None],
        thickness_mm=np.full(mirrors, GLASS_MM),
        refractive_index=np.full(mirrors, GLASS_INDEX),
    )


def _along(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    return np.asarray(np.sum(vectors * axes, axis=1, keepdims=True) / np.sum(axes * axes, axis=1, keepdims=True) * axes)


def _thickness(fitted: Fitted) -> tuple[float, float]:
    """Thickness of the thinnest sheet and its standard deviation, mm."""
    place = fitted.solution.parameters.index("sheet_mm")
    thickness = fitted.solution.estimate.thickness_mm
    sigma = float(np.sqrt(fitted.solution.covariance[place, place]))
    return float(thickness[thickness > 0.0].min()), sigma


def _no_sheet(fitted: Fitted) -> list[str]:
    thickness, sigma = _thickness(fitted)
    if thickness > max(3.0 * sigma, THINNEST_MM):
        return []
    return [
        f"the sheets come out {thickness:.2g} +- {sigma:.2g} mm thick: the mirrors look coated in front, "
        "the layout says they are coated behind"
    ]


def _alarm(best: Fitted, addition: str) -> str:
    if addition == "glass":
        thickness, sigma = _thickness(best)
        return (
            f"the mirrors look like glass coated behind, {thickness:.2f} +- {sigma:.2g} mm thick if its index is "
            f"{GLASS_INDEX}: the layout says they are coated in front"
        )
    return f"the data support a further level, {best.name}"


def first_comparison(fitted: Fitted) -> ModelComparison:
    """The comparison that a select_model begins with, which stands against none."""
    solution = fitted.solution
    return ModelComparison(
        name=fitted.name,
        against=None,
        parameters=len(solution.parameters),
        rms_px=_rms(solution),
        sigma_px=solution.sigma_px,
        drop=np.nan,
        chance=np.nan,
        information_gain=np.nan,
        held_out_rms_px=np.nan,
        held_out_gain=np.nan,
        supported=True,
    )


def _rms(solution: Solution) -> float:
    return float(np.sqrt(np.mean(solution.residuals[solution.inliers] ** 2)))


def compare(larger: Fitted, smaller: Fitted, observations: Observations) -> ModelComparison:
    """What likelihood and frames held out say of a larger model."""
    return _held_out(_judged(larger, smaller, observations), larger, smaller, observations)


def _judged(larger: Fitted, smaller: Fitted, observations: Observations) -> ModelComparison:
    """What the likelihood says of the larger model, on the corners that it takes for no outliers."""
    rows = larger.solution.inliers
    seen = observations.where(rows)
    # Corners without noise, from a simulation, would make diagnostics of rounding.
    floor = 2 * len(seen) * NOTHING_PX**2
    squares = float(np.sum(larger.solution.residuals[rows] ** 2)) + floor
    at_smaller = _at_minimum(smaller, observations, rows)
    squares_smaller = float(np.sum(residuals(at_smaller, seen, smaller.model.board) ** 2)) + floor
    added = len(larger.solution.parameters) - len(smaller.solution.parameters)
    spare = 2 * len(seen) - len(larger.solution.parameters) - 6 * len(at_smaller.rig_from_board)
    drop = max(squares_smaller - squares, 0.0) / (squares / spare)
    return ModelComparison(
        name=larger.name,
        against=smaller.name,
        parameters=len(larger.solution.parameters),
        rms_px=_rms(larger.solution),
        sigma_px=larger.solution.sigma_px,
        drop=drop,
        chance=float(f_distribution.sf(drop / added, added, spare)),
        information_gain=2 * len(seen) * float(np.log(squares_smaller / squares))
        - added * float(np.log(2 * len(seen))),
        held_out_rms_px=np.nan,
        held_out_gain=np.nan,
        supported=False,
    )


def _at_minimum(fitted: Fitted, observations: Observations, rows: BoolArray) -> Estimate:
    """The estimate of a model at the minimum over other rows than it chose itself."""
    if np.array_equal(rows, fitted.solution.inliers):
        return fitted.solution.estimate
    return minimise(fitted.solution.estimate, observations.where(rows), fitted.model)[0]


def _held_out(
    comparison: ModelComparison, larger: Fitted, smaller: Fitted, observations: Observations
) -> ModelComparison:
    """The comparison with what frames held out say, where the likelihood speaks for it; supported where they agree.

    The gain is the mean over frames in standard errors of that mean: frames are independent where corners of one frame
    may not be. Too few frames to hold any out support nothing.
    """
    seen = observations.where(larger.solution.inliers)
    enough = len(np.unique(seen.frame)) >= FOLDS
    if not (comparison.chance < SUPPORTED_CHANCE and comparison.information_gain > 0.0 and enough):
        return comparison
    fold = balanced_folds(smaller.solution.estimate, seen, smaller.model.board, FOLDS)
    squares = []
    for fitted in (larger, smaller):
        try:
            left = held_out_residuals(fitted.solution.estimate, seen, fitted.model, fold)
        except UndeterminedError:
            return comparison
        squares.append(np.bincount(seen.frame, weights=np.sum(left**2, axis=1)))
    gains = squares[1] - squares[0]
    error = float(np.std(gains, ddof=1)) * float(np.sqrt(len(gains)))
    gain = float(gains.sum()) / error if error > 0.0 else 0.0
    return replace(
        comparison,
        held_out_rms_px=float(np.sqrt(squares[0].sum() / (2 * len(seen)))),
        held_out_gain=gain,
        supported=gain > BEYOND_NOISE,
    )


def conclude(
    current: Fitted,
    comparisons: Sequence[ModelComparison],
    observations: Observations,
    alarms: list[str],
    notes: list[str],
) -> ModelSelection:
    """The select_model that ends at `current`, with the check by free views and errors that corners share."""
    free = None
    try:
        free = free_views(current.solution, observations, current.model)
    except UndeterminedError as error:
        notes = [*notes, f"no check by free virtual cameras: {error}"]
    if (
        free is not None
        and free.chance < SUPPORTED_CHANCE
        and free.unexplained_px > max(MATERIAL * free.rms_px, NOTHING_PX)
    ):
        alarms = [
            *alarms,
            f"mirrors as {current.name} describes them leave {free.unexplained_px:.2g} px unexplained "
            "that free virtual cameras explain",
        ]
    shared = correlated_errors(current.solution, observations, current.model).widening
    if shared > 1.0:
        note = (
            f"the corners of a frame share errors: all uncertainties are {shared:.1f} times what independent ones give"
        )
        notes = [*notes, note]
    reached = ModelSelection(
        current.name, current.model, current.solution, tuple(comparisons), free, tuple(alarms), tuple(notes)
    )
    return reached.widened_to(shared)
