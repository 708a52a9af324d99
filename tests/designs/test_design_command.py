"""`mirrorcam design` writes what it found and prints it next to the parabola, or says why there is none."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mirrorcam.cli import application, main
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import figure_text
from mirrorcam.core.processes.calls import Calls, in_turn
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.designs.design_command import DesignChanges
from mirrorcam.designs.design_files import request_toml
from mirrorcam.designs.target import Target, measure
from mirrorcam.designs.target_search import VARIED, TargetDesigns
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import assert_refused, assert_refused_here, mirrorcam, results


@pytest.fixture
def solved(default_layout: Layout, monkeypatch: pytest.MonkeyPatch) -> Layout:
    """The default layout with its figures and verdict, which the optimiser then gives for any spec."""
    spec = DesignSpec()
    layout = default_layout.replaced(
        spec=spec, metrics=evaluate(default_layout, spec.depths_mm), verdict=verify(default_layout, spec)
    )
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls, progress: layout)
    return layout


def no_parabola(spec: DesignSpec, calls: Calls = in_turn, *, progress: Progress = no_progress) -> Layout:
    raise InfeasibleDesign("spacing", "facets 30 mm apart do not fit the parabola")


def test_all_figures_are_printed_next_to_the_parabolas(
    solved: Layout, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["design", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    titles = [line.strip() for line in printed.splitlines() if line[:1].isalpha() and len(line.split("  ")) > 1]
    for title in ("overlap of the views", "depth", "mirrors", "focus of the camera", "verdict"):
        assert title in titles
    rows = [line.split() for line in printed.splitlines() if line.startswith("  ")]
    limited = [metric for metric in solved.metrics.values() if metric.limit is not None]
    assert len([row for row in rows if row[-1] == "pass"]) == len(solved.verdict) + len(limited)
    assert len(rows) >= len(solved.metrics) + len(solved.verdict)
    parabola = Layout.load(tmp_path / "parabola.json")
    assert parabola.verdict.keys() == solved.verdict.keys()
    assert parabola.metrics.keys() == solved.metrics.keys()
    assert Layout.load(tmp_path / "layout.json") == solved


@pytest.mark.slow
def test_no_row_is_torn_in_two(solved: Layout, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["design", "--out", str(tmp_path)])
    lines = capsys.readouterr().out.splitlines()
    headers, titles, said = 3, 5, 4
    assert len(lines) == headers + titles + said + len(solved.metrics) + len(solved.verdict)


@pytest.mark.slow
def test_a_spec_without_a_parabola_is_designed_all_the_same(
    solved: Layout, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["design", "--out", str(tmp_path)]) == 0
    assert "parabola.json" in results(tmp_path)
    monkeypatch.setattr("mirrorcam.optics.design.optimise.faceted_parabola", no_parabola)
    assert main(["design", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "no faceted parabola to compare with: infeasible design, spacing constraint: facets 30 mm apart" in printed
    assert "pixel efficiency at 300 mm" in printed
    # The parabola of an earlier spec does not stay beside a layout that it does not belong to.
    assert results(tmp_path) == ["before_after.png", "focus.png", "layout.json"]


def test_nothing_is_written_where_no_layout_meets_the_spec(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", no_parabola)
    assert main(["design", "--out", str(tmp_path / "new")]) == 2
    assert not (tmp_path / "new").exists()
    assert capsys.readouterr().err.count("\n") == 1


def test_a_design_is_kept_and_printed_where_no_device_can_be_built_so(
    solved: Layout, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "design.toml").write_text("[tolerances]\ntilt_deg = 40.0\n")
    assert main(["design", str(tmp_path / "design.toml"), "--tolerance", "--out", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert printed.err.startswith("mirrorcam: tolerances")
    assert "grid error" in printed.out
    assert Layout.load(tmp_path / "layout.json") == solved
    assert not (tmp_path / "tolerance.json").exists()


def test_an_infeasible_design_is_refused(tmp_path: Path) -> None:
    assert_refused(tmp_path, "design --fold-deg 90 --depths-mm 20 --out design", "infeasible design, depth constraint")


def test_design_writes_and_prints_layout_and_parabola(tmp_path: Path) -> None:
    result = mirrorcam(tmp_path, "design --rows 1 --cols 2 --out design")
    assert (result.returncode, result.stderr) == (0, "")
    assert results(tmp_path / "design") == [
        "before_after.png",
        "focus.png",
        "layout.json",
        "parabola.json",
    ]
    layout, parabola = (Layout.load(tmp_path / "design" / name) for name in ("layout.json", "parabola.json"))
    for text in ("parabola", "optimised", *(figure_text(x.metrics["grid_error"].value) for x in (parabola, layout))):
        assert text in result.stdout


def test_a_pattern_is_read_from_its_name_or_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('name = "mine"\npositions = [[0, 0], [1, 0], [0.4, 2]]\n')
    own = Pattern(name="mine", positions=[[0, 0], [1, 0], [0.4, 2]])
    assert DesignChanges(pattern="hex7").of(DesignSpec()) == DesignSpec(pattern=Pattern.hexagonal(1))
    assert DesignChanges(pattern=str(file)).of(DesignSpec()) == DesignSpec(pattern=own)
    file.write_text("positions = [[0, 0], [1, 0], [1, 0]]\n")
    with pytest.raises(InputError, match=r"mine.toml: .*coincident positions 1 and 2"):
        DesignChanges(pattern=str(file)).of(DesignSpec())


def test_the_help_states_the_defaults_of_a_request() -> None:
    arguments = []
    for each in application()["design"].assemble_argument_collection():
        stated = re.search(r"\[default: (.+)\]", each.parameter.help or "")
        if stated is not None and each.field_info.name in DesignSpec.model_fields:
            arguments += [each.name, *stated[1].split()]
    _, bound, _ = application().parse_args(["design", *arguments])
    assert len(vars(bound.arguments["changes"])) == 12
    assert bound.arguments["changes"].of(DesignSpec()) == DesignSpec()


def test_options_replace_fields_of_a_request_in_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    designed: list[DesignSpec] = []

    def write(spec: DesignSpec, folder: Path, calls: Calls, progress: Progress) -> None:
        designed.append(spec)
        raise InputError("enough")

    monkeypatch.setattr("mirrorcam.designs.design_files.write_design", write)
    monkeypatch.chdir(tmp_path)
    request = DesignSpec(rows=2, spacing_mm=1.5)
    Path("design.toml").write_text(request_toml(request), encoding="utf-8")
    assert_refused_here(["design", "design.toml"], capsys, "enough")
    options = "--cols 4 --camera d435 --scale-mm 60 --depths-mm 280 400 --tradeoff 0 --fold-deg auto"
    assert_refused_here(["design", "design.toml", *options.split()], capsys, "enough")
    changes = {"cols": 4, "camera": read_camera("d435"), "scale_mm": 60.0, "depths_mm": (280.0, 400.0)}
    assert designed == [request, request.replaced(**changes, tradeoff=0.0, fold_deg="auto")]
    assert_refused_here(["design", "design.toml", "--pattern", "hex7"], capsys, "rows or cols are given with a pattern")
    assert_refused_here(["design", "none.toml"], capsys, "none.toml: no such file")


@pytest.mark.parametrize(("terms", "status"), [(["900g", "90h"], 0), (["900g", "1h"], 1)])
def test_a_target_writes_the_best_design_and_prints_what_gives_way(
    terms: list[str],
    status: int,
    solved: Layout,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: dict[str, object] = {}

    def found(target: Target, spec: DesignSpec, vary: set[str], **_: object) -> TargetDesigns:
        asked.update(spec=spec, vary=vary)
        return TargetDesigns(target=target, designs=(measure(solved, target),))

    monkeypatch.setattr("mirrorcam.designs.target_search.designs_for", found)
    command = ["design", "--target", *terms, "--rows", "2", "--camera", "brio", "--out", str(tmp_path)]
    assert main(command) == status
    assert asked == {
        "spec": DesignSpec(rows=2, camera=read_camera("brio")),
        "vary": set(VARIED) - {"rows"},
    }
    assert Layout.load(tmp_path / "layout.json") == solved
    printed = capsys.readouterr().out
    rows = [line for line in printed.splitlines() if line.startswith(tuple(terms))]
    assert [row.endswith("!") for row in rows] == [False, status == 1]
    assert ("1h gives way" in printed) == (status == 1)


def test_a_target_that_cannot_be_is_refused_before_any_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert_refused_here(["design", "--target", "90USD", "--out", str(out)], capsys, "'90USD': expected 0.3mm@400mm")
    assert not out.exists()
