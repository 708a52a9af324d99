"""The guides: what they print as programs runs, and their commands are those of a person who follows them in order."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from docs.page_code import blocks
from mirrorcam.optics.geometry.layout import Layout

DOCS = Path(__file__).parents[2] / "docs"
PEOPLE = ("maker", "designer", "roboticist", "biologist", "ci")


def program(page: str) -> str:
    """The Python program of a page that has one."""
    (block,) = blocks((DOCS / page).read_text(encoding="utf-8"), "python")
    return block.text


def test_there_is_a_guide_for_everyone() -> None:
    assert {path.stem for path in (DOCS / "guides").iterdir()} == {*PEOPLE}
    start = (DOCS / "start.md").read_text(encoding="utf-8")
    assert [person for person in PEOPLE if f"guides/{person}.md" not in start] == []


def test_what_failed_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = {
        "good": {"value": 1.0, "unit": "px", "limit": 2.0, "lower_is_better": True},
        "large": {"value": 3.0, "unit": "px", "limit": 2.0},
        "small": {"value": 0.4, "unit": "", "limit": 0.5, "lower_is_better": False},
        "exact": {"value": 0.5, "unit": "", "limit": 0.5, "lower_is_better": False},
        "free": {"value": 9.0, "unit": "mm"},
    }
    (tmp_path / "output" / "smoke").mkdir(parents=True)
    (tmp_path / "output" / "smoke" / "metrics.json").write_text(json.dumps(figures), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(program("guides/ci.md"), {})
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["large", "small"]


def test_a_schema_is_used(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "schemas").symlink_to(DOCS / "schemas")
    default_layout.save(tmp_path / "output" / "default" / "design" / "layout.json")
    monkeypatch.chdir(tmp_path)
    exec(program("files.md"), {})
    assert capsys.readouterr().out == ""
