"""Files of an evaluation: JSON, a summary, JUnit XML, and a picture of the errors of each set."""

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
    """Return the summary as Markdown: failures first, a row for each set, and collapsed details.

    `pictures` names the sets that have a picture in the folder `pictures`; the summary includes them.
    """
    verdict, count = "passed" if evaluation.passed else "failed", len(evaluation.tried)
    header, *rows = set_rows(evaluation, COLUMNS)
    quoted = [[f"`{name}`", *cells] for name, *cells in rows]
    parts = [
        f"# Calibration on the suite {evaluation.suite}, version {evaluation.version}: {verdict}\n",
        f"{len(evaluation.scored)} of {count} sets scored, by `{evaluation.command.replace('`', '_')}`.\n",
        *(f"- {markdown_text(line)}" for line in failed_lines(evaluation)),
        "",
        "\n".join(f"| {' | '.join(row)} |" for row in [header, ["---"] * len(header), *quoted]) + "\n",
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
    factors = {change.set: f"{change.factor:.2f} \N{MULTIPLICATION SIGN}" for change in evaluation.changes}
    rows = [["set", *columns.values(), "time s", *(["RMS / baseline"] if factors else [])]]
    for tried in evaluation.tried:
        figures = scored[tried.name].figures if tried.name in scored else {}
        change = [factors.get(tried.name, "")] if factors else []
        rows.append([tried.name, *(_cell(figures.get(name)) for name in columns), f"{tried.seconds:.1f}", *change])
    return rows


def failed_lines(evaluation: Evaluation) -> list[str]:
    """Return a line for each set without a score, and for each exceeded limit."""
    lines = [f"{name} has no score: {reason}" for name, reason in evaluation.failures.items()]
    over = () if evaluation.scores is None else evaluation.scores.checks_over_sets
    checked = [(name, scored.checks) for name, scored in evaluation.scored.items()]
    for name, checks in (*checked, ("over all sets", over)):
        for check in checks:
            if not check.passed:
                value = NOT_GIVEN if check.value is None else f"{value_text(check.value)} {check.unit}".rstrip()
                lines.append(f"{name}: {check.figure} is {value}, expected {limit_text(check)}")
    return lines + [f"{change.set}: {_worse(change)}" for change in evaluation.changes if not change.passed]


def _worse(change: Change) -> str:
    ratio = f"{change.figure} is {change.factor:.2f} times the baseline's {value_text(change.before)}"
    return f"{ratio}, expected at most {change.most:g} times"


def _cell(metric: Metric | None) -> str:
    return "" if metric is None else value_text(metric.value, 3)


def _chart(evaluation: Evaluation) -> str:
    """Return a Mermaid chart: the RMS of every set as bars, the baseline's as a line."""
    scored = {name: score for name, score in evaluation.scored.items() if score.figures["rms_px"].known}
    if not scored:
        return ""
    names = ", ".join(f'"{name}"' for name in scored)
    values = [scored[name].figures["rms_px"].value for name in scored]
    before = {change.set: change.before for change in evaluation.changes}
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
    """Return JUnit XML: the tests of the scores, one for each set without a score, and one for each change."""
    report = evaluation.scores
    if report is None:
        report = ScoreReport(sets=(), over_sets={}, checks_over_sets=(), passed=False)
    root = fromstring(junit(report))
    root.set("name", f"mirrorcam score suite {evaluation.suite}")
    cases = {f"{name}: scored": reason for name, reason in evaluation.failures.items()}
    cases |= {
        f"{change.set}: against the baseline": "" if change.passed else _worse(change) for change in evaluation.changes
    }
    if cases:
        failed = sum(map(bool, cases.values()))
        counts = {"tests": f"{len(cases)}", "failures": f"{failed}", "errors": "0", "skipped": "0", "time": "0"}
        suite = SubElement(root, "testsuite", {"name": "evaluation", **counts})
        for name, failure in cases.items():
            case = SubElement(suite, "testcase", classname="mirrorcam.score", name=name, time="0")
            if failure:
                SubElement(case, "failure", message=failure, type="evaluation").text = failure
        root.set("tests", f"{int(root.get('tests', '0')) + len(cases)}")
        root.set("failures", f"{int(root.get('failures', '0')) + failed}")
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, encoding="unicode")}\n'


def score_figure(score: CalibrationScore, truth: Layout, path: Path, *, title: str) -> None:
    """Write a PNG: the error of the calibration in every view at the working distance, in px, as map and arrows."""
    views = view_errors(score)
    width, height = np.diff(panel_extent(truth, views), axis=0)[0]
    height_in = PANEL_IN * float(np.clip(height / width, *HEIGHT_RATIO)) + ROW_IN + HEAD_IN
    figure = Figure(figsize=(PANEL_IN + BAR_IN, height_in), layout="constrained")
    axes = figure.subplots()
    lengths = [view.length_px for view in views]
    image = draw_map(axes, truth, views, lengths, max(float(length.max()) for length in lengths))
    arrow_px = draw_arrows(axes, views)
    axes.set_title(f"{title}: error in px at {score.distance_mm:.0f} mm\n(RMS of each view; arrow: {arrow_px:.2g} px)")
    figure.colorbar(image, ax=axes, label="px", fraction=0.03, pad=0.01)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=100, metadata={"Software": None})


def view_errors(score: CalibrationScore) -> list[ViewDifference]:
    """Return the pixels of the calibration minus those of the true device, by view, at the working distance."""
    differences = []
    for gauge in score.aligned:
        points = gauge.points
        error = gauge.pixels - points.pixels
        for view in gauge.views:
            used = (points.view == view.view) & points.at_distance & np.isfinite(error).all(axis=1)
            count = int(used.sum())
            if not count:
                continue
            zeros = np.zeros((count, 2, 2))
            differences.append(
                ViewDifference(view.view, points.pixels[used], error[used], np.zeros(count), zeros, np.zeros(count))
            )
    return differences


EVALUATION, SUMMARY, JUNIT = "evaluation.json", "summary.md", "junit.xml"
FILES = (EVALUATION, SUMMARY, JUNIT, f"{PICTURES}/*.png", f"{RESULTS}/**/*")
"""Patterns of all files, for `Path.glob`."""


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
