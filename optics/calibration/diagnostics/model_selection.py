"""Forward selection among nested models by the support of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mirrorcam.core.progress import Step, no_step
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.causes import KIND_OF_ADDITION, Cause, ranked_causes
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
    smallest_model,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import (
    ADDITIONS,
    CAMERA_ADDITIONS,
    IN_WORDS,
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
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import CentresPrior, Model
from mirrorcam.optics.calibration.solver.residuals import Estimate

MIN_UNEXPLAINED = 0.1
"""Minimum unexplained residual that raises an alarm, as a fraction of the noise."""
MIN_RELATIVE_GAIN, MIN_GAIN = 0.5, 10.0
"""An addition is fitted if its predicted gain is at least this fraction of the largest gain of any cause, and this."""
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
    on_step: Step = no_step,
) -> ModelSelection:
    """Fit the requested model and, if it is automatic, extend it by forward selection.

    The camera was estimated from the same corners, so only `joint` and larger models have a valid uncertainty. The
    model `paper`, with fixed intrinsics, is used only on request, or if the corners do not determine the intrinsics;
    without mirrors it would have no parameters, and `joint` is the smallest model.
    Starting from `joint`, the most informative addition is made as long as the data support one: its likelihood ratio
    exceeds noise, and it predicts held-out frames better.

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
    on_step
        Called with each step in words.

    Raises
    ------
    UndeterminedError
        If the corners do not determine the model.
    InputError
        If plates are requested that the layout does not have.
    """
    if not len(start.virtual_centres_in_rig_mm):
        on_step("solving for the camera")
        camera = fit_as("joint", start, observations, joint_model(start.camera, corners_in_board_mm))
        return _extended(camera, [smallest_model(camera)], observations, PLAIN_ADDITIONS, model, on_step)
    on_step("solving for mirrors and camera")
    paper = fit_as("paper", start, observations, paper_model(corners_in_board_mm, prior))
    comparisons = [smallest_model(paper)]
    try:
        start = paper.solution.estimate
        current = fit_as("joint", start, observations, joint_model(start.camera, corners_in_board_mm, prior))
    except UndeterminedError:
        if not model.paper and (not model.auto or model.additions):
            raise
        note = "the corners do not determine the intrinsics: they are fixed at their initial values"
        return finished_selection(paper, comparisons, observations, notes=[note])
    comparisons.append(compare(current, paper, observations))
    if model.paper:
        note = "the intrinsics are fixed: no uncertainty includes their errors"
        alarms = [_alarm(current, "joint")] if comparisons[-1].supported else []
        return finished_selection(paper, comparisons, observations, alarms, [note])
    return _extended(current, comparisons, observations, ADDITIONS, model, on_step)


def _extended(
    current: Fitted,
    comparisons: list[ModelComparison],
    observations: Observations,
    additions: Sequence[str],
    model: RequestedModel,
    on_step: Step,
) -> ModelSelection:
    """Make the additions requested and, if the model is automatic, those that the data support."""
    additions = [name for name in additions if not (model.lens is not None and name in LENS_ADDITIONS)]
    for name in model.additions:
        on_step(f"fitting {IN_WORDS[name]}")
        larger = fit_with(name, current, observations)
        comparisons.append(compare(larger, current, observations))
        current = larger
    current, further, alarms, notes = forward_selection(
        current, observations, additions, extend=model.auto, on_step=on_step
    )
    if "sheet" in current.name.split("+"):
        alarms += _missing_plate(current)
    return finished_selection(current, [*comparisons, *further], observations, alarms, notes)


def forward_selection(
    current: Fitted,
    observations: Observations,
    additions: Sequence[str],
    *,
    extend: bool,
    plate_addition: str = "glass",
    on_step: Step = no_step,
) -> tuple[Fitted, list[ModelComparison], list[Alarm], list[str]]:
    """Return the largest supported model, the comparisons made, alarms and notes.

    If the model must not be extended, the first supported addition raises an alarm instead, as do plates that the
    layout lacks. For mirrors without plates, `plate_addition` replaces the addition "sheet".
    """
    comparisons: list[ModelComparison] = []
    alarms: list[Alarm] = []
    notes: list[str] = []
    while remaining := _remaining(current, additions):
        candidates, undetermined = _fit_additions(current, remaining, observations, plate_addition, on_step)
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
        if best is None:
            break
        addition = best.name.removeprefix(f"{current.name}+")
        if addition == "glass" or not extend:
            alarms.append(_alarm(best, addition))
            break
        current = best
    return current, comparisons, alarms, notes


def _remaining(current: Fitted, additions: Sequence[str]) -> list[str]:
    """The additions that a model does not have yet."""
    additions_made = current.name.split("+")
    cameras = further_cameras(current.solution.estimate.camera, additions_made)
    return [
        name for name in additions if name not in additions_made and (name not in CAMERA_ADDITIONS or name in cameras)
    ]


def _fit_additions(
    current: Fitted, remaining: Sequence[str], observations: Observations, plate_addition: str, on_step: Step
) -> tuple[list[Fitted], list[str]]:
    """Fit each further addition; also return a note on each addition that the corners do not determine.

    An addition with a score test is fitted only if that predicts an information gain close to the greatest.
    """
    plates = (current.solution.estimate.thickness_mm > 0.0).any()
    fits, notes = [], []
    causes = ranked_causes(current, observations)
    gains = {cause.addition: cause.gain for cause in reversed(causes)}
    # One picture may be left out later, but a cause that concerns many makes the test of others invalid.
    largest = max((cause.gain for cause in causes if cause.kind != "picture"), default=0.0)
    min_gain = max(MIN_RELATIVE_GAIN * largest, MIN_GAIN)
    tested = [name for name in remaining if name in KIND_OF_ADDITION]
    for name in (name for name in remaining if name not in tested or gains.get(name, 0.0) >= min_gain):
        addition = plate_addition if name == "sheet" and not plates else name
        on_step(f"trying {IN_WORDS[name]}")
        try:
            larger = fit_with(addition, current, observations)
        except UndeterminedError as error:
            notes.append(f"{current.name}+{addition} not tried: {error}")
            continue
        outliers = float((~larger.solution.inliers).mean())
        if outliers > MAX_OUTLIERS:
            notes.append(f"{larger.name} not used: {outliers:.0%} of the corners do not fit it")
            continue
        fits.append(larger)
    return fits, notes


def _missing_plate(fitted: Fitted) -> list[Alarm]:
    thickness_mm, sigma_mm = plate_thickness(fitted)
    if thickness_mm > max(3.0 * sigma_mm, MIN_PLATE_MM):
        return []
    return [OtherSurface(thickness_mm, sigma_mm, is_second_surface=False)]


def _alarm(best: Fitted, addition: str) -> Alarm:
    if addition == "glass":
        return OtherSurface(*plate_thickness(best), is_second_surface=True)
    return f"the data support a larger model, {best.name}"


def finished_selection(
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
    causes = ranked_causes(current, observations)
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
