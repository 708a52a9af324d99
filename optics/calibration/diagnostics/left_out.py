"""What is gained by leaving out pictures that contradict the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.corner_noise import correlated_errors
from mirrorcam.optics.calibration.diagnostics.model_comparison import frames_of
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as
from mirrorcam.optics.calibration.diagnostics.score_test import Cause
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Observations

MAX_PICTURES = 3
"""Maximum number of pictures to leave out: if more contradict the others, no single picture is the cause."""


@dataclass(frozen=True)
class LeftOut:
    """Pictures that contradict the others, and the fit without them.

    Attributes
    ----------
    frames
        Numbers of the frames, the worst first.
    rms_px
        RMS residual of the fit with all pictures and without these, of both axes.
    sigma_ratio
        Standard deviations of the mirrors (of a bare camera, its intrinsics) without these pictures, relative to those
        with all.
    """

    frames: tuple[int, ...]
    rms_px: tuple[float, float]
    sigma_ratio: float


def left_out(fitted: Fitted, causes: Sequence[Cause], observations: Observations) -> LeftOut | None:
    """Leave out the picture that is the first cause of a misfit, fit again, and so on; None if no picture is.

    Parameters
    ----------
    fitted
        The fit of all pictures.
    causes
        The ranked causes of its misfit.
    observations
        The corners of all pictures.
    """
    numbers = np.arange(len(fitted.solution.estimate.rig_from_board))
    left: list[int] = []
    current, rows = fitted, observations
    while causes and causes[0].frame is not None and causes[0].kind == "picture" and len(left) < MAX_PICTURES:
        kept = np.arange(len(numbers)) != causes[0].frame
        further, start = frames_of(rows, current.solution.estimate, kept)
        try:
            current = fit_as(fitted.name, start, further, fitted.model)
        except UndeterminedError:
            break
        left.append(int(numbers[causes[0].frame]))
        numbers, rows = numbers[kept], further
        causes = ranked_causes(current, rows)
    if not left:
        return None
    ratio = _typical_sigma(current, rows) / _typical_sigma(fitted, observations)
    return LeftOut(tuple(left), (_rms_px(fitted), _rms_px(current)), ratio)


def _rms_px(fitted: Fitted) -> float:
    return float(np.sqrt(np.mean(np.square(fitted.solution.rms_px))))


def _typical_sigma(fitted: Fitted, observations: Observations) -> float:
    """RMS standard deviation of the mirrors' parameters, with correlated errors of corners taken into account.

    For a bare camera, the geometric mean of those of the intrinsics, which differ in unit.
    """
    solution = fitted.solution
    mirrors = [name.startswith("mirror ") for name in solution.parameters]
    inflation = correlated_errors(solution, observations, fitted.model).inflation
    if not any(mirrors):
        variances = np.diag(solution.covariance)[: len(fitted.model.intrinsics)]
        return inflation * float(np.exp(0.5 * np.mean(np.log(variances))))
    return inflation * float(np.sqrt(np.mean(np.diag(solution.covariance)[mirrors])))
