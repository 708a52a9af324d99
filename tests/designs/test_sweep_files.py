"""A sweep's folder holds a table, and a figure exactly where something was solved."""

from __future__ import annotations

import json
from pathlib import Path

from mirrorcam.core.disk.output_folder import results_folder
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import Metric
from mirrorcam.designs.design_sweep import table_of
from mirrorcam.designs.sweep_files import write_sweep
from mirrorcam.optics.design.spec_grid import Outcome
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
