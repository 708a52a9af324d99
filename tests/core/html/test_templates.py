"""The template kit escapes what it is given, sorts figures by how near their limit is, and needs nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from mirrorcam.core.html.templates import KIT, FigureTable, Table, full_stop, render
from mirrorcam.core.values import Metric

HOSTILE = "<img src=x onerror=alert(1)>\"'&"


def page(folder: Path, body: str, **values: object) -> str:
    """A page of the kit with a body."""
    text = '{% extends "base.html" %}{% import "kit.html" as kit %}{% block main %}' + body + "{% endblock %}"
    (folder / "page.html").write_text(text, encoding="utf-8")
    return render(folder, "page.html", title="t", **values)


def test_values_are_escaped_and_markup_is_not(tmp_path: Path) -> None:
    table = Table((HOSTILE,), [(HOSTILE, Markup("<b>taken</b>"))])
    text = page(tmp_path, "{{ kit.table(table) }}", table=table)
    assert "<img" not in text
    assert text.count("&lt;img src=x onerror=alert(1)&gt;&#34;&#39;&amp;") == 2
    assert "<td><b>taken</b></td>" in text


def test_the_style_sheet_is_in_the_page_and_has_both_schemes(tmp_path: Path) -> None:
    text = page(tmp_path, "")
    style = (KIT / "style.css").read_text(encoding="utf-8")
    assert style in text
    assert "prefers-color-scheme:dark" in style
    assert "@import" not in style
    assert "url(" not in style


def test_a_value_that_is_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(UndefinedError, match="nothing"):
        page(tmp_path, "{{ nothing }}")


def test_figures_are_sorted_worst_first_and_those_without_a_limit_apart(tmp_path: Path) -> None:
    metrics = {
        "near_mm": Metric(value=0.9, unit="mm", limit=1.0),
        "past_mm": Metric(value=3.0, unit="mm", limit=2.0),
        "far_mm": Metric(value=0.1, unit="mm", limit=1.0),
        "plain": Metric(value=7.0, unit="1"),
    }
    table = FigureTable.of(metrics, {"far_mm": "By hand"})
    assert [row.label for row in table.limited] == ["Past", "Near", "By hand"]
    assert [row.share for row in table.limited] == pytest.approx([1.0, 0.9, 0.1])
    assert [row.label for row in table.others] == ["Plain"]
    assert table.failed == 1
    text = page(tmp_path, "{{ kit.folded_checks(table) }}", table=table)
    assert "<details open><summary>1 of 3 checks failed</summary>" in text
    assert "1 more figure, without a limit" in text
    assert text.count(">FAIL<") == 1


def test_sentences_end_in_one_full_stop() -> None:
    assert [full_stop(text) for text in ("a b", "a b.", "why?")] == ["A b.", "A b.", "Why?"]
