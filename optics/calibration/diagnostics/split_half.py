"""Split-half test: whether halves of the frames, calibrated separately, agree within their uncertainties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from shapely import MultiPoint, contains_xy

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.model_comparison import (
    balanced_folds,
    frames_of,
    is_mirrored,
    split_by_distance,
)
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    NEGLIGIBLE_PX,
    grid_points,
    project_points,
    relative_derivatives,
    uncertainty_of,
    views_of,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution, UndeterminedError, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Estimate, global_names
from mirrorcam.optics.geometry.layout import Layout

ALARM_RATIO = 2.0
ALARM_CHANCE = 1e-3
HARMLESS_PX = 0.02
"""Largest difference in a sub-image that raises no alarm, as the bounds allow for it."""
MIN_HALF = 3
"""Minimum number of mirrored frames in a half."""


@dataclass(frozen=True)
class Split:
    """Comparison of two halves of the frames, calibrated separately.

    Attributes
    ----------
    key
        Name of the split in metrics.
    division
        How the frames are split, as text for messages.
    views
        Names of the views (m): the mirrors, or the picture of a bare camera.
    frames
        Number of frames in each half.
    difference_px, predicted_px, chance
        Rms over each mirror's sub-image (m,) at the working distance: the difference between the halves, the difference
        predicted by both covariances, and the probability of a larger difference if both are right.
    relative_difference_px, relative_predicted_px, relative_chance
        The same for points fixed in the reference view.
    overall_ratio, overall_chance
        Over all parameters: the rms difference in standard deviations (1 on average), and its probability.
    """

    key: str
    division: str
    views: tuple[str, ...]
    frames: tuple[int, int]
    difference_px: FloatArray
    predicted_px: FloatArray
    chance: FloatArray
    relative_difference_px: FloatArray
    relative_predicted_px: FloatArray
    relative_chance: FloatArray
    overall_ratio: float
    overall_chance: float

    @property
    def ratio(self) -> FloatArray:
        """Difference relative to the predicted difference (m,) of each view."""
        return self.difference_px / self.predicted_px

    @property
    def relative_ratio(self) -> FloatArray:
        """The same relative to the reference view (m,); NaN for that view itself."""
        predicted = self.relative_predicted_px
        return np.divide(
            self.relative_difference_px, predicted, out=np.full(len(predicted), np.nan), where=predicted > 0
        )

    @property
    def _worst(self) -> tuple[float, str]:
        """The largest ratio that is both large and improbable, and a description; (1, "") if there is none."""
        max_chance = ALARM_CHANCE / len(self.chance)
        ratios = [(self.overall_ratio, self.overall_chance < ALARM_CHANCE, "the halves differ overall")]
        for suffix, ratios_by_view, chances, differences in (
            ("", self.ratio, self.chance, self.difference_px),
            (" against the reference view", self.relative_ratio, self.relative_chance, self.relative_difference_px),
        ):
            worst = int(np.argmax(np.nan_to_num(ratios_by_view)))
            description = f"{self.views[worst]} differs by {differences[worst]:.2g} px{suffix}"
            ratios.append((float(np.nan_to_num(ratios_by_view[worst])), bool(chances[worst] < max_chance), description))
        alarming = [
            (ratio, description) for ratio, is_unlikely, description in ratios if ratio > ALARM_RATIO and is_unlikely
        ]
        return max(alarming, default=(1.0, ""))

    @property
    def alarm(self) -> str | None:
        """Description of differences above `ALARM_RATIO` times the prediction; None if there are none."""
        ratio, description = self._worst
        if not description:
            return None
        return f"split {self.division}, {description}: {ratio:.1f} times what the halves' uncertainties predict"

    @property
    def is_harmful(self) -> bool:
        """Whether the alarm concerns differences of a size that matters."""
        return self.alarm is not None and bool((self.difference_px > HARMLESS_PX).any())

    @property
    def inflation(self) -> float:
        """Factor by which standard deviations are too small to explain the alarm; 1 without an alarm."""
        return self._worst[0]


def splits(
    solution: Solution,
    observations: Observations,
    model: Model,
    layout: Layout,
    *,
    reference: int,
    range_mm: float,
) -> tuple[tuple[Split, ...], tuple[str, ...]]:
    """Split a calibration's frames into similar halves, and into near and far boards, and compare the halves.

    A wrong model fits near and far boards differently. The predicted difference is for independent corner errors,
    without the inflation of `layout`'s uncertainties: a larger difference is an error of the model even if they allow
    for it.

    Parameters
    ----------
    solution, observations, model
        Fit of all frames.
    layout
        The calibrated layout, with covariance.
    reference
        View that the others are measured against: a mirror's index, or DIRECT.
    range_mm
        Distance at which views are compared, mm.

    Returns
    -------
    splits, notes
        A split is left out, with a note, if a half has fewer than `MIN_HALF` mirrored frames or does not determine the
        camera.
    """
    if solution.sigma_px < NEGLIGIBLE_PX:
        return (), ("not split: the corners have no noise to compare halves by",)
    rows = observations.where(solution.inliers)
    derivatives = [_derivatives(layout, view, reference, range_mm, rows) for view in views_of(layout)]
    compared, notes = [], []
    for key, division, part in (
        ("halves", "into similar halves", balanced_folds(solution.estimate, rows, model.board, 2)),
        ("near", "into near and far boards", split_by_distance(solution.estimate, rows, model.board)),
    ):
        mirrored = is_mirrored(rows, len(part))
        if min(np.sum(mirrored & (part == half)) for half in (0, 1)) < MIN_HALF:
            kind = "mirrored frames" if layout.mirrors else "pictures"
            notes.append(f"not split {division}: a half would have under {MIN_HALF} {kind}")
            continue
        try:
            halves = [_half(solution.estimate, rows, model, part == half) for half in (0, 1)]
        except UndeterminedError as error:
            unknown = "camera and mirrors" if layout.mirrors else "the camera"
            notes.append(f"not split {division}: a half does not determine {unknown} ({error})")
            continue
        compared.append(_compare((key, division), halves, layout, derivatives))
    return tuple(compared), tuple(notes)


def _half(estimate: Estimate, observations: Observations, model: Model, frames: BoolArray) -> Solution:
    rows, start = frames_of(observations, estimate, frames)
    return fit(start, rows, model)


def _derivatives(
    layout: Layout, view: int, reference: int, range_mm: float, rows: Observations
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n, 2, g) of pixels with respect to the parameters: for points fixed in rig and in the reference.

    A bare camera is compared apart from its rotation (`relative_derivatives`) in both, where its pictures show corners.
    """
    pixels, points = grid_points(layout, view, range_mm)
    if not layout.mirrors:
        points = points[contains_xy(MultiPoint(rows.pixels).convex_hull, pixels[:, 0], pixels[:, 1])]
    projected = project_points(layout, view, points)
    relative = relative_derivatives(layout, reference, points, projected)
    if not layout.mirrors:
        return relative, np.zeros_like(relative)
    return projected.d_parameter, relative


