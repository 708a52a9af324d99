"""Figures of a design: two layouts at their true size, and circles of confusion with marks at working depths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.designs.design_figure import COMMON, VIEW, _figures, before_after, focus_figure
from mirrorcam.optics.design.assess.focus import focus_metrics
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import fields_of_view
from tests.drawn import drawn
from tests.optics.seeing_mirrors import two_rectangles


@pytest.fixture(scope="module")
def picture(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("figure") / "before_after.png"
    before_after(faceted_parabola(DesignSpec()), default_layout, path)
    return path


def greenish(image: NDArray[np.uint8]) -> int:
    """Pixels inside a region that all views see: its fill over white or over the blue of sub-images."""
    red, green, blue = image.astype(int).transpose(2, 0, 1)
    return int(((green - red > 20) & (green - blue > 10)).sum())


def test_the_optimised_layout_is_drawn_next_to_the_parabola_and_overlaps_more(picture: Path) -> None:
    image = read_image(picture)
    height, width, _ = image.shape
    assert 1200 < width < 2400
    assert 0.5 < height / width < 1.2
    left, right = greenish(image[:, : width // 2]), greenish(image[:, width // 2 :])
    assert left > 0.005 * image[..., 0].size
    assert right > 1.8 * left


def test_nothing_is_cut_off_at_the_border(picture: Path) -> None:
    image = read_image(picture)
    border = np.concatenate([image[:2].reshape(-1, 3), image[-2:].reshape(-1, 3), image[:, 0], image[:, -1]])
    assert (border > 250).all()


@pytest.mark.slow
def test_the_same_layouts_give_the_same_bytes(picture: Path, default_layout: Layout, tmp_path: Path) -> None:
    before_after(faceted_parabola(DesignSpec()), default_layout, tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == picture.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["again.png"]


def test_virtual_cameras_are_drawn_in_their_colour(picture: Path) -> None:
    wanted = [int(VIEW[k : k + 2], 16) for k in (1, 3, 5)]
    image = read_image(picture).astype(int)
    # Two layouts, nine views each from the side and along the view, a few dozen pixels a mark.
    assert (np.abs(image - wanted).max(axis=-1) < 12).sum() > 2 * 9 * 20
    assert wanted != [int(COMMON[k : k + 2], 16) for k in (1, 3, 5)]


def test_figures_are_those_of_the_metrics(default_layout: Layout) -> None:
    assert _figures(faceted_parabola(DesignSpec(fold_deg=90.0)), [300.0, 500.0]) == (
        "grid error 0.275 of a spacing, usable pixels 8% at 300 mm, 19% at 500 mm"
    )
    shares = [default_layout.metrics[f"usable_efficiency_{depth}mm"].value for depth in (300, 500)]
    text = _figures(default_layout, [300.0, 400.0, 500.0])
    assert f"{min(shares):.0%} to " in text
    assert text.endswith("at 300 to 500 mm")


@pytest.mark.parametrize("depths_mm", [(300.0,), (200.0, 300.0, 600.0)])
def test_any_number_of_depths_and_mirrors(depths_mm: tuple[float, ...], tmp_path: Path) -> None:
    parabola = faceted_parabola(DesignSpec(rows=1, cols=2, depths_mm=depths_mm))
    before_after(parabola, parabola, tmp_path / "figure.png")
    image = read_image(tmp_path / "figure.png")
    assert greenish(image) > 0.02 * image[..., 0].size


def test_a_layout_that_shares_nothing_is_drawn_all_the_same(default_layout: Layout, tmp_path: Path) -> None:
    mirror = default_layout.mirrors[0]
    corner = mirror.outline_normalized
    tiny = mirror.replaced(outline_in_rig_mm=mirror.intersect(corner[3] + 0.02 * (corner - corner[3])))
    broken = default_layout.replaced(mirrors=(tiny, *default_layout.mirrors[1:]))
    before_after(broken, default_layout, tmp_path / "figure.png")
    image = read_image(tmp_path / "figure.png")
    assert greenish(image[:, : image.shape[1] // 2]) < 0.002 * image[..., 0].size


def test_an_optimum_without_a_parabola_stands_alone(picture: Path, default_layout: Layout, tmp_path: Path) -> None:
    before_after(None, default_layout, tmp_path / "alone.png")
    both, alone = read_image(picture), read_image(tmp_path / "alone.png")
    assert alone.shape[0] == both.shape[0]
    assert alone.shape[1] == both.shape[1] // 2
    assert greenish(alone) == pytest.approx(greenish(both[:, both.shape[1] // 2 :]), rel=0.1)


def test_many_views_do_not_hide_what_they_share(tmp_path: Path) -> None:
    spec = DesignSpec(rows=6, cols=6, spacing_mm=0.3, depths_mm=(2000.0,))
    parabola = faceted_parabola(spec).replaced(spec=spec)
    before_after(None, parabola, tmp_path / "many.png")
    image = read_image(tmp_path / "many.png").astype(int)
    # Where all views lie on each other the blue stays light: only lines are as dark as the colour of mirrors.
    below = image[-int(3.9 * 110) :]
    dark = np.abs(below - [0x44, 0x77, 0xAA]).max(axis=-1) < 25
    assert 0.001 < dark.mean() < 0.05


DEPTHS_MM = (300.0, 500.0)


def test_worst_marks_are_the_figures_of_the_layout(fold_90_layout: Layout, tmp_path: Path) -> None:
    path = tmp_path / "focus.png"
    axes = drawn(lambda: focus_figure(fold_90_layout, DEPTHS_MM, path), path).axes[0]
    marks = np.array([line.get_ydata() for line in axes.lines if line.get_marker() == "o"])
    curves = [line for line in axes.lines if line.get_linewidth() == 1.6]
    assert len(marks) == len(curves) == 6
    found = focus_metrics(fields_of_view(fold_90_layout), DEPTHS_MM)
    given = [found[f"circle_of_confusion_{depth:g}mm"].value for depth in DEPTHS_MM]
    assert marks[:3].max(axis=0) == pytest.approx(given)
    assert marks[3:].max() == pytest.approx(found["circle_at_best_focus_px"].value)
    for curve, mark in zip(curves, marks, strict=True):
        depths, circles = (np.asarray(data, dtype=np.float64) for data in curve.get_data())
        assert np.interp(DEPTHS_MM, depths, circles) == pytest.approx(mark, abs=0.02)
    legend = axes.get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    assert "central mirror, 1-1" in texts
    assert {"in focus at 500 mm", "best focus, 402 mm", "limit, 2 px"} <= set(texts)


def test_a_mirror_that_is_nearest_and_central_has_one_curve(tmp_path: Path) -> None:
    path = tmp_path / "focus.png"
    axes = drawn(lambda: focus_figure(two_rectangles(), (300.0,), path), path).axes[0]
    assert len([line for line in axes.lines if line.get_linewidth() == 1.6]) == 4
    legend = axes.get_legend()
    assert legend is not None
    # Of two mirrors, the second counts as the middle, and 80 mm above the pupil it is the nearer one.
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts[:2] == ["nearest and central mirror, 1-0", "farthest mirror, 0-0"]
    assert axes.get_xscale() == "linear"


def test_depths_far_apart_are_on_a_logarithmic_axis(default_layout: Layout, tmp_path: Path) -> None:
    path = tmp_path / "focus.png"
    axes = drawn(lambda: focus_figure(default_layout, (200.0, 2500.0), path), path).axes[0]
    assert axes.get_xscale() == "log"
