"""`report.html` of a calibration from labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.calibration.calibration_page import (
    FIGURES,
    STATE_CLASSES,
    TEMPLATES,
    Card,
    camera_table,
    mirror_table,
    view_table,
)
from mirrorcam.calibration.drawings import coverage_map, residual_histogram, residual_needles
from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.figures.figure_texts import SIGMA, TIMES, count_text, figure_text
from mirrorcam.core.html.templates import FigureTable, Table, Tile, render
from mirrorcam.optics.calibration.diagnostics.verdict import STATES, Verdict
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.calibration.labels.label_result import LabelCalibration
from mirrorcam.optics.calibration.labels.label_verdict import label_verdict
from mirrorcam.optics.calibration.solver.observations import DIRECT

MAX_LISTED = 20
"""Wrong labels that the report lists; labels.csv has all."""


def label_report(result: LabelCalibration, *, command: str) -> str:
    """Render the page. It is deterministic, and external text is escaped."""
    calibration = result.calibration
    verdict = label_verdict(result)
    names = result.layout.mirror_names
    views = [
        view
        if view.view == DIRECT
        else replace(view, name=f"mirror {names[view.view]} ({result.table.views[1 + view.view]})")
        for view in view_figures(calibration)
    ]
    mirrors, direct = [v for v in views if v.view != DIRECT], [v for v in views if v.view == DIRECT]
    camera = result.layout.camera
    return render(
        TEMPLATES,
        "label_page.html",
        title=f"Calibration {result.layout.identity}",
        command=command,
        state=STATE_CLASSES[verdict.state],
        verdict=STATES[verdict.state],
        reasons=verdict.reasons,
        advice=verdict.advice,
        tiles=_tiles(result),
        summary=f"{count_text(len(mirrors), 'mirror')} from {count_text(len(calibration.observations), 'label')}, "
        f"{camera.width_px} {TIMES} {camera.height_px} px",
        checks=_checks(result, verdict),
        views=view_table(views),
        labels=_label_table(result),
        rejected=_rejected_table(result) if result.rejected else None,
        rejected_count=count_text(len(result.rejected), "label"),
        mirror_table=mirror_table(calibration),
        free=_free_table(result),
        camera_table=camera_table(calibration),
        residuals=Card(residual_needles(calibration, mirrors), "Mean residuals, predicted minus labelled."),
        direct=Card(residual_needles(calibration, direct), "Mean residuals of the direct view."),
        histogram=Card(residual_histogram(calibration), "Residuals of the labels used; logarithmic counts."),
        coverage=Card(coverage_map(result.layout, views), "Number of labels per cell, and the coverage of every view."),
        notes=calibration.notes,
        sigma=SIGMA,
    )


def _tiles(result: LabelCalibration) -> list[Tile]:
    metrics = result.calibration.metrics
    normals = [metrics[f"mirror_{m}_normal_sigma_deg"].value for m in range(len(result.layout.mirrors))]
    return [
        Tile(f"{figure_text(metrics['label_sigma_px'].value, 2)} px", "noise of a label per axis"),
        Tile(f"{len(result.rejected)}", f"of {len(result.calibration.observations)} labels contradict others"),
        Tile(f"{figure_text(max(normals), 2)}°", f"{SIGMA} of the least certain mirror normal"),
        Tile(f"{figure_text(metrics['point_sigma_mm'].value, 2)} mm", f"typical {SIGMA} of a point, worst direction"),
    ]


def _checks(result: LabelCalibration, verdict: Verdict) -> FigureTable:
    figures = {check.label: check.metric for check in verdict.checks}
    metrics = result.calibration.metrics
    others = {n: m for n, m in metrics.items() if not n.startswith(("mirror_", "split_", "direct_"))}
    return FigureTable.of({**figures, **others}, {**LABELS, **{label: label for label in figures}})


def _label_table(result: LabelCalibration) -> Table:
    """Labels used and rejected by name, and the rms error of those used."""
    calibration = result.calibration
    rows = []
    for number, name in enumerate(result.table.labels):
        mine = calibration.observations.corner == number
        used = mine & calibration.inliers
        if not mine.any():
            continue
        rms = float(np.sqrt(np.mean(calibration.residuals_px[used] ** 2))) if used.any() else np.nan
        by_view = [
            str(int((mine & ~calibration.inliers & (calibration.observations.view == view)).sum()))
            for view in range(DIRECT, len(result.layout.mirrors))
        ]
        rows.append((name, str(int(used.sum())), *by_view, figure_text(rms, 2) if np.isfinite(rms) else "none"))
    return Table(("Label", "Used", *(f"Wrong in {view}" for view in result.table.views), "RMS px"), rows, FIGURES)


def _rejected_table(result: LabelCalibration) -> Table:
    """The labels with the largest errors."""
    worst = sorted(result.rejected, key=lambda item: -np.nan_to_num(item.error_px, nan=0.0))[:MAX_LISTED]
    table = result.table
    rows = [
        (
            table.frames[item.frame],
            table.views[item.view - DIRECT],
            table.labels[item.label],
            figure_text(item.error_px, 3) if np.isfinite(item.error_px) else "unknown",
            item.remark,
        )
        for item in worst
    ]
    return Table(("Frame", "View", "Label", "Error px", ""), rows, "plain words")


def _free_table(result: LabelCalibration) -> Table:
    """Rotation of each view against that of a plane mirror."""
    rows = [
        (
            name,
            *(f"{figure_text(turn, 2)} ± {figure_text(sigma, 2)}" for turn, sigma in zip(turns, sigmas, strict=True)),
        )
        for name, turns, sigmas in zip(
            result.table.views[1:], result.free.turn_deg.tolist(), result.free.sigma_deg.tolist(), strict=True
        )
    ]
    return Table(("Mirror", "about x °", "about y °", "about z °"), rows, FIGURES)
