"""An evaluation reads back as it was written; an impossible score is a failure of its set, and of no other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mirrorcam.bench.evaluation import read_evaluation
from mirrorcam.bench.leaderboard_files import read_leaderboard
from mirrorcam.core.errors import InputError
from tests.bench.test_leaderboard_files import evaluation


def test_it_reads_back(tmp_path: Path) -> None:
    written = evaluation({"a": 0.1, "b": None, "c": 0.0})
    path = tmp_path / "evaluation.json"
    path.write_text(written.text(), encoding="utf-8")
    assert read_evaluation(path) == written


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (-1.0, "-1.0"),
        (-1e-300, "-1e-300"),
        (float("nan"), "nan"),
        (float("-inf"), "-inf"),
        ("0.1", "'0.1'"),
        (True, "True"),
        (None, "None"),
        ([0.1], "[0.1]"),
        ("\n" * 100, "'"),
    ],
)
def test_a_score_that_cannot_be_is_a_failure_of_its_set_alone(tmp_path: Path, value: Any, shown: str) -> None:
    tables = json.loads(evaluation({"a": 0.1, "b": 0.2}).text())
    tables["scores"]["sets"][1]["figures"]["rms_px"]["value"] = value
    path = tmp_path / "evaluation.json"
    path.write_text(json.dumps(tables), encoding="utf-8")
    found = read_evaluation(path)
    assert list(found.scored) == ["a"]
    assert found.failures["b"].startswith(f"invalid result: rms_px is {shown}")
    row = read_leaderboard([f"one={path}"]).rows[0]
    assert row.rms_px == {"a": 0.1}
    assert row.failures == {"b": found.failures["b"]}


@pytest.mark.parametrize("figures", [{}, {"rms_px": 0.1}, {"rms_px": []}])
def test_a_score_without_it_is_none(tmp_path: Path, figures: dict[str, Any]) -> None:
    tables = json.loads(evaluation({"a": 0.1, "b": 0.2}).text())
    tables["scores"]["sets"][1]["figures"] = figures
    path = tmp_path / "evaluation.json"
    path.write_text(json.dumps(tables), encoding="utf-8")
    assert list(read_evaluation(path).failures) == ["b"]


@pytest.mark.parametrize(
    "text",
    [
        *("{}", "[]", "null", '{"scores": []}', '{"scores": {"sets": {}}}', '{"tried": 1, "scores": {"sets": []}}'),
        *('{"scores": {"sets": [null, {"name": []}]}}', '{"scores": {"sets": [{"name": [], "figures": {}}]}}'),
    ],
)
def test_what_is_no_evaluation_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "evaluation.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"evaluation\.json: ") as caught:
        read_evaluation(path)
    assert "\n" not in str(caught.value)
