"""Long work speaks in plain lines when nobody watches a terminal."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from mirrorcam.core.console import progress
from mirrorcam.core.values import Metric


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> StringIO:
    stream = StringIO()
    monkeypatch.setattr(progress, "console", lambda: Console(file=stream, markup=False, highlight=False, width=200))
    return stream


def test_plain_lines_in_a_log(log: StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 6.0, 7.0, 12.0])
    monkeypatch.setattr("mirrorcam.core.console.progress.time.monotonic", lambda: next(clock))
    with progress.long_work("render", "3 frames", "frames") as advance:
        for done in range(1, 4):
            advance(done, 3)
    assert log.getvalue().splitlines() == [
        "render       3 frames ...",
        "render       2/3 frames after 6 s",
        "render       done in 12.0 s",
    ]


def test_failed_work_does_not_say_that_it_is_done(log: StringIO) -> None:
    with pytest.raises(ValueError, match="no"), progress.long_work("render", "3 frames"):
        raise ValueError("no")
    assert "done" not in log.getvalue()


def test_paths_with_brackets_are_printed_as_they_are(log: StringIO) -> None:
    progress.say("design", "out[bold]/layout.json")
    assert "out[bold]/layout.json" in log.getvalue()


def test_a_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = StringIO()
    terminal = Console(file=stream, force_terminal=True, width=100)
    monkeypatch.setattr(progress, "console", lambda: terminal)
    with progress.long_work("render", "3 frames", "frames") as advance:
        advance(2, 3)
    assert "2/3" in stream.getvalue()
    assert "done in" in stream.getvalue()


def test_several_columns_of_metrics_with_limits(log: StringIO) -> None:
    parabola = {"grid_error": Metric(value=0.4, unit="1")}
    optimised = {
        "grid_error": Metric(value=0.105, unit="1", limit=0.11),
        "efficiency": Metric(value=0.4, unit="1", limit=0.5, lower_is_better=False),
    }
    progress.print_metrics({"parabola": parabola, "optimised": optimised})
    lines = [line.split() for line in log.getvalue().splitlines()]
    assert lines[0] == ["parabola", "optimised", "unit", "limit"]
    assert lines[1] == ["grid", "error", "0.400", "0.105", "≤", "0.11", "pass"]
    assert lines[2] == ["efficiency", "0.4", "≥", "0.5", "FAIL"]


def test_a_figure_just_past_its_limit_is_printed_so(log: StringIO) -> None:
    progress.print_metrics({"measured": {"grid_error": Metric(value=0.110004, unit="1", limit=0.11)}})
    assert log.getvalue().splitlines()[1].split() == ["grid", "error", "0.110004", "≤", "0.11", "FAIL"]


def test_groups_of_figures_and_ungrouped_figures(log: StringIO) -> None:
    near = Metric(value=1e5, unit="mm or more")
    progress.print_metrics(
        {
            "parabola": {"depth_farthest_mm": near},
            "optimised": {
                "other": Metric(value=1.0, unit="1"),
                "depth_farthest_mm": Metric(value=900.0, unit="mm"),
                "pixel_efficiency_300mm": Metric(value=0.5, unit="1"),
            },
        },
        {"depth": ("depth_",), "empty": ("nothing",), "share": ("pixel_",)},
    )
    assert [line.rstrip() for line in log.getvalue().splitlines()[1:]] == [
        "depth",
        "  farthest depth              100000 mm or more        900  mm",
        "share",
        "  pixel efficiency at 300 mm                           0.5",
        "other                                                    1",
    ]


def test_units_and_labels_are_those_of_people_not_of_files(log: StringIO) -> None:
    progress.print_metrics(
        {
            "then": {"overhang_mm2": Metric(value=2.0, unit="cm3")},
            "now": {"overhang_mm2": Metric(value=1.0, unit="mm2")},
        }
    )
    assert log.getvalue().splitlines()[1].split("  ")[0] == "overhangs that need support"
    assert log.getvalue().splitlines()[1].split()[-4:] == ["2", "cm³", "1", "mm²"]


def test_reasons_of_figures_that_are_none_stand_below_the_table(log: StringIO) -> None:
    none = Metric(value=float("nan"), unit="mm", limit=2.0, reason="the views share nothing")
    one = Metric(value=1.25, unit="mm", limit=2.0)
    progress.print_metrics({"parabola": {"a_mm": none}, "optimised": {"a_mm": one, "b_mm": none}})
    lines = [line.split() for line in log.getvalue().splitlines()]
    assert lines[1] == ["a", "none", "1.25", "mm", "≤", "2", "pass"]
    assert lines[2] == ["b", "none", "mm", "≤", "2", "FAIL"]
    assert [" ".join(line) for line in lines[3:]] == ["none: a, b: the views share nothing"]
