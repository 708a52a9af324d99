"""The files of an evaluation: JSON, a summary, JUnit XML, and a picture of the errors of each set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import SubElement, fromstring, indent, tostring

import numpy as np
from matplotlib.figure import Figure

from mirrorcam import Layout
from mirrorcam.bench.evaluation import RESULTS, Change, Evaluation
from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.scores.report_texts import NOT_GIVEN, junit, limit_text, markdown, value_text
from mirrorcam.bench.scores.score_report import ScoreReport
from mirrorcam.bench.suite_folder import FinishedSuite
from mirrorcam.calibration.comparison import (
    BAR_IN,
    HEAD_IN,
    HEIGHT_RATIO,
    PANEL_IN,
    ROW_IN,
    draw_arrows,
    draw_map,
    panel_extent,
)
from mirrorcam.core.disk.files import atomic, write_text
from mirrorcam.core.names import markdown_text
from mirrorcam.core.values import Metric
from mirrorcam.optics.calibration.diagnostics.calibration_difference import ViewDifference
from mirrorcam.render_scenes.sets.dataset import true_layout

COLUMNS = {
    "rms_px": "RMS px",
    "worst_view_rms_px": "worst view px",
    "rms_mm": "RMS mm",
    "focal_error_rms_percent": "focal length %",
    "baseline_error_rms_mm": "baselines mm",
    "angle_error_rms_deg": "angles deg",
    "triangulation_rms_mm": "triangulation mm",
    "nees": "NEES",
}
"""Columns of the table of sets in the summary."""
SHORT_COLUMNS = {name: COLUMNS[name] for name in ("rms_px", "worst_view_rms_px", "rms_mm", "nees")}
"""Columns of the table on a terminal."""
PICTURES = "pictures"


def summary_text(evaluation: Evaluation, *, pictures: tuple[str, ...] = ()) -> str:
    """The summary as Markdown: failures first, a row for each set, and collapsed details.

    `pictures` names the sets that have a picture in the folder `pictures`; the summary includes them.
    """
    verdict, count = "passed" if evaluation.passed else "failed", len(evaluation.tried)
    header, *rows = set_rows(evaluation, COLUMNS)
    named = [[f"`{name}`", *cells] for name, *cells in rows]
    parts = [
        f"# Calibration on the suite {evaluation.suite}, version {evaluation.version}: {verdict}\n",
        f"{len(evaluation.scored)} of {count} sets scored, by `{evaluation.command.replace('`', '_')}`.\n",
        *(f"- {markdown_text(line)}" for line in failed_lines(evaluation)),
        "",
        "\n".join(f"| {' | '.join(row)} |" for row in [header, ["---"] * len(header), *named]) + "\n",
        _chart(evaluation),
        *(f"![Errors of {name} in every view]({PICTURES}/{name}.png)\n" for name in pictures),
    ]
    if evaluation.scores is not None:
        figures = markdown(evaluation.scores, "Limits", level=2)
        parts.append(f"<details><summary>All figures</summary>\n\n{figures}\n</details>\n")
    return "\n".join(parts)


def set_rows(evaluation: Evaluation, columns: Mapping[str, str]) -> list[list[str]]:
    """Return the header of a table, and a row of texts for each set: name, figures, time, and change."""
    scored = evaluation.scored
    factors = {each.set: f"{each.factor:.2f} \N{MULTIPLICATION SIGN}" for each in evaluation.changes}
    rows = [["set", *columns.values(), "time s", *(["RMS / baseline"] if factors else [])]]
    for tried in evaluation.tried:
        figures = scored[tried.name].figures if tried.name in scored else {}
        change = [factors.get(tried.name, "")] if factors else []
        rows.append([tried.name, *(_cell(figures.get(name)) for name in columns), f"{tried.seconds:.1f}", *change])
    return rows


def failed_lines(evaluation: Evaluation) -> list[str]:
    """A line for each set without a score, and for each exceeded limit."""
    lines = [f"{name} has no score: {why}" for name, why in evaluation.failures.items()]
    over = () if evaluation.scores is None else evaluation.scores.checks_over_sets
    checked = [(name, scored.checks) for name, scored in evaluation.scored.items()]
    for name, checks in (*checked, ("over all sets", over)):
        for check in checks:
            if not check.passed:
                value = NOT_GIVEN if check.value is None else f"{value_text(check.value)} {check.unit}".rstrip()
                lines.append(f"{name}: {check.figure} is {value}, expected {limit_text(check)}")
    return lines + [f"{change.set}: {_worse(change)}" for change in evaluation.changes if not change.passed]


def _worse(change: Change) -> str:
    before, most = value_text(change.before), f"{change.most:g}"
    return f"{change.figure} is {change.factor:.2f} times the {before} of the baseline, expected {most} times at most"


def _cell(metric: Metric | None) -> str:
    return "" if metric is None else value_text(metric.value, 3)


def _chart(evaluation: Evaluation) -> str:
    """The RMS of every set as bars, with the baseline as a line, in Mermaid."""
    scored = {name: each for name, each in evaluation.scored.items() if each.figures["rms_px"].known}
    if not scored:
        return ""
    names = ", ".join(f'"{name}"' for name in scored)
    values = [scored[name].figures["rms_px"].value for name in scored]
    before = {each.set: each.before for each in evaluation.changes}
    lines = [
        "```mermaid",
        "xychart-beta",
        f"    x-axis [{names}]",
        '    y-axis "RMS px"',
        f"    bar [{', '.join(f'{value:.5g}' for value in values)}]",
    ]
    if len(before) == len(scored):
        lines.append(f"    line [{', '.join(f'{before[name]:.5g}' for name in scored)}]")
    return "\n".join([*lines, "```\n"])


def junit_text(evaluation: Evaluation) -> str:
    """JUnit XML: the tests of the scores, one for each set without a score, and one for each change."""
    report = evaluation.scores
    if report is None:
        report = ScoreReport(sets=(), over_sets={}, checks_over_sets=(), passed=False)
    root = fromstring(junit(report))
    root.set("name", f"mirrorcam score suite {evaluation.suite}")
    others = {f"{name}: scored": why for name, why in evaluation.failures.items()}
    others |= {f"{each.set}: against the baseline": "" if each.passed else _worse(each) for each in evaluation.changes}
    if others:
        failed = sum(map(bool, others.values()))
        counts = {"tests": f"{len(others)}", "failures": f"{failed}", "errors": "0", "skipped": "0", "time": "0"}
        suite = SubElement(root, "testsuite", {"name": "evaluation", **counts})
        for name, failure in others.items():
            case = SubElement(suite, "testcase", classname="mirrorcam.score", name=name, time="0")
            if failure:
                SubElement(case, "failure", message=failure, type="evaluation").text = failure
        root.set("tests", f"{int(root.get('tests', '0')) + len(others)}")
        root.set("failures", f"{int(root.get('failures', '0')) + failed}")
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, encoding="unicode")}\n'


def score_figure(score: CalibrationScore, truth: Layout, path: Path, *, title: str) -> None:
    """Write a PNG: the error of the calibration in every view at the working distance, in px, as map and arrows."""
    views = view_errors(score)
    wide, high = np.diff(panel_extent(truth, views), axis=0)[0]
    height_in = PANEL_IN * float(np.clip(high / wide, *HEIGHT_RATIO)) + ROW_IN + HEAD_IN
    figure = Figure(figsize=(PANEL_IN + BAR_IN, height_in), layout="constrained")
    axes = figure.subplots()
    lengths = [view.length_px for view in views]
    shown = draw_map(axes, truth, views, lengths, max(float(length.max()) for length in lengths))
    longest_px = draw_arrows(axes, views)
    axes.set_title(
        f"{title}: error in px at {score.distance_mm:.0f} mm\n(RMS of each view; arrow: {longest_px:.2g} px)"
    )
    figure.colorbar(shown, ax=axes, label="px", fraction=0.03, pad=0.01)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=100, metadata={"Software": None})


def view_errors(score: CalibrationScore) -> list[ViewDifference]:
    """Pixels of the calibration minus those of the true device, for each view, at the working distance."""
    found = []
    for gauge in score.placed:
        points = gauge.points
        error = gauge.pixels - points.pixels
        for view in gauge.views:
            at = (points.view == view.view) & points.at_distance & np.isfinite(error).all(axis=1)
            count = int(at.sum())
            if not count:
                continue
            zeros = np.zeros((count, 2, 2))
            found.append(
                ViewDifference(view.view, points.pixels[at], error[at], np.zeros(count), zeros, np.zeros(count))
            )
    return found


EVALUATION, SUMMARY, JUNIT = "evaluation.json", "summary.md", "junit.xml"
FILES = (EVALUATION, SUMMARY, JUNIT, f"{PICTURES}/*.png", f"{RESULTS}/**/*")
"""All files, as patterns of `Path.glob`."""


def write_evaluation(
    evaluation: Evaluation, scores: Mapping[str, CalibrationScore], suite: FinishedSuite, folder: Path
) -> None:
    """Write the files of an evaluation into the folder of the command's results."""
    write_text(folder / EVALUATION, evaluation.text())
    write_text(folder / SUMMARY, summary_text(evaluation, pictures=tuple(scores)))
    write_text(folder / JUNIT, junit_text(evaluation))
    for entry, set_folder in zip(suite.manifest.sets, suite.folders, strict=True):
        if entry.name in scores:
            truth = true_layout(set_folder)
            score_figure(scores[entry.name], truth, folder / PICTURES / f"{entry.name}.png", title=entry.name)
