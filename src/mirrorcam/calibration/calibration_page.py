"""`report.html` of a calibration: one file, which works from disk and offline, with the verdict on top."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.calibration import calibration_tables as tables
from mirrorcam.calibration.drawings import (
    board_distances,
    board_turns,
    coverage_map,
    depth_sigmas,
    projection_sigmas,
    residual_histogram,
    residual_needles,
)
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.figures.figure_texts import SIGMA, TIMES, count_text, figure_text
from mirrorcam.core.html.templates import FigureTable, Tile, render
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.verdict import STATES, Verdict, check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import ViewFigures, board_normals, view_figures
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.drift.drift import shows_drift

TEMPLATES = Path(__file__).parent
STATE_CLASSES = {"good": "pass", "look": "care", "stop": "fail"}


@dataclass(frozen=True)
class Card:
    """A drawing of the page (SVG) and what it shows."""

    drawing: str
    caption: str = ""


def write_report(calibration: Calibration, path: Path, *, command: str = "mirrorcam calibrate") -> None:
    """Write the report of a calibration as one HTML file; `command` is what made it."""
    write_text(path, report_html(calibration, command=command))


def report_html(calibration: Calibration, *, command: str) -> str:
    """The page. The same calibration makes the same page, and every text that comes from outside is escaped."""
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
        weakest=diagnostics.weak[0].words if diagnostics is not None and diagnostics.weak else None,
        tiles=_tiles(calibration),
        mirrors=count_text(len(calibration.layout.mirrors), "mirror"),
        camera=f"{camera.name}, {camera.width_px} {TIMES} {camera.height_px} px",
        checks=_checks(calibration, verdict),
        views=tables.view_table(views),
        mirror_table=tables.mirror_table(calibration),
        camera_table=tables.camera_table(calibration),
        cards=_cards(calibration, views),
        notes=notes,
        diagnostics=None if diagnostics is None else _diagnostics(calibration, diagnostics, views),
        sigma=SIGMA,
    )


def _tiles(calibration: Calibration) -> list[Tile]:
    """Headline figures of a calibration."""
    metrics, diagnostics = calibration.metrics, calibration.diagnostics
    tiles = []
    for name, what in (("held_out_rms", "frames left out of the fit"), ("rms", "fitted corners")):
        if f"{name}_x_px" in metrics:
            worse = max(metrics[f"{name}_{axis}_px"].value for axis in "xy")
            tiles.append(Tile(f"{figure_text(worse, 3)} px", f"RMS reprojection error per axis, {what}"))
            break
    if diagnostics is not None:
        tiles.append(Tile(diagnostics.level.replace("+", " +\N{NO-BREAK SPACE}"), "selected model"))
        normal = float(np.max(diagnostics.mirrors.normal_deg))
        tiles.append(Tile(f"{figure_text(normal, 2)}°", f"{SIGMA} of the least certain mirror normal"))
        depth = float(np.interp(diagnostics.range_mm, diagnostics.depth.range_mm, diagnostics.depth.total_mm))
        if np.isfinite(depth):
            tiles.append(Tile(f"{figure_text(depth, 2)} mm", f"{SIGMA} of depth at {diagnostics.range_mm:.0f} mm"))
    return tiles


def _checks(calibration: Calibration, verdict: Verdict) -> FigureTable:
    """Figures with limits, of the verdict and of the caller, and the others."""
    figures = {check.label: check.metric for check in verdict.checks}
    others = {name: metric for name, metric in calibration.metrics.items() if not name.startswith("mirror_")}
    return FigureTable.of({**figures, **others}, {**LABELS, **{label: label for label in figures}})


def _cards(calibration: Calibration, views: Sequence[ViewFigures]) -> dict[str, Card | None]:
    """The drawings that every calibration has; that of the view without a mirror only where there was such a view."""
    mirrors = [view for view in views if view.view != DIRECT]
    direct = [view for view in views if view.view == DIRECT]
    turned = "Tilt of the boards, a dot per frame"
    if not board_normals(calibration)[1].all():
        turned += f": filled, through the mirrors; open, {direct[0].name}"
    return {
        "residuals": Card(
            residual_needles(calibration, mirrors),
            "Mean residuals, predicted minus detected. Red: significant at the 1 % level, as 1 % are by noise alone.",
        ),
        "histogram": Card(residual_histogram(calibration), "Residuals without outliers; logarithmic counts."),
        "direct": Card(residual_needles(calibration, direct), f"Mean residuals of {direct[0].called}.")
        if direct
        else None,
        "coverage": Card(
            coverage_map(calibration.layout, views), "Number of corners per cell, and the coverage of every view."
        ),
        "distances": Card(board_distances(views), "Distance of the board, a dot per frame."),
        "turns": Card(board_turns(calibration), f"{turned}."),
    }


def _diagnostics(calibration: Calibration, diagnostics: Diagnostics, views: Sequence[ViewFigures]) -> dict[str, object]:
    """Values that the page shows of the diagnostics."""
    known = np.isfinite(diagnostics.depth.total_mm).sum() >= 2
    free = diagnostics.free_views
    return {
        "common": tables.common_table(diagnostics),
        "tilt": figure_text(HARDWARE.mount.tilt_deg, 2),
        "weak": tables.weak_table(diagnostics) if diagnostics.weak else None,
        "projection": _projection(calibration, diagnostics, views),
        "depth": Card(depth_sigmas(diagnostics.depth, diagnostics.range_mm)) if known else None,
        "models": tables.model_table(diagnostics),
        "free": None
        if free is None
        else {
            "parameters": free.parameters,
            "unexplained": figure_text(free.unexplained_px, 2),
            "chance": tables.chance_words(free.chance),
        },
        "splits": tables.split_table(diagnostics) if diagnostics.splits else None,
        "drift": shows_drift(calibration.layout),
        "printed": calibration.layout.spec is not None,
    }


def _projection(calibration: Calibration, diagnostics: Diagnostics, views: Sequence[ViewFigures]) -> list[Card]:
    """Maps of the standard deviation of projected points, in the rig and against the reference view."""
    maps = [one for one in diagnostics.projection if one.view != DIRECT]
    direct = [one.in_rig_px for one in diagnostics.projection if one.view == DIRECT]
    unshown = ""
    if direct:
        unshown = f" The direct view, not shown, has {np.median(direct):.2g} px over the whole picture."
    reference = next(view.called for view in views if view.view == diagnostics.reference)
    cards = []
    for name, values, words, further in (
        ("rig", [one.in_rig_px for one in maps], "of a point fixed in front of the camera", unshown),
        (
            "reference",
            [one.against_reference_px for one in maps],
            f"of a point fixed where {reference} shows it, which determines depth",
            "",
        ),
    ):
        most = float(np.max(np.concatenate(values)))
        cards.append(
            Card(
                projection_sigmas(calibration.layout, views, maps, values, most, name=f"sigma-{name}"),
                f"{SIGMA} px {words}, {diagnostics.range_mm:.0f} mm away: medians; the strongest colour is "
                f"{most:.2g} px.{further}",
            )
        )
    return cards
