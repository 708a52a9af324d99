"""The figure of a sweep shows every solved design, its fronts, and counts in their colours beside the data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import Metric
from mirrorcam.designs.sweep_figure import (
    EFFICIENCY,
    FIELD_OF_VIEW,
    FRONT,
    GRID_ERROR,
    _against_count,
    _front,
    count_colours,
    pareto,
)
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.nightly import a_few


def made_up(rows: int, cols: int, number: int, farthest_mm: float = 900.0) -> Outcome:
    """A solved design whose figures get worse with the count, and trade along `number`."""
    spec = DesignSpec(rows=rows, cols=cols, depths_mm=(300.0,), tradeoff=number / 10.0)
    size = rows * cols + 0.37 * rows
    values = {
        "grid_error": 0.3 - 0.02 * number,
        "pixel_efficiency_300mm": 0.9 - 0.03 * number - 0.005 * size,
        "fov_x_deg": 60.0 - size + number,
        "fov_y_deg": 30.0 - size / 2.0,
        "depth_nearest_mm": 150.0 + 10.0 * number + size,
        "depth_farthest_mm": farthest_mm,
    }
    metrics = {name: Metric(value=value, unit="") for name, value in values.items()}
    return Outcome(spec=spec, status="solved", metrics=metrics)


COUNTS = [(rows, cols) for rows in range(1, 8) for cols in range(1, 8) if rows * cols > 1]


@pytest.fixture(scope="module", params=a_few(1, [pytest.param(4, id="few"), pytest.param(192, id="many")]))
def picture(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Outcome], Path]:
    each, counts = (2, COUNTS[:2]) if request.param == 4 else (4, COUNTS)
    outcomes = [made_up(*count, number) for count in counts for number in range(each)]
    path = tmp_path_factory.mktemp("figure") / "pareto.png"
    pareto(outcomes, path)
    assert len(outcomes) == request.param
    return outcomes, path


def of_colour(image: NDArray[np.uint8], colour: str) -> NDArray[np.bool_]:
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return np.asarray(np.abs(image.astype(int) - wanted).max(axis=-1) < 8)


def test_every_count_has_its_colour_among_the_data_and_in_the_legend(picture: tuple[list[Outcome], Path]) -> None:
    outcomes, path = picture
    image = read_image(path)
    colours = count_colours(outcomes)
    assert len(set(colours.values())) == len(colours)
    columns = -(-len(colours) // 30)
    legend = round(image.shape[1] * (1.0 - (1.0 + 0.85 * columns) / 15.0))
    for colour in colours.values():
        assert of_colour(image[:, :legend], colour).sum() > 30
        assert of_colour(image[:, legend:], colour).sum() > 30


def test_designs_stand_over_their_count_and_the_best_of_each_are_joined() -> None:
    outcomes = [made_up(1, 2, 0), made_up(1, 2, 3), made_up(2, 2, 1)]
    axes = Figure().subplots()
    _against_count(axes, outcomes, GRID_ERROR, count_colours(outcomes))
    pair, single, best = (np.array(line.get_xydata()) for line in axes.get_lines())
    assert pair[:, 1] == pytest.approx([0.3, 0.24]) and np.abs(pair[:, 0]).max() < 0.5
    assert single[0] == pytest.approx([1.0, 0.28])
    assert best[:, 1] == pytest.approx([0.24, 0.28])


def test_nothing_is_cut_off_at_the_border(picture: tuple[list[Outcome], Path]) -> None:
    image = read_image(picture[1])
    border = np.concatenate([image[:2].reshape(-1, 3), image[-2:].reshape(-1, 3), image[:, :2].reshape(-1, 3)])
    assert (border > 250).all()
    assert (image[:, -2:] > 250).all()


def test_the_front_of_all_is_drawn(picture: tuple[list[Outcome], Path]) -> None:
    image = read_image(picture[1])
    assert of_colour(image[: image.shape[0] // 2, : image.shape[1] // 2], FRONT).sum() > 100


@pytest.mark.slow
def test_the_same_outcomes_give_the_same_bytes(picture: tuple[list[Outcome], Path], tmp_path: Path) -> None:
    outcomes, path = picture
    pareto(outcomes, tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == path.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["again.png"]


def test_unsolved_outcomes_are_left_out_and_alone_are_refused(tmp_path: Path) -> None:
    outcomes = [made_up(2, 2, number) for number in range(3)]
    unsolved = Outcome(spec=DesignSpec(), status="infeasible", constraint="depth")
    pareto(outcomes, tmp_path / "solved.png")
    pareto([unsolved, *outcomes], tmp_path / "all.png")
    assert (tmp_path / "all.png").read_bytes() == (tmp_path / "solved.png").read_bytes()
    with pytest.raises(ValueError, match="no solved design among 1"):
        pareto([unsolved], tmp_path / "none.png")


def test_a_design_without_a_common_depth_is_drawn_where_it_has_figures(tmp_path: Path) -> None:
    blind = made_up(2, 2, 1)
    blind = blind.replaced(metrics={name: m for name, m in blind.metrics.items() if not name.startswith("depth_")})
    pareto([blind], tmp_path / "pareto.png")
    assert of_colour(read_image(tmp_path / "pareto.png"), count_colours([blind])[2, 2]).sum() > 100


def test_infinite_depth_ranges_have_their_own_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    saving = Figure.savefig

    def seen(figure: Figure, *arguments: Any, **options: Any) -> None:
        figures.append(figure)
        saving(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", seen)
    pareto([made_up(2, 2, 0), made_up(2, 2, 1, farthest_mm=1e5)], tmp_path / "pareto.png")
    markers = [[line.get_marker() for line in axes.lines] for axes in figures[0].axes]
    assert [axis.count("^") for axis in markers] == [1, 0, 0, 0, 0, 0]
    assert any("100 m" in text.get_text() for text in figures[0].legends[0].get_texts())


def test_fronts_know_what_is_better() -> None:
    points = [(0.1, 0.5), (0.2, 0.6), (0.2, 0.4), (0.3, 0.55)]
    assert _front(points, GRID_ERROR, EFFICIENCY) == [(0.2, 0.6), (0.1, 0.5)]
    assert _front(points, FIELD_OF_VIEW, EFFICIENCY) == [(0.2, 0.6), (0.3, 0.55)]
