"""The files of an evaluation are there, and tell of each set."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam.bench.evaluation import Evaluation, evaluate
from mirrorcam.bench.evaluation_files import FILES, write_evaluation
from mirrorcam.bench.score_request import EvaluationRequest, Reading
from mirrorcam.bench.suite_folder import read_finished

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@pytest.mark.slow
def test_each_file_is_one_of_the_patterns_and_reads_back(finished_suite: Path, tmp_path: Path) -> None:
    suite = read_finished(finished_suite)
    command = 'cp "$MIRRORCAM_SET/layout.json" "$MIRRORCAM_RESULT"'
    request = EvaluationRequest(command=command, timeout_s=60.0)
    evaluation, scores = evaluate(suite, request, Reading(), tmp_path)
    write_evaluation(evaluation, scores, suite, tmp_path)
    names = [each.name for each in suite.manifest.sets]
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {
        *("evaluation.json", "summary.md", "junit.xml"),
        *(f"pictures/{name}.png" for name in names),
        *(f"results/{name}/{file}" for name in names for file in ("layout.json", "log.txt")),
    }
    matched = {path for pattern in FILES for path in tmp_path.glob(pattern) if path.is_file()}
    assert {path.relative_to(tmp_path).as_posix() for path in matched} == written
    text = (tmp_path / "evaluation.json").read_text(encoding="utf-8")
    assert Evaluation.model_validate_json(text) == evaluation
