"""A report for continuous integration: a summary in Markdown, and a list of tests in JUnit XML."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from mirrorcam.bench.scores.score_report import FIGURES, Check, ScoredSet, ScoreReport
from mirrorcam.core.figures.figure_texts import NONE, figure_text
from mirrorcam.core.names import markdown_text

NOT_GIVEN = "not given"
VIEW_COLUMNS = {
    "rms_px": "RMS px",
    "median_px": "median px",
    "p95_px": "95 % px",
    "max_px": "max px",
    "rms_mm": "RMS mm",
    "bias_x_px": "bias x px",
    "bias_y_px": "bias y px",
    "focal_error_percent": "focal length %",
}
"""Columns of the table of views."""
ROUNDING = 1e-9
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def rows_of(scored: ScoredSet) -> list[tuple[str, str, str, str]]:
    """Return name, value, limit and result of each figure over all views, and of each view's figures with limits."""
    by_name = {check.figure: check for check in scored.checks}
    names = [name for name in FIGURES if name in scored.figures or name in scored.not_given]
    names += [name for name in by_name if name not in names]
    rows = []
    for name in names:
        metric, check = scored.figures.get(name), by_name.get(name)
        reason = scored.not_given.get(name, check.reason if check else "")
        value = NOT_GIVEN if not reason else f"{NOT_GIVEN}: {reason}"
        if metric is not None:
            value = value_text(metric.value) if metric.known else f"{NONE}: {metric.reason}"
        result = "" if check is None else ("passed" if check.passed else "failed")
        rows.append((name, value, "" if check is None else limit_text(check), result))
    return rows


def value_text(value: float, digits: int = 4) -> str:
    """Format a value in a few digits; "0" for rounding errors, "none" for NaN."""
    return "0" if abs(value) <= ROUNDING else figure_text(value, digits)


def limit_text(check: Check) -> str:
    """Format the limit with its direction."""
    return f"{'at least' if check.at_least else 'at most'} {check.limit:g}"


def view_rows(scored: ScoredSet) -> list[tuple[str, ...]]:
    """Return name, camera, and figures of `VIEW_COLUMNS` of every view."""
    rows = []
    for view, camera in scored.views.items():
        metrics = [scored.figures.get(f"{view}_{name}") for name in VIEW_COLUMNS]
        values = (NOT_GIVEN if metric is None else value_text(metric.value, 3) for metric in metrics)
        rows.append((view, camera, *values))
    return rows


def summary(scored: ScoredSet) -> str:
    """Return the format of the calibration and its alignment in one line."""
    count, total = len(scored.views), len(scored.views) + len(scored.missing)
    alignment = {
        "rigid": "aligned by the best rigid motion",
        "similarity": "aligned by the best motion and scale, because its format has no scale",
        "each view alone": "each view aligned alone, because there are no poses",
    }[scored.alignment]
    mirrored = ", in a mirrored world" if scored.mirrored else ""
    return f"{scored.format}, {count} of {total} views, {alignment}{mirrored}, at {scored.distance_mm:g} mm"


def markdown(report: ScoreReport, title: str = "Calibration score", level: int = 1) -> str:
    """Return the report as Markdown under a heading of the given level, which states whether it passed."""
    parts = [f"{'#' * level} {title}: {'passed' if report.passed else 'failed'}\n"]
    subheading = "#" * (level + 1)
    for scored in report.sets:
        parts.append(f"{subheading} {markdown_text(scored.name)}\n")
        parts.append(f"`{scored.calibration.replace('`', '_')}`: {markdown_text(summary(scored))}.\n")
        parts += [f"- {markdown_text(note)}" for note in scored.notes]
        if scored.missing:
            parts.append(f"- no camera for {', '.join(scored.missing)}")
        if scored.notes or scored.missing:
            parts.append("")
        rows = [
            (f"`{name}`", *map(markdown_text, cells), _emphasised(result)) for name, *cells, result in rows_of(scored)
        ]
        parts.append(_table(("figure", "value", "limit", "result"), rows))
        views = [(f"`{view}`", *map(markdown_text, cells)) for view, *cells in view_rows(scored)]
        parts.append(_table(("view", "camera", *VIEW_COLUMNS.values()), views))
    if len(report.sets) > 1:
        parts.append(f"{subheading} Over {len(report.sets)} sets\n")
        by_name = {check.figure: check for check in report.checks_over_sets}
        rows = []
        for name, mean in report.over_sets.items():
            error = "" if mean.standard_error is None else value_text(mean.standard_error, 2)
            check = by_name.get(name)
            result = "" if check is None else ("passed" if check.passed else "failed")
            limit = "" if check is None else limit_text(check)
            rows.append((f"`{name}`", value_text(mean.mean), error, str(mean.sets), limit, _emphasised(result)))
        parts.append(_table(("figure", "mean", "standard error", "sets", "limit", "result"), rows))
    return "\n".join(parts)


def _emphasised(result: str) -> str:
    return f"**{result}**" if result == "failed" else result


def _table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def junit(report: ScoreReport) -> str:
    """Return the report as JUnit XML: a suite per set, with limits as tests and figures as properties."""
    suites = [(scored.name, scored.checks, _properties(scored)) for scored in report.sets]
    if report.checks_over_sets:
        suites.append(("over sets", report.checks_over_sets, {}))
    root = Element("testsuites", name="mirrorcam score")
    tests = failures = 0
    for name, checks, properties in suites:
        failed = sum(not check.passed for check in checks)
        tests, failures = tests + len(checks) + 1, failures + failed
        counts = {"tests": str(len(checks) + 1), "failures": str(failed), "errors": "0", "skipped": "0", "time": "0"}
        suite = SubElement(root, "testsuite", {"name": _xml(name), **counts})
        if properties:
            element = SubElement(suite, "properties")
            for figure, value in properties.items():
                SubElement(element, "property", name=figure, value=value)
        classname = f"mirrorcam.score.{_xml(name)}"
        SubElement(suite, "testcase", classname=classname, name="scored", time="0")
        for check in checks:
            title = f"{check.figure} {limit_text(check)}"
            case = SubElement(suite, "testcase", classname=classname, name=title, time="0")
            if not check.passed:
                value = (
                    NOT_GIVEN if check.value is None else f"{check.value:.6g} {check.unit.removesuffix('1')}".rstrip()
                )
                message = f"{check.figure} is {value}, expected {limit_text(check)}"
                SubElement(case, "failure", message=_xml(message), type="limit").text = _xml(check.reason or message)
    root.set("tests", str(tests))
    root.set("failures", str(failures))
    root.set("errors", "0")
    root.set("time", "0")
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, encoding="unicode")}\n'


def _properties(scored: ScoredSet) -> dict[str, str]:
    present = {name: scored.figures[name] for name in FIGURES if name in scored.figures}
    figures = {name: f"{metric.value:.9g}" if metric.known else NONE for name, metric in present.items()}
    return figures | dict.fromkeys(scored.not_given, NOT_GIVEN)


def _xml(text: str) -> str:
    """Replace characters that XML cannot contain."""
    return _NOT_XML.sub("_", text)
