"""A sweep's request, the order of its designs, and its folder: a table, and a figure where something was solved."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mirrorcam.core.disk.output_folder import results_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import Metric
from mirrorcam.designs.design_sweep import table_of
from mirrorcam.designs.sweep_files import SweepRequest, grouped, read_sweep, write_sweep
from mirrorcam.optics.design.spec_grid import Outcome, grid, structure
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.designs.made_up_designs import SPECS, Counting


def solved(spec: DesignSpec) -> Outcome:
    """An outcome with the metrics that the figure shows."""
    shown = {"grid_error": spec.tradeoff, "pixel_efficiency_300mm": 0.4, "pixel_efficiency_500mm": 0.5}
    return Outcome(spec=spec, status="solved", metrics={n: Metric(value=v, unit="1") for n, v in shown.items()})


def test_a_table_and_a_figure_sum_up_the_outcomes_in_the_order_of_the_specs(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    swept = write_sweep(
        SPECS, tmp_path, Counting(solved), table="json", progress=lambda done, total: calls.append((done, total))
    )
    assert [outcome.spec for outcome in swept.outcomes] == list(SPECS)
    assert swept.files == (tmp_path / "sweep.json", tmp_path / "pareto.png")
    assert json.loads(swept.files[0].read_text())["designs"] == table_of(swept.outcomes)
    assert min(read_image(swept.files[1]).shape[:2]) > 300
    assert calls[-1] == (4, 4)


def test_without_a_solved_spec_the_figure_of_an_earlier_sweep_is_removed(tmp_path: Path) -> None:
    write_sweep(SPECS[:2], tmp_path, Counting(solved))
    assert (tmp_path / "pareto.png").exists()
    for path in (*results_folder(tmp_path).glob("design-*"), *(tmp_path / "layouts").iterdir()):
        path.unlink()
    swept = write_sweep(SPECS[:2], tmp_path, Counting())
    assert swept.files == (tmp_path / "sweep.csv",)
    assert not (tmp_path / "pareto.png").exists()
    assert swept.files[0].read_text().count("infeasible") == 2


def test_groups_hold_each_spec_once_and_begin_with_the_most_mirrors() -> None:
    specs = [DesignSpec(rows=r, cols=c, tradeoff=w) for w in (0.1, 0.5) for r, c in ((2, 2), (3, 3), (2, 3))]
    groups = grouped(specs)
    assert sorted(number for group in groups for number in group) == list(range(len(specs)))
    assert all(len({structure(specs[number]) for number in group}) == 1 for group in groups)
    counts = [specs[group[0]].rows * specs[group[0]].cols for group in groups]
    assert counts == [9, 6, 4]


def test_a_request_holds_the_values_that_designs_combine_and_the_fields_in_common(tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(
        "counts = [[1, 2], [2, 2]]\nscales_mm = [60]\ntradeoffs = [0.3, 0.6]\ndepth_sets_mm = [[300, 500], [400]]\n"
        '[common]\ncamera = "d435"\nspacing_mm = 2.0\n'
    )
    common = DesignSpec(camera=read_camera("d435"), spacing_mm=2.0)
    assert read_sweep(path).specs() == grid(
        common,
        counts=[(1, 2), (2, 2)],
        depth_sets_mm=[(300.0, 500.0), (400.0,)],
        scales_mm=[60.0],
        tradeoffs=[0.3, 0.6],
    )
    path.write_text("")
    assert read_sweep(path).specs() == SweepRequest().specs()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("counts = [[0, 3]]", "counts: 0x3: rows: Input should be greater than or equal to 1"),
        ("counts = []", "counts: no value"),
        ("counts = [[2, 2], [2, 2]]", "counts: 2x2 is given twice"),
        ('counts = ["2x2"]', "counts.0: Input should be a valid"),
        ("depth_sets_mm = [[300, -5]]", "depths_mm.1: Input should be greater than or equal to 0.001"),
        ("scales_mm = [nan]", "scales_mm.0: Input should be a finite number"),
        ("tradeoffs = [1.5]", "tradeoffs.0: Input should be less than or equal to 1"),
        ("[common]\nspacing_mm = -1", "common.spacing_mm: Input should be greater than or equal to 0"),
        ("[common]\nrows = 3", "common.rows: varied by the sweep"),
        ("[common]\npattern = {positions = [[0, 0], [1, 0]]}", "common.pattern: varied by the sweep"),
        ('[common]\ncamera = "nikon"', "camera: camera 'nikon': expected one of"),
        ("scale_mm = [80]", "scale_mm: not known"),
    ],
)
def test_what_is_no_request_for_a_sweep_is_refused_in_one_line(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_sweep(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)
