"""The files of an evaluation: JSON, the summary, JUnit's XML, and a picture of the errors of each set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mirrorcam.bench.evaluation import RESULTS, Evaluation
from mirrorcam.bench.evaluation_summary import PICTURES, junit_text, summary_text
from mirrorcam.bench.score_figure import score_figure
from mirrorcam.bench.scores.calibration_score import CalibrationScore
from mirrorcam.bench.suite_folder import FinishedSuite
from mirrorcam.core.disk.files import write_text
from mirrorcam.render_scenes.sets.dataset import true_layout

EVALUATION, SUMMARY, JUNIT = "evaluation.json", "summary.md", "junit.xml"
FILES = (EVALUATION, SUMMARY, JUNIT, f"{PICTURES}/*.png", f"{RESULTS}/**/*")
"""All files, as patterns of `Path.glob`."""


def write_evaluation(
    evaluation: Evaluation, scores: Mapping[str, CalibrationScore], suite: FinishedSuite, folder: Path
) -> None:
    """Write the files of an evaluation into a folder; results of the command are there already."""
    write_text(folder / EVALUATION, evaluation.text())
    write_text(folder / SUMMARY, summary_text(evaluation, pictures=tuple(scores)))
    write_text(folder / JUNIT, junit_text(evaluation))
    for entry, place in zip(suite.manifest.sets, suite.folders, strict=True):
        if entry.name in scores:
            truth = true_layout(place)
            score_figure(scores[entry.name], truth, folder / PICTURES / f"{entry.name}.png", title=entry.name)