def _compare(
    split: tuple[str, str],
    halves: Sequence[Solution],
    layout: Layout,
    derivatives: Sequence[tuple[FloatArray, FloatArray]],
) -> Split:
    a, b = halves
    names = uncertainty_of(layout).parameters
    columns = [a.parameters.index(name) for name in names]
    difference = (global_values(a.estimate) - global_values(b.estimate))[_columns(a, names)]
    covariance = (a.covariance + b.covariance)[np.ix_(columns, columns)]
    views = [[_quadratic(d, difference, covariance) for d in view_derivatives] for view_derivatives in derivatives]
    rig_figures, reference_figures = np.array(views).transpose(1, 2, 0)
    squared = float(difference @ np.linalg.solve(covariance, difference))
    return Split(
        key=split[0],
        division=split[1],
        views=tuple(f"mirror {name}" for name in layout.mirror_names) or ("the picture",),
        frames=(len(a.estimate.rig_from_board), len(b.estimate.rig_from_board)),
        difference_px=rig_figures[0],
        predicted_px=rig_figures[1],
        chance=rig_figures[2],
        relative_difference_px=reference_figures[0],
        relative_predicted_px=reference_figures[1],
        relative_chance=reference_figures[2],
        overall_ratio=float(np.sqrt(squared / len(names))),
        overall_chance=float(chi2.sf(squared, len(names))),
    )


def _quadratic(derivatives: FloatArray, difference: FloatArray, covariance: FloatArray) -> tuple[float, float, float]:
    """Rms of derivatives (n, 2, g) times a difference (g,), its prediction by the covariance, and its probability.

    The squared rms is a sum of squared normal variables with unequal variances; its distribution is approximated by the
    scaled chi-squared distribution with the same mean and variance (Satterthwaite 1946).
    """
    flat = derivatives.reshape(-1, derivatives.shape[-1]) * np.sqrt(2.0 / derivatives[..., 0].size)
    squared = float(np.sum((flat @ difference) ** 2))
    weighted = (flat.T @ flat) @ covariance
    mean, variance = float(np.trace(weighted)), float(np.sum(weighted * weighted.T))
    if mean <= 1e-18:  # the reference view against itself
        return 0.0, 0.0, 1.0
    degrees_of_freedom = mean**2 / variance
    return (
        float(np.sqrt(squared)),
        float(np.sqrt(mean)),
        float(chi2.sf(squared / mean * degrees_of_freedom, degrees_of_freedom)),
    )


def global_values(estimate: Estimate) -> FloatArray:
    """Values of an estimate in the order of `global_names`, with the mean plate thickness instead of its correction."""
    plates = estimate.thickness_mm[estimate.thickness_mm > 0.0]
    return np.concatenate(
        [
            estimate.camera.intrinsics,
            estimate.virtual_centres_in_rig_mm.ravel(),
            estimate.curvature_per_m.ravel(),
            [plates.mean() if plates.size else 0.0],
            estimate.shape,
        ]
    )


def _columns(solution: Solution, names: Sequence[str]) -> list[int]:
    estimate = solution.estimate
    mirrors = len(estimate.virtual_centres_in_rig_mm)
    all_names = global_names(estimate.camera.intrinsic_names, mirrors, estimate.shape.size)
    return [all_names.index(name) for name in names]
