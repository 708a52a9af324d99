"""Tables of a calibration's report: views, mirrors, camera, models and halves of the frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from mirrorcam.core.figures.figure_texts import SIGMA, SYMBOLS, figure_text, sigma_decimals, sigma_text
from mirrorcam.core.html.templates import Table, full_stop
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, mirror_sigmas
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.model_comparison import SUPPORTED_CHANCE, ModelComparison
from mirrorcam.optics.calibration.diagnostics.view_statistics import ViewFigures

UNITS = {"fx_px": "px", "fy_px": "px", "cx_px": "px", "cy_px": "px"}
FIGURES = "plain figures"


def view_table(views: Sequence[ViewFigures]) -> Table:
    """Frames, corners and residuals of every view."""
    rows = [
        (
            view.name,
            str(view.frames),
            f"{view.corners:,}",
            str(view.outliers),
            *(f"{value:.4f}" if np.isfinite(value) else "none" for value in view.rms_px),
        )
        for view in views
    ]
    return Table(("View", "Frames", "Corners", "Outliers", "RMS x px", "RMS y px"), rows, FIGURES)


def mirror_table(calibration: Calibration) -> Table:
    """Distance of every mirror with its sigma, and that of its direction; with diagnostics, also against the others."""
    heads = ["Mirror", "Distance mm", f"{SIGMA} mm", f"{SIGMA} of direction °"]
    mirrors, diagnostics = calibration.layout.mirrors, calibration.diagnostics
    if diagnostics is None:
        sigmas: list[tuple[float, ...]] = [
            (distance, float(np.degrees(tilt))) for tilt, distance in mirror_sigmas(calibration.layout)
        ]
    else:
        heads += [f"{SIGMA} against the others mm", f"{SIGMA} against the others °"]
        known = diagnostics.mirrors
        columns = (known.distance_mm, known.normal_deg, known.relative_distance_mm, known.relative_normal_deg)
        sigmas = [tuple(float(column[number]) for column in columns) for number in range(len(mirrors))]
    decimals = max(sigma_decimals(distance) or 3 for distance, *_ in sigmas)
    rows = [
        (f"mirror {name}", f"{mirror.distance_mm:.{decimals}f}", *(sigma_text(sigma) for sigma in known_to))
        for name, mirror, known_to in zip(calibration.layout.mirror_names, mirrors, sigmas, strict=True)
    ]
    return Table(heads, rows, FIGURES)


def common_table(diagnostics: Diagnostics) -> Table:
    """Sigmas of a turn and a shift of all mirrors together."""
    known = diagnostics.mirrors
    rows = [
        ("turn, °", *(sigma_text(float(value)) for value in known.common_turn_deg)),
        ("shift, mm", *(sigma_text(float(value)) for value in known.common_shift_mm)),
    ]
    return Table(("", "x, image right", "y, image down", "z, optical axis"), rows, FIGURES)


def weak_table(diagnostics: Diagnostics) -> Table:
    """The combinations of parameters that the pictures determine least."""
    rows = [
        (full_stop(direction.words), "; ".join(_amount(*sigma) for sigma in direction.sigmas))
        for direction in diagnostics.weak
    ]
    return Table(("Direction", f"One {SIGMA} of it"), rows, "plain words")


def _amount(name: str, value: float, unit: str) -> str:
    return f"{name} {sigma_text(value)}{SYMBOLS.get(unit, f' {unit}')}".rstrip()


def camera_table(calibration: Calibration) -> Table:
    """The intrinsics of the camera and its pupil with their sigmas."""
    return Table(("Number", "Value", SIGMA), [*_camera_rows(calibration), *_pupil_rows(calibration)], FIGURES)


def _camera_rows(calibration: Calibration) -> list[list[str]]:
    known = calibration.layout.uncertainty
    sigmas: dict[str, float] = {}
    if known is not None:
        sigmas = dict(zip(known.parameters, np.sqrt(np.diag(known.covariance)).tolist(), strict=True))
    rows = []
    camera = calibration.layout.camera
    for name, value in zip(camera.intrinsic_names, camera.intrinsics, strict=True):
        if name.startswith("field "):  # hundreds of numbers, which the maps of the views show better
            continue
        unit = UNITS.get(name, "")
        sigma = sigma_text(sigmas[name]) if name in sigmas else "held"
        rows.append([f"{name.removesuffix('_px')} {unit}".strip(), f"{value:.3f}" if unit else f"{value:.6f}", sigma])
    return rows


def _pupil_rows(calibration: Calibration) -> list[list[str]]:
    """Diameter of the pupil and one over the distance in focus; held where the frames do not show them."""
    camera, metrics = calibration.layout.camera, calibration.metrics
    figures = (
        ("pupil mm", f"{camera.aperture_mm:.3f}", "aperture_sigma_mm"),
        ("1 / focus 1/m", f"{1e3 / camera.focus_mm:.3f}", "focus_sigma_per_m"),
    )
    return [
        [name, value, sigma_text(metrics[sigma].value) if sigma in metrics else "held"]
        for name, value, sigma in figures
    ]


def model_table(diagnostics: Diagnostics) -> Table:
    """The models that were compared, and which one was taken."""
    heads = (
        "Model",
        "Parameters",
        "RMS px",
        "Compared with",
        f"Cost decrease, {SIGMA}²",
        "p",
        "Held out px",
        "Better by",
        "",
    )
    return Table(heads, [_model_row(each, diagnostics.level) for each in diagnostics.comparisons], FIGURES)


def _model_row(comparison: ModelComparison, level: str) -> tuple[str, ...]:
    against = ("", "", "", "")
    if comparison.against is not None:
        drop, chance = figure_text(comparison.drop, 3), chance_text(comparison.chance)
        against = (comparison.against, drop, chance, _held_out(comparison))
    taken = comparison.name == level
    return (
        Markup("<b>{}</b>").format(comparison.name) if taken else comparison.name,
        str(comparison.parameters),
        f"{comparison.rms_px:.4f}",
        *against,
        f"{comparison.held_out_gain:.1f} {SIGMA}" if np.isfinite(comparison.held_out_gain) else "",
        _taken(comparison, level),
    )


def _held_out(comparison: ModelComparison) -> str:
    if np.isfinite(comparison.held_out_rms_px):
        return figure_text(comparison.held_out_rms_px, 4)
    return "open" if comparison.chance < SUPPORTED_CHANCE and comparison.information_gain > 0.0 else "not needed"


def _taken(comparison: ModelComparison, level: str) -> str:
    if comparison.name == level:
        return Markup('<b class="pass">selected</b>')
    if comparison.name == "paper" or level.startswith(f"{comparison.name}+"):
        return "nested"
    return Markup('<b class="fail">supported</b>') if comparison.supported else "no"


def split_table(diagnostics: Diagnostics) -> Table:
    """Difference of calibrations of two halves of the frames, against the one that their uncertainty predicts."""
    heads = ("Halves", "Frames", "Max. difference px", "Max. predicted px", "Overall ratio", "p")
    rows = [
        (
            split.how,
            f"{split.frames[0]} and {split.frames[1]}",
            f"{np.max(split.difference_px):.3g}",
            f"{np.max(split.predicted_px):.3g}",
            f"{split.overall_ratio:.2f}",
            chance_text(split.overall_chance),
        )
        for split in diagnostics.splits
    ]
    return Table(heads, rows, FIGURES)


def chance_text(value: float) -> str:
    """A probability to three decimals."""
    return "< 0.001" if value < 1e-3 else f"{value:.3f}"


def chance_words(value: float) -> str:
    """A probability as in a sentence: "p < 0.001", "p = 0.120"."""
    text = chance_text(value)
    return f"p {text}" if text.startswith("<") else f"p = {text}"
