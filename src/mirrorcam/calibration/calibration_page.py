"""`report.html` of a calibration: one file, readable from disk and offline, with the verdict on top."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.calibration.drawings import (
    board_distances,
    board_tilts,
    coverage_map,
    depth_sigmas,
    projection_sigmas,
    residual_histogram,
    residual_needles,
    view_with_residuals,
)
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.figures.figure_texts import (
    SIGMA,
    SYMBOLS,
    TIMES,
    count_text,
    figure_text,
    sigma_decimals,
    sigma_text,
)
from mirrorcam.core.html.templates import FigureTable, Table, Tile, full_stop, render
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, mirror_sigmas
from mirrorcam.optics.calibration.diagnostics.cause_texts import cause_sentence
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import MirrorUncertainty
from mirrorcam.optics.calibration.diagnostics.model_comparison import SUPPORTED_CHANCE, ModelComparison
from mirrorcam.optics.calibration.diagnostics.score_test import Cause
from mirrorcam.optics.calibration.diagnostics.verdict import STATES, Verdict, check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import (
    ViewFigures,
    board_normals,
    calibrated_views,
    frame_figures,
    view_figures,
)
from mirrorcam.optics.drift.drift import can_test_drift

TEMPLATES = Path(__file__).parent
STATE_CLASSES = {"good": "pass", "look": "care", "stop": "fail"}
UNITS = {"fx_px": "px", "fy_px": "px", "cx_px": "px", "cy_px": "px"}
FIGURES = "plain figures"
WORST_FRAMES = 6
SHOWN_CAUSES = 5


@dataclass(frozen=True)
class Card:
    """A drawing (SVG) and its caption."""

    drawing: str
    caption: str = ""


def write_report(calibration: Calibration, path: Path, *, command: str = "mirrorcam calibrate") -> None:
    """Write the report of a calibration as one HTML file, which states `command`."""
    write_text(path, report_html(calibration, command=command))


def report_html(calibration: Calibration, *, command: str) -> str:
    """Render the page. It is deterministic, and external text is escaped."""
    views = view_figures(calibration)
    verdict = check_solution(calibration, views)
    diagnostics, camera = calibration.diagnostics, calibration.layout.camera
    notes = [*calibration.notes, *(diagnostics.notes if diagnostics else ())]
    return render(
        TEMPLATES,
        "calibration_page.html",
        title=f"Calibration {calibration.layout.identity}",
        command=command,
        state=STATE_CLASSES[verdict.state],
        verdict=STATES[verdict.state],
        reasons=verdict.reasons,
        advice=verdict.advice,
        weakest=diagnostics.weak[0].description if diagnostics is not None and diagnostics.weak else None,
        tiles=_tiles(calibration),
        mirrors=count_text(len(calibration.layout.mirrors), "mirror") if calibration.layout.mirrors else None,
        camera=f"{camera.name}, {camera.width_px} {TIMES} {camera.height_px} px",
        checks=_checks(calibration, verdict),
        views=view_table(views),
        frames=frame_tables(calibration),
        worst=_worst_views(calibration, views),
        causes=None if diagnostics is None else cause_table(calibration, diagnostics.causes),
        mirror_table=mirror_table(calibration) if calibration.layout.mirrors else None,
        camera_table=camera_table(calibration),
        cards=_cards(calibration, views),
        notes=notes,
        diagnostics=None if diagnostics is None else _diagnostics(calibration, diagnostics, views),
        sigma=SIGMA,
    )


def _tiles(calibration: Calibration) -> list[Tile]:
    """Headline figures of a calibration."""
    metrics, diagnostics = calibration.metrics, calibration.diagnostics
    tiles = []
    for name, subject in (("held_out_rms", "frames left out of the fit"), ("rms", "fitted corners")):
        if f"{name}_x_px" in metrics:
            worse = max(metrics[f"{name}_{axis}_px"].value for axis in "xy")
            tiles.append(Tile(f"{figure_text(worse, 3)} px", f"RMS reprojection error per axis, {subject}"))
            break
    if diagnostics is not None:
        tiles.append(Tile(diagnostics.model_name.replace("+", " +\N{NO-BREAK SPACE}"), "selected model"))
        if diagnostics.mirrors is not None:
            normal = float(np.max(diagnostics.mirrors.normal_deg))
            tiles.append(Tile(f"{figure_text(normal, 2)}°", f"{SIGMA} of the least certain mirror normal"))
        if diagnostics.next_picture is not None:
            _, focal_px, focal_sigma_px = _camera_rows(calibration)[0]
            tiles.append(Tile(f"{focal_px} ± {focal_sigma_px} px", "focal length fx"))
            sigma_px = figure_text(diagnostics.next_picture.sigma_px, 2)
            tiles.append(Tile(f"{sigma_px} px", f"projection {SIGMA}, RMS over the picture"))
        depth = float(np.interp(diagnostics.range_mm, diagnostics.depth.range_mm, diagnostics.depth.total_mm))
        if np.isfinite(depth):
            tiles.append(Tile(f"{figure_text(depth, 2)} mm", f"{SIGMA} of depth at {diagnostics.range_mm:.0f} mm"))
    return tiles


def _checks(calibration: Calibration, verdict: Verdict) -> FigureTable:
    """Figures of the verdict and of the calibration, those with limits first."""
    figures = {check.label: check.metric for check in verdict.checks}
    others = {name: metric for name, metric in calibration.metrics.items() if not name.startswith("mirror_")}
    return FigureTable.of({**figures, **others}, {**LABELS, **{label: label for label in figures}})


def _cards(calibration: Calibration, views: Sequence[ViewFigures]) -> dict[str, Card | None]:
    """The drawings of every calibration; that of the direct view is None if there is no such view."""
    mirrors = calibrated_views(views)
    direct = [view for view in views if view not in mirrors]
    tilt_caption = "Tilt of the boards, a dot per frame"
    if not board_normals(calibration)[1].all():
        tilt_caption += f": filled, via the mirrors; open, {direct[0].name}"
    return {
        "residuals": Card(
            residual_needles(calibration, mirrors),
            "Mean residuals, predicted minus detected. Red: significant at the 1 % level, as 1 % are by noise alone.",
        ),
        "histogram": Card(residual_histogram(calibration), "Residuals without outliers; logarithmic counts."),
        "direct": Card(residual_needles(calibration, direct), f"Mean residuals of {direct[0].name_in_sentence}.")
        if direct
        else None,
        "coverage": Card(
            coverage_map(calibration.layout, views),
            "Number of corners per cell, and the coverage of every view."
            if calibration.layout.mirrors
            else f"Number of corners per cell; corners fill {views[0].coverage:.0%} of the picture.",
        ),
        "distances": Card(board_distances(views), "Distance of the board, a dot per frame."),
        "turns": Card(board_tilts(calibration), f"{tilt_caption}."),
    }


def _diagnostics(calibration: Calibration, diagnostics: Diagnostics, views: Sequence[ViewFigures]) -> dict[str, object]:
    """Values of the diagnostics for the page."""
    has_depth = np.isfinite(diagnostics.depth.total_mm).sum() >= 2
    free = diagnostics.free_views
    return {
        "common": None if diagnostics.mirrors is None else common_table(diagnostics.mirrors),
        "next": None if diagnostics.next_picture is None else full_stop(diagnostics.next_picture.sentence),
        "tilt": figure_text(HARDWARE.mount.tilt_deg, 2),
        "weak": weak_table(diagnostics) if diagnostics.weak else None,
        "projection": _projection(calibration, diagnostics, views),
        "depth": Card(depth_sigmas(diagnostics.depth, diagnostics.range_mm)) if has_depth else None,
        "models": model_table(diagnostics),
        "free": None
        if free is None
        else {
            "parameters": free.parameters,
            "unexplained": figure_text(free.unexplained_px, 2),
            "chance": chance_words(free.chance),
        },
        "splits": split_table(diagnostics) if diagnostics.splits else None,
        "drift": can_test_drift(calibration.layout),
        "printed": calibration.layout.spec is not None,
    }


def _projection(calibration: Calibration, diagnostics: Diagnostics, views: Sequence[ViewFigures]) -> list[Card]:
    """Maps of the standard deviation of projected points, in the rig frame and relative to the reference view.

    Those of a bare camera are in its own frame, and apart from its rotation.
    """
    shown = [view.view for view in calibrated_views(views)]
    maps = [projection_map for projection_map in diagnostics.projection if projection_map.view in shown]
    direct = [view.in_rig_px for view in diagnostics.projection if view.view not in shown]
    direct_note = ""
    if direct:
        direct_note = (
            f" The direct view, not shown, has a median of {np.median(direct):.2g} px over the complete picture."
        )
    reference = next(view.name_in_sentence for view in views if view.view == diagnostics.reference)
    relative = f"of a point fixed where {reference} shows it, which determines depth"
    if diagnostics.mirrors is None:
        relative = "of a point fixed in front of the camera, apart from a rotation of the camera"
    cards = []
    for name, values, description, suffix in (
        (
            "rig",
            [projection_map.in_rig_px for projection_map in maps],
            "of a point fixed in front of the camera",
            direct_note,
        ),
        (
            "reference",
            [projection_map.against_reference_px for projection_map in maps],
            relative,
            "",
        ),
    ):
        max_sigma = float(np.max(np.concatenate(values)))
        medians = "medians" if diagnostics.mirrors is not None else f"the median is {np.median(values[0]):.2g} px"
        cards.append(
            Card(
                projection_sigmas(calibration.layout, views, maps, values, max_sigma, name=f"sigma-{name}"),
                f"{SIGMA} px {description}, {diagnostics.range_mm:.0f} mm away: {medians}; the strongest colour is "
                f"{max_sigma:.2g} px.{suffix}",
            )
        )
    return cards


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


def frame_tables(calibration: Calibration) -> list[Table]:
    """Corners and residuals of every frame, the worst first: a table of the worst, and one of the others."""
    heads = ("Picture", "Views", "Corners", "Outliers", "RMS px", f"RMS {SIGMA}")
    rows = [
        (
            frame.name,
            str(frame.views),
            f"{frame.corners:,}",
            str(frame.outliers),
            f"{frame.rms_px:.4f}",
            f"{frame.rms_sigmas:.2f}",
        )
        for frame in frame_figures(calibration)
    ]
    return [Table(heads, part, FIGURES) for part in (rows[:WORST_FRAMES], rows[WORST_FRAMES:]) if part]


def cause_table(calibration: Calibration, causes: Sequence[Cause]) -> Table | None:
    """The causes of a misfit, the most probable first."""
    if not causes:
        return None
    rows = [
        (
            full_stop(cause_sentence(cause, calibration)),
            f"{cause.gain:.0f}",
            figure_text(cause.bias_sigmas, 2) if cause.bias_sigmas else "unknown",
        )
        for cause in causes[:SHOWN_CAUSES]
    ]
    shifted = "mirrors" if calibration.layout.mirrors else "camera"
    return Table(("Cause", "Gain", f"Shift of the {shifted}, {SIGMA}"), rows, "plain words")


def _worst_views(calibration: Calibration, views: Sequence[ViewFigures]) -> list[Card]:
    """The views with the largest residuals, drawn into their pictures."""
    names = {view.view: view.name for view in views}
    return [
        Card(
            view_with_residuals(calibration, view, f"worst-{number}"),
            f"{calibration.picture_names[view.frame]}{', ' + names[view.view] if len(views) > 1 else ''}",
        )
        for number, view in enumerate(calibration.worst_views)
    ]


def mirror_table(calibration: Calibration) -> Table:
    """Distance and direction of every mirror with their sigmas; with diagnostics, also relative to the others."""
    heads = ["Mirror", "Distance mm", f"{SIGMA} mm", f"{SIGMA} of direction °"]
    mirrors, diagnostics = calibration.layout.mirrors, calibration.diagnostics
    if diagnostics is None or diagnostics.mirrors is None:
        sigmas: list[tuple[float, ...]] = [
            (distance, float(np.degrees(tilt))) for tilt, distance in mirror_sigmas(calibration.layout)
        ]
    else:
        heads += [f"{SIGMA} against the others mm", f"{SIGMA} against the others °"]
        uncertainty = diagnostics.mirrors
        columns = (
            uncertainty.distance_mm,
            uncertainty.normal_deg,
            uncertainty.relative_distance_mm,
            uncertainty.relative_normal_deg,
        )
        sigmas = [tuple(float(column[number]) for column in columns) for number in range(len(mirrors))]
    decimals = max(sigma_decimals(distance) or 3 for distance, *_ in sigmas)
    rows = [
        (f"mirror {name}", f"{mirror.distance_mm:.{decimals}f}", *(sigma_text(sigma) for sigma in sigmas_of_mirror))
        for name, mirror, sigmas_of_mirror in zip(calibration.layout.mirror_names, mirrors, sigmas, strict=True)
    ]
    return Table(heads, rows, FIGURES)


def common_table(uncertainty: MirrorUncertainty) -> Table:
    """Sigmas of the common rotation and translation of all mirrors."""
    rows = [
        ("rotation, °", *(sigma_text(float(value)) for value in uncertainty.common_rotation_deg)),
        ("shift, mm", *(sigma_text(float(value)) for value in uncertainty.common_shift_mm)),
    ]
    return Table(("", "x, image right", "y, image down", "z, optical axis"), rows, FIGURES)


def weak_table(diagnostics: Diagnostics) -> Table:
    """The combinations of parameters that the pictures determine least."""
    rows = [
        (full_stop(direction.description), "; ".join(_amount(*sigma) for sigma in direction.sigmas))
        for direction in diagnostics.weak
    ]
    return Table(("Direction", f"One {SIGMA} of it"), rows, "plain words")


def _amount(name: str, value: float, unit: str) -> str:
    return f"{name} {sigma_text(value)}{SYMBOLS.get(unit, f' {unit}')}".rstrip()


def camera_table(calibration: Calibration) -> Table:
    """The intrinsics of the camera and its pupil with their sigmas."""
    rows = _camera_rows(calibration)
    if calibration.layout.mirrors or calibration.layout.camera.aperture_mm > 0.0:  # else nothing is known of the pupil
        rows += _pupil_rows(calibration)
    return Table(("Number", "Value", SIGMA), rows, FIGURES)


def _camera_rows(calibration: Calibration) -> list[list[str]]:
    uncertainty = calibration.layout.uncertainty
    sigmas: dict[str, float] = {}
    if uncertainty is not None:
        sigmas = dict(zip(uncertainty.parameters, np.sqrt(np.diag(uncertainty.covariance)).tolist(), strict=True))
    rows = []
    camera = calibration.layout.camera
    for name, value in zip(camera.intrinsic_names, camera.intrinsics, strict=True):
        if name.startswith("field "):  # hundreds of values, which the maps show better
            continue
        unit = UNITS.get(name, "")
        sigma = sigma_text(sigmas[name]) if name in sigmas else "held"
        rows.append([f"{name.removesuffix('_px')} {unit}".strip(), f"{value:.3f}" if unit else f"{value:.6f}", sigma])
    return rows


def _pupil_rows(calibration: Calibration) -> list[list[str]]:
    """Diameter of the pupil and reciprocal of the focus distance; "held" if the frames do not determine them."""
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
    """The models that were compared, the selected one in bold."""
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
    return Table(
        heads, [_model_row(comparison, diagnostics.model_name) for comparison in diagnostics.comparisons], FIGURES
    )


def _model_row(comparison: ModelComparison, selected_name: str) -> tuple[str, ...]:
    nested_columns = ("", "", "", "")
    if comparison.against is not None:
        drop, chance = figure_text(comparison.drop, 3), chance_text(comparison.chance)
        nested_columns = (comparison.against, drop, chance, _held_out(comparison))
    selected = comparison.name == selected_name
    return (
        Markup("<b>{}</b>").format(comparison.name) if selected else comparison.name,
        str(comparison.parameters),
        f"{comparison.rms_px:.4f}",
        *nested_columns,
        f"{comparison.held_out_gain:.1f} {SIGMA}" if np.isfinite(comparison.held_out_gain) else "",
        _state(comparison, selected_name),
    )


def _held_out(comparison: ModelComparison) -> str:
    if np.isfinite(comparison.held_out_rms_px):
        return figure_text(comparison.held_out_rms_px, 4)
    return "open" if comparison.chance < SUPPORTED_CHANCE and comparison.information_gain > 0.0 else "not needed"


def _state(comparison: ModelComparison, selected_name: str) -> str:
    if comparison.name == selected_name:
        return Markup('<b class="pass">selected</b>')
    if comparison.name == "paper" or selected_name.startswith(f"{comparison.name}+"):
        return "nested"
    return Markup('<b class="fail">supported</b>') if comparison.supported else "no"


def split_table(diagnostics: Diagnostics) -> Table:
    """Difference between calibrations of two halves of the frames, next to the predicted difference."""
    heads = ("Halves", "Frames", "Max. difference px", "Max. predicted px", "Overall ratio", "p")
    rows = [
        (
            split.division,
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
    """A probability for a sentence: "p < 0.001", "p = 0.120"."""
    text = chance_text(value)
    return f"p {text}" if text.startswith("<") else f"p = {text}"
