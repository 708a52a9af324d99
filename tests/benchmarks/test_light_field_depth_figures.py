"""Figures of depth on scenes: what is on their axes, and the same bytes for the same scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.patches import Rectangle

from benchmarks.light_field_depth import BAD_PX
from benchmarks.light_field_depth_figures import BOUNDS, draw_reliability, draw_scene, half_normal
from tests.benchmarks.test_light_field_depth_errors import drawn_scene
from tests.drawn import drawn, values_of


def test_true_confidence_is_drawn_on_the_diagonal_and_true_sigmas_on_the_half_normal(tmp_path: Path) -> None:
    scenes = [drawn_scene(seed=1), drawn_scene(seed=2)]
    path = tmp_path / "figure.png"
    figure = drawn(lambda: draw_reliability(path, scenes), path)
    share, near, exceed, count = figure.axes
    diagonal, one, two, pooled = share.get_lines()[:4]
    np.testing.assert_array_equal(diagonal.get_xydata(), [[0.0, 0.0], [1.0, 1.0]])
    assert len(np.asarray(one.get_xydata())) == len(BOUNDS) - 1
    for line in (one, two, pooled):
        stated, right = np.asarray(line.get_xydata()).T
        np.testing.assert_allclose(right, stated, atol=0.05)
    assert share.get_legend_handles_labels()[1] == ["stated = right", "plane", "plane", "all, 95 % interval"]
    bars = [bar for bar in count.patches if isinstance(bar, Rectangle)]
    assert sum(bar.get_height() for bar in bars) == sum(int(each.judged.sum()) for each in scenes)
    normal = np.asarray(near.get_lines()[-1].get_ydata())
    np.testing.assert_allclose(normal, half_normal(np.asarray(near.get_lines()[0].get_xdata())))
    # Half of the depths are right, and those have the sigma that is stated.
    below = np.asarray(near.get_lines()[0].get_ydata())
    np.testing.assert_allclose(below, 0.5 * normal, atol=0.01)
    np.testing.assert_allclose(below + np.asarray(exceed.get_lines()[0].get_ydata()), 1.0)


def test_the_half_normal_is_that_of_tables() -> None:
    np.testing.assert_allclose(half_normal(np.array([0.0, 0.67449, 1.0, 3.0])), [0.0, 0.5, 0.68269, 0.99730], atol=1e-5)


def test_maps_of_a_scene_are_its_errors_and_mark_what_is_bad(tmp_path: Path) -> None:
    scene, path = drawn_scene(), tmp_path / "scene.png"
    figure = drawn(lambda: draw_scene(path, scene), path)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title().partition(",")[0].partition(":")[0] for axes in panels] == [
        "plane",
        "true disparity",
        "disparity found",
        "|error|",
        "|error| / sigma",
        "confidence",
    ]
    images = [axes.get_images()[0] for axes in panels]
    np.testing.assert_array_equal(values_of(images[5]), scene.confidence)
    error = np.ma.filled(values_of(images[3]), np.nan)
    np.testing.assert_allclose(error[scene.judged], np.abs(scene.disparity_px)[scene.judged], rtol=1e-6)
    assert np.isnan(error[~scene.judged]).all()
    just_good, just_bad = images[3].to_rgba(np.array([0.99 * BAD_PX, 1.01 * BAD_PX]))
    assert just_good[2] > just_good[0]  # blue
    assert just_bad[0] > just_bad[2]  # yellow


def test_the_same_scenes_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        draw_reliability(tmp_path / name / "figure.png", [drawn_scene()])
        draw_scene(tmp_path / name / "scene.png", drawn_scene())
    for name in ("figure.png", "scene.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
