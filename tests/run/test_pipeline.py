"""The chain of stages: what it reads, what it says, and when it fails."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.disk.stages import Stage
from mirrorcam.core.errors import InputError
from mirrorcam.core.progress import Progress
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.run import pipeline
from mirrorcam.run.pipeline import full_recipe, quick_recipe, run_all, stages


@pytest.mark.parametrize("recipe", [full_recipe(0), quick_recipe(0)], ids=["full", "quick"])
def test_each_stage_reads_only_what_stages_before_it_have_made(recipe: pipeline.Recipe) -> None:
    root, made = Path("root"), set[str]()
    for stage in stages(recipe, root):
        assert {path.relative_to(root).parts[0] for path in stage.reads} <= made
        made.add(stage.name)
    assert len(made) == 6


def test_the_seed_decides_about_the_set_alone() -> None:
    root = Path("root")
    for one, other in zip(stages(full_recipe(0), root), stages(full_recipe(1), root), strict=True):
        assert (one.parameters == other.parameters) == (one.name != "set")


def test_the_adapter_decides_about_the_parts_alone() -> None:
    on_desk, on_arm = full_recipe(0), replace(full_recipe(0), adapter="iso9409")
    for one, other in zip(stages(on_desk, Path("root")), stages(on_arm, Path("root")), strict=True):
        assert (one.parameters == other.parameters) == (one.name != "cad")


@pytest.fixture
def short_chain(small_layout: Layout, monkeypatch: pytest.MonkeyPatch) -> dict[str, Metric]:
    """Replace the stages by ones that write their metrics; those of the validation are returned, to be changed."""
    truth = {"normal_error_max_deg": Metric(value=0.01, unit="deg", limit=0.02)}
    part = {"seat_error_mm": Metric(value=0.0, unit="mm", limit=0.001)}

    def fake(recipe: pipeline.Recipe, root: Path) -> tuple[Stage, ...]:
        def design(folder: Path, progress: Progress) -> None:
            small_layout.save(folder / "layout.json")

        def cad(folder: Path, progress: Progress) -> None:
            write_metrics(folder / "checks.json", part)

        def validation(folder: Path, progress: Progress) -> None:
            write_metrics(folder / "metrics.json", truth)

        values = {name: metric.value for name, metric in truth.items()}
        return Stage("design", design), Stage("cad", cad), Stage("validation", validation, parameters=values)

    monkeypatch.setattr(pipeline, "stages", fake)
    monkeypatch.setattr(pipeline, "write_page", lambda root, path, **about: path.touch())
    monkeypatch.setattr(pipeline, "require", lambda *extras: None)
    return truth


def test_all_figures_of_the_stages_are_written_together(short_chain: dict[str, Metric], tmp_path: Path) -> None:
    assert run_all(full_recipe(0), tmp_path / "out", "mirrorcam run").passed
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["validation.normal_error_max_deg"] == {
        "value": 0.01,
        "unit": "deg",
        "limit": 0.02,
        "lower_is_better": True,
    }
    assert "cad.seat_error_mm" in metrics


def test_a_figure_past_its_limit_fails_the_run_every_time_and_the_page_is_written(
    short_chain: dict[str, Metric], tmp_path: Path
) -> None:
    short_chain["normal_error_max_deg"] = Metric(value=0.03, unit="deg", limit=0.02)
    assert not run_all(full_recipe(0), tmp_path, "mirrorcam run").passed
    assert (tmp_path / "index.html").exists()
    assert not run_all(full_recipe(0), tmp_path, "mirrorcam run").passed
    short_chain["normal_error_max_deg"] = Metric(value=0.02, unit="deg", limit=0.02)
    assert run_all(full_recipe(0), tmp_path, "mirrorcam run").passed


def test_a_second_run_says_what_it_reuses(
    short_chain: dict[str, Metric], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_all(full_recipe(0), tmp_path, "mirrorcam run", TERMINAL)
    assert "reused" not in capsys.readouterr().out
    run_all(full_recipe(0), tmp_path, "mirrorcam run", TERMINAL)
    said = capsys.readouterr().out
    assert [line.split()[0] for line in said.splitlines() if "reused" in line] == ["design", "cad", "validation"]


def test_a_missing_extra_stops_the_run_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirrorcam.core.extras.find_spec", lambda module: None if module == "mitsuba" else object())
    with pytest.raises(InputError, match=r'mitsuba not installed.*pip install "mirrorcam\[render\]"'):
        run_all(full_recipe(0), tmp_path / "out", "mirrorcam run")
    assert not (tmp_path / "out").exists()


def test_each_stage_depends_on_the_libraries_and_programs_that_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirrorcam.cad.write.slicer.slicer_version", lambda: "PrusaSlicer-99.0")
    needs = {
        name: {stage.name for stage in stages(quick_recipe(0), Path("root")) if name in _versions(stage)}
        for name in ("numpy", "casadi", "build123d", "mitsuba", "PrusaSlicer-99.0")
    }
    assert needs == {
        "numpy": {"design", "cad", "set", "validation", "light_field", "page"},
        "casadi": {"design"},
        "build123d": {"cad"},
        "mitsuba": {"set"},
        "PrusaSlicer-99.0": {"cad"},
    }


def _versions(stage: Stage) -> set[str]:
    return {*program_of(stage.code), *stage.programs.values()}
