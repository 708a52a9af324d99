"""Verdict on a calibration from labels, in words and figures, with advice."""

from __future__ import annotations

from collections import Counter

import numpy as np

from mirrorcam.core.figures.figure_texts import SIGMA, figure_text
from mirrorcam.core.values import Metric
from mirrorcam.optics.calibration.diagnostics.verdict import Check, State, Verdict
from mirrorcam.optics.calibration.labels.label_result import LabelCalibration

MAX_REJECTED = 0.25
MAX_FOCAL_SIGMA = 0.03
MAX_NORMAL_SIGMA_DEG = 1.0
MAX_UNEXPLAINED = 0.5  # error that plane mirrors leave, relative to the noise of the labels
MAX_SPREAD = 2.0
CHANCE = 1e-4


def label_verdict(result: LabelCalibration) -> Verdict:
    """Return the verdict: mirrors that are not plane mirrors forbid use, other figures call for inspection."""
    planes = _plane_check(result)
    checks = (planes, _rejected_check(result), *_split_checks(result), *_uncertainty_checks(result))
    failed = [check for check in checks if not check.metric.passed]
    state: State = "stop" if not planes.metric.passed else "look" if failed else "good"
    reasons = tuple(check.reason for check in failed)
    return Verdict(state, reasons, tuple(check.advice for check in failed), checks)


def _plane_check(result: LabelCalibration) -> Check:
    free, noise_px = result.free, result.calibration.metrics["label_sigma_px"].value
    unexplained = free.unexplained_px / noise_px if free.chance < CHANCE else 0.0
    worst = int(np.abs(free.turn_deg).max(axis=1).argmax())
    return Check(
        "Error that free cameras explain and plane mirrors do not, relative to the noise",
        Metric(value=unexplained, unit="1", limit=MAX_UNEXPLAINED),
        f"plane mirrors of one camera do not explain the labels: {free.unexplained_px:.2g} px remain, most in view "
        f"{result.table.views[1 + worst]!r}, turned by {np.abs(free.turn_deg[worst]).max():.2g}°",
        "Check that all labels are in pixels of the whole frame, not cropped, flipped or scaled, that the camera is "
        "the one given, and that neither camera nor mirrors moved.",
    )


def _rejected_check(result: LabelCalibration) -> Check:
    rejected = len(result.rejected) / len(result.calibration.observations)
    counts = Counter((item.label, item.view) for item in result.rejected)
    (label, view), count = counts.most_common(1)[0] if counts else ((0, 0), 0)
    return Check(
        "Labels that contradict others",
        Metric(value=rejected, unit="of the labels", limit=MAX_REJECTED),
        f"{rejected:.0%} of the labels contradict others",
        f"Look at {result.table.labels[label]!r} in view {result.table.views[1 + view]!r} first, with {count} of them: "
        "labels.csv lists all.",
    )


def _split_checks(result: LabelCalibration) -> list[Check]:
    advice = {
        "by frame": "Look for what moved between the frames: the camera, a mirror, or the zoom.",
        "by label": "Label points that are the same spot from all sides, like the tip of the nose or the tail: the two "
        "sides of a paw are two points.",
    }
    return [
        Check(
            f"Labels split {split.division}: difference relative to the predicted one",
            Metric(value=split.ratio, unit="1", limit=split.limit),
            f"split {split.division}, calibrations differ by {split.ratio:.1f} times the prediction",
            advice[split.division],
        )
        for split in result.splits
    ]


def _uncertainty_checks(result: LabelCalibration) -> list[Check]:
    layout, metrics = result.layout, result.calibration.metrics
    normals = [metrics[f"mirror_{m}_normal_sigma_deg"].value for m in range(len(layout.mirrors))]
    worst = int(np.argmax(normals))
    checks = [
        Check(
            f"{SIGMA} of the least certain mirror normal",
            Metric(value=normals[worst], unit="deg", limit=MAX_NORMAL_SIGMA_DEG),
            f"the mirror {result.table.views[1 + worst]!r} is known to {figure_text(normals[worst], 2)}° only",
            "Label more frames, with the animal at many places, in the direct view and in this mirror.",
        )
    ]
    uncertainty = layout.uncertainty
    if uncertainty is not None and "fx_px" in uncertainty.parameters:
        index = uncertainty.parameters.index("fx_px")
        relative = float(np.sqrt(uncertainty.covariance[index, index])) / layout.camera.fx_px
        checks.append(
            Check(
                f"{SIGMA} of the focal length",
                Metric(value=relative, unit="of it", limit=MAX_FOCAL_SIGMA),
                f"the focal length is known to {relative:.0%} only, and depths with it",
                "Calibrate the camera with a board and give it with --camera, or state its angle with --field-of-view.",
            )
        )
    if result.spread > 1.0:
        checks.append(
            Check(
                "Variation of the known length between frames, relative to the noise",
                Metric(value=result.spread, unit="1", limit=MAX_SPREAD),
                f"the known length varies between frames by {result.spread:.1f} times its noise",
                "Give a length that is rigid, or the distance from the camera to a mirror.",
            )
        )
    return checks
