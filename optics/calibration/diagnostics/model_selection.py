"""Forward selection among nested models by the support of the data."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.core.progress import Step, no_step
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.consistency import MAX_OUTLIERS
from mirrorcam.optics.calibration.diagnostics.corner_noise import correlated_errors
from mirrorcam.optics.calibration.diagnostics.free_views import FreeViews, free_views
from mirrorcam.optics.calibration.diagnostics.left_out import LeftOut, left_out
from mirrorcam.optics.calibration.diagnostics.model_comparison import (
    SUPPORTED_CHANCE,
    ModelComparison,
    compare,
    compare_likelihood,
    cross_validated,
    frames_of,
    smallest_model,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    ADDITIONS,
    CAMERA_ADDITIONS,
    IN_WORDS,
    INDEX_SIGMA,
    LENS_ADDITIONS,
    PLAIN_ADDITIONS,
    PLATE_INDEX,
    Fitted,
    fit_as,
    fit_with,
    further_cameras,
    joint_model,
    paper_model,
    plate_thickness,
)
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, DIRECT_ADDITIONS, RequestedModel
from mirrorcam.optics.calibration.diagnostics.score_test import Cause
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution, UndeterminedError
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import CentresPrior, Model
from mirrorcam.optics.calibration.solver.residuals import Estimate

MIN_UNEXPLAINED = 0.1
"""Minimum unexplained residual that raises an alarm, as a fraction of the noise."""
MIN_RELATIVE_GAIN, MIN_GAIN = 0.5, 10.0
"""An addition is fitted if its predicted gain is at least this fraction of the largest gain of any cause, and this."""
MAX_MIRRORED_FRAMES, MAX_DIRECT_FRAMES = 20, 10
"""Maximum number of frames with and without mirrors by which models are compared."""
MIN_PLATE_MM = 0.1  # thinner than any plate of a mirror


@dataclass(frozen=True)
class OtherSurface:
    """Evidence that the mirrors reflect at a different surface from the one in the layout: the fitted plate thickness.

    `sigma_mm` is its standard deviation for independent corner errors; `is_second_surface` states whether the pictures
    show second-surface mirrors.
    """

    thickness_mm: float
    sigma_mm: float
    is_second_surface: bool

    def sentence(self, inflation: float) -> str:
        """Describe the evidence, with the standard deviation multiplied by `inflation`."""
        thickness = f"{self.thickness_mm:.3g} +- {inflation * self.sigma_mm:.2g} mm"
        if self.is_second_surface:
            return (
                f"the mirrors appear to be second-surface, {thickness} thick if the index is {PLATE_INDEX}: the layout "
                "has first-surface mirrors; --model second_surface+auto calibrates them as such"
            )
        return (
            f"the plates come out {thickness} thick: the mirrors appear to be first-surface, the layout has "
            "second-surface mirrors; --model first_surface+auto calibrates them as such"
        )


Alarm = str | OtherSurface


@dataclass(frozen=True)
class ModelSelection:
    """The selected model, its fit, and the comparisons that led to it.

    Attributes
    ----------
    model_name
        Name of the selected model, such as `joint+bend`.
    model
        The selected model with its free parameters.
    solution
        Its fit. The covariance is scaled by `inflation` squared.
    comparisons
        Each fitted model compared with the model nested in it.
    free_views
        Comparison with free virtual cameras, if possible.
    alarms
        Contradictions to the model, one sentence each.
    other_surface
        Evidence that the mirrors reflect at a different surface from the one in the layout, if any.
    notes
        Undetermined quantities, one sentence each.
    causes
        What the model does not explain, the most probable cause first.
    left_out
        What is gained by leaving out pictures, if they are the first cause.
    inflation
        Factor on the standard deviations, relative to independent corner errors.
    """

    model_name: str
    model: Model
    solution: Solution
    comparisons: tuple[ModelComparison, ...]
    free_views: FreeViews | None
    alarms: tuple[str, ...]
    notes: tuple[str, ...]
    other_surface: OtherSurface | None = None
    causes: tuple[Cause, ...] = ()
    left_out: LeftOut | None = None
    inflation: float = 1.0

    def inflated_to(self, factor: float) -> ModelSelection:
        """Return the selection with standard deviations of at least `factor` times those for independent errors."""
        factor_change = max(factor / self.inflation, 1.0)
        solution = replace(self.solution, covariance=factor_change**2 * self.solution.covariance)
        return replace(self, solution=solution, inflation=factor_change * self.inflation)


def select_model(
    start: Estimate,
    observations: Observations,
    corners_in_board_mm: FloatArray,
    *,
    model: RequestedModel = AUTO,
    prior: CentresPrior | None = None,
    surface_known: bool = True,
    on_step: Step = no_step,
) -> ModelSelection:
    """Fit the requested model and, if it is automatic, extend it by forward selection.

    The camera was estimated from the same corners, so only `joint` and larger models have a valid uncertainty. The
    model `paper`, with fixed intrinsics, is used only on request, or if the corners do not determine the intrinsics;
    without mirrors it would have no parameters, and `joint` is the smallest model.
    Starting from `joint`, the most informative addition is made as long as the data support one: its likelihood ratio
    exceeds noise, and it predicts held-out frames better. With mirrors, an irregular lens gets a pupil that walks even
    where few pictures show no walk: their bounds would exclude what would shift the mirrors.

    Parameters
    ----------
    start
        Estimate near the solution, with one pose per frame.
    observations
        The corners, by frame and view.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.
    model
        Model to fit; `start` already has its lens. If a larger model is supported, an automatic model is extended;
        others raise an alarm.
    prior
        Prior on the virtual centres, in every model.
    surface_known
        Whether the surface of the mirrors in `start` and the distance in focus of its camera are known. Otherwise,
        plates are added if the corners support them; of known first-surface mirrors, they raise an alarm. Growth out of
        focus is not tried without that distance.
    on_step
        Called with each step in words.

    Raises
    ------
    UndeterminedError
        If the corners do not determine the model.
    InputError
        If plates are requested that the layout does not have.
    """
    some = _some_frames(observations)
    first = frames_of(observations, start, some)[::-1]
    current, comparisons, alarms, notes = _selected(*first, corners_in_board_mm, model, prior, surface_known, on_step)
    if not some.all():
        on_step(f"fitting all {len(some)} pictures")
        estimate = current.solution.estimate.with_poses(start.rig_from_board)
        current = fit_as(current.name, estimate, observations, current.model)
        notes.append(
            f"the models were compared by {some.sum()} of the {len(some)} pictures, and the selected one fitted to all"
        )
    return _finished_selection(current, comparisons, observations, alarms, notes)


def _some_frames(observations: Observations) -> BoolArray:
    """Mask (f,) of the frames by which models are compared: evenly spaced ones of those with and without mirrors."""
    count = int(observations.frame.max()) + 1
    mirrored = np.isin(np.arange(count), observations.frame[observations.view != DIRECT])
    chosen = np.zeros(count, dtype=bool)
    max_direct = MAX_DIRECT_FRAMES if mirrored.any() else MAX_MIRRORED_FRAMES
    for numbers, most in ((np.flatnonzero(mirrored), MAX_MIRRORED_FRAMES), (np.flatnonzero(~mirrored), max_direct)):
        step = max(len(numbers) / most, 1.0)
        chosen[numbers[np.arange(0.0, len(numbers), step).astype(int)]] = True
    return chosen


def _selected(
    start: Estimate,
    observations: Observations,
    corners_in_board_mm: FloatArray,
    model: RequestedModel,
    prior: CentresPrior | None,
    surface_known: bool,
    on_step: Step,
) -> tuple[Fitted, list[ModelComparison], list[Alarm], list[str]]:
    """Return the selected model fitted to some frames, the comparisons made, alarms and notes."""
    if not len(start.virtual_centres_in_rig_mm):
        on_step("solving for the camera")
        camera = fit_as("joint", start, observations, joint_model(start.camera, corners_in_board_mm))
        return _extended(camera, [smallest_model(camera)], observations, PLAIN_ADDITIONS, model, surface_known, on_step)
    on_step("solving for mirrors and camera")
    paper = fit_as("paper", start, observations, paper_model(corners_in_board_mm, prior))
    comparisons = [smallest_model(paper)]
    try:
        start = paper.solution.estimate
        current = fit_as("joint", start, observations, joint_model(start.camera, corners_in_board_mm, prior))
    except UndeterminedError:
        if not model.paper and (not model.auto or model.additions):
            raise
        return (
            paper,
            comparisons,
            [],
            ["the corners do not determine the intrinsics: they are fixed at their initial values"],
        )
    comparisons.append(compare(current, paper, observations))
    if model.paper:
        alarms = [_alarm(current, "joint")] if comparisons[-1].supported else []
        return paper, comparisons, alarms, ["the intrinsics are fixed: no uncertainty includes their errors"]
    return _extended(current, comparisons, observations, ADDITIONS, model, surface_known, on_step)


def _extended(
    current: Fitted,
    comparisons: list[ModelComparison],
    observations: Observations,
    additions: Sequence[str],
    model: RequestedModel,
    surface_known: bool,
    on_step: Step,
) -> tuple[Fitted, list[ModelComparison], list[Alarm], list[str]]:
    """Make the additions requested and, if the model is automatic, those that the data support."""
    additions = [name for name in additions if not (model.lens is not None and name in LENS_ADDITIONS)]
    if observations.direct_and_mirrored:
        additions += DIRECT_ADDITIONS
    first_plates = "glass" if surface_known else "plates"
    if not surface_known:  # nor are the refractive index of plates and the distance in focus
        additions = [name for name in additions if name != "colour"]
        current = replace(current, model=replace(current.model, index_sigma=INDEX_SIGMA))
    for name in model.additions:
        on_step(f"fitting {IN_WORDS[name]}")
        addition = "plates" if name == "sheet" and not surface_known and not _has_plates(current) else name
        larger = fit_with(addition, current, observations)
        comparisons.append(compare(larger, current, observations))
        current = larger
    current, further, alarms, notes = _forward_selection(
        current, observations, additions, extend=model.auto, first_plates=first_plates, on_step=on_step
    )
    if surface_known and "sheet" in current.name.split("+") and not _has_thick_plates(current):
        alarms.append(OtherSurface(*plate_thickness(current), is_second_surface=False))
    return current, [*comparisons, *further], alarms, notes


def _forward_selection(
    current: Fitted,
    observations: Observations,
    additions: Sequence[str],
    *,
    extend: bool,
    first_plates: str,
    on_step: Step,
) -> tuple[Fitted, list[ModelComparison], list[Alarm], list[str]]:
    """Return the largest supported model, the comparisons made, alarms and notes.

    If the model must not be extended, the first supported addition raises an alarm instead, as do plates that the
    layout lacks. For mirrors without plates, `first_plates` replaces the addition "sheet".
    """
    comparisons: list[ModelComparison] = []
    alarms: list[Alarm] = []
    notes: list[str] = []
    unsupported: set[str] = set()
    while remaining := [name for name in _remaining(current, additions) if name not in unsupported]:
        tried, candidates, undetermined = _fit_additions(
            current, remaining, unsupported, observations, first_plates, on_step
        )
        notes += undetermined
        best = None
        likelihoods = [(fitted, compare_likelihood(fitted, current, observations)) for fitted in candidates]
        # Cross-validation is expensive: the most informative addition is tried first, others only if it fails.
        for fitted, comparison in sorted(likelihoods, key=lambda pair: -pair[1].information_gain):
            comparisons.append(
                comparison if best is not None else cross_validated(comparison, fitted, current, observations)
            )
            if comparisons[-1].supported:
                best = fitted
        if best is None and tried:
            unsupported |= {*tried}
            continue
        if best is None:
            break
        unsupported = set()
        addition = best.name.removeprefix(f"{current.name}+")
        if addition == "glass" or not extend:
            alarms.append(_alarm(best, addition))
            break
        current = best
        if addition == "spline" and "walk" in remaining and _has_mirrors(current):
            on_step(f"fitting {IN_WORDS['walk']}")
            try:
                current = fit_with("walk", current, observations)
                notes.append("an irregular lens may also have a pupil that walks: the bounds allow for it")
            except UndeterminedError as error:
                notes.append(f"{current.name}+walk not tried: {error}")
    return current, comparisons, alarms, notes


def _remaining(current: Fitted, additions: Sequence[str]) -> list[str]:
    """The additions that a model does not have yet."""
    additions_made = current.name.split("+")
    cameras = further_cameras(current.solution.estimate.camera, additions_made)
    included = {*additions_made, *(["warp"] if "board" in additions_made else [])}
    return [name for name in additions if name not in included and (name not in CAMERA_ADDITIONS or name in cameras)]


def _has_mirrors(fitted: Fitted) -> bool:
    return len(fitted.solution.estimate.virtual_centres_in_rig_mm) > 0


def _has_plates(fitted: Fitted) -> bool:
    return bool((fitted.solution.estimate.thickness_mm > 0.0).any())


def _fit_additions(
    current: Fitted,
    remaining: Sequence[str],
    unsupported: Collection[str],
    observations: Observations,
    first_plates: str,
    on_step: Step,
) -> tuple[list[str], list[Fitted], list[str]]:
    """Fit further additions; return their names, the fits, and a note on each that the corners do not determine.

    An addition is fitted only if its score test predicts an information gain close to the greatest, of causes other
    than the `unsupported` additions.
    """
    fits, notes = [], []
    causes = [cause for cause in ranked_causes(current, observations) if cause.addition not in unsupported]
    gains = {cause.addition: cause.gain for cause in reversed(causes)}
    # One picture may be left out later, but a cause that concerns many makes the test of others invalid.
    largest = max((cause.gain for cause in causes if cause.kind != "picture"), default=0.0)
    min_gain = max(MIN_RELATIVE_GAIN * largest, MIN_GAIN)
    tried = [name for name in remaining if gains.get(name, 0.0) >= min_gain]
    for name in tried:
        addition = first_plates if name == "sheet" and not _has_plates(current) else name
        on_step(f"trying {IN_WORDS[name]}")
        try:
            larger = fit_with(addition, current, observations)
        except UndeterminedError as error:
            notes.append(f"{current.name}+{addition} not tried: {error}")
            continue
        outliers = float((~larger.solution.inliers).mean())
        if outliers > MAX_OUTLIERS:
            notes.append(f"{larger.name} not used: {outliers:.0%} of the corners do not fit it")
        elif addition != "glass" or _has_thick_plates(larger):
            fits.append(larger)
    return tried, fits, notes


def _has_thick_plates(fitted: Fitted) -> bool:
    """Whether the fitted plates are thick enough to be plates."""
    thickness_mm, sigma_mm = plate_thickness(fitted)
    return thickness_mm > max(3.0 * sigma_mm, MIN_PLATE_MM)


def _alarm(best: Fitted, addition: str) -> Alarm:
    if addition == "glass":
        return OtherSurface(*plate_thickness(best), is_second_surface=True)
    return f"the data support a larger model, {best.name}"


def _finished_selection(
    current: Fitted,
    comparisons: Sequence[ModelComparison],
    observations: Observations,
    alarms: Sequence[Alarm] = (),
    notes: Sequence[str] = (),
) -> ModelSelection:
    """Build the selection of `current`, with the check by free virtual cameras and the correlation of errors."""
    free = None
    if len(current.solution.estimate.virtual_centres_in_rig_mm):
        try:
            free = free_views(current.solution, observations, current.model)
        except UndeterminedError as error:
            notes = [*notes, f"no check by free virtual cameras: {error}"]
    if (
        free is not None
        and free.chance < SUPPORTED_CHANCE
        and free.unexplained_px > max(MIN_UNEXPLAINED * free.rms_px, NEGLIGIBLE_PX)
    ):
        alarm = (
            f"the mirrors of the model {current.name} leave residuals of {free.unexplained_px:.2g} px "
            "that only free virtual cameras explain"
        )
        alarms = [*alarms, alarm]
    inflation = correlated_errors(current.solution, observations, current.model).inflation
    if inflation > 1.0:
        note = (
            f"the errors of corners in one frame are correlated: all uncertainties are {inflation:.1f} times those of "
            "independent errors"
        )
        notes = [*notes, note]
    names = (comparison.name for comparison in comparisons if not comparison.supported)
    rejected = {name.replace("+glass", "+sheet") for name in names}
    causes = [
        cause
        for cause in ranked_causes(current, observations)
        if cause.gain > MIN_GAIN and f"{current.name}+{cause.addition}" not in rejected
    ]
    selected = ModelSelection(
        current.name,
        current.model,
        current.solution,
        tuple(comparisons),
        free,
        tuple(alarm for alarm in alarms if isinstance(alarm, str)),
        tuple(notes),
        next((alarm for alarm in alarms if isinstance(alarm, OtherSurface)), None),
        tuple(causes),
        left_out(current, causes, observations),
    )
    return selected.inflated_to(inflation)
