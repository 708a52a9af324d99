"""Comparison of layouts from files: where points are taken, what is refused, and the figures of every view."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure

from mirrorcam.calibration.comparison import (
    FILES,
    compare_files,
    comparison_metrics,
    difference_figure,
    write_comparison,
)
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import SIGMA
from mirrorcam.optics.calibration.diagnostics.calibration_difference import calibration_difference
from mirrorcam.optics.camera_files.write import write_exports
from mirrorcam.optics.geometry.layout import Layout
from tests.drawn import drawn, values_of
from tests.optics.calibration.sound_calibration import nominal_layout, sound_calibration


@pytest.fixture
def files(tmp_path: Path, small_layout: Layout) -> Path:
    sound_calibration().layout.save(tmp_path / "calibrated.json")
    nominal_layout().save(tmp_path / "nominal.json")
    small_layout.save(tmp_path / "small.json")
    return tmp_path


def test_points_are_where_the_board_was_or_the_design_works_or_as_stated(files: Path) -> None:
    calibrated, nominal = files / "calibrated.json", files / "nominal.json"
    assert compare_files(calibrated, nominal, None).range_mm == sound_calibration().metrics["working_distance_mm"].value
    spec = nominal_layout().spec
    assert spec is not None
    assert compare_files(nominal, calibrated, None).range_mm == np.mean(spec.depths_mm)
    assert compare_files(nominal, calibrated, 700.0).range_mm == 700.0
    with pytest.raises(InputError, match=r"small\.json: no working distance in it, expected --distance-mm MM"):
        compare_files(files / "small.json", files / "small.json", None)


def test_another_device_is_refused_with_its_file(files: Path) -> None:
    with pytest.raises(InputError, match=r"small\.json: the second layout has 1 x 2 mirrors, expected 2 x 2"):
        compare_files(files / "nominal.json", files / "small.json", None)


def test_figures_of_every_view_and_of_all_are_written(files: Path) -> None:
    difference = compare_files(files / "nominal.json", files / "calibrated.json", 400.0)
    write_comparison(difference, nominal_layout(), files)
    assert all((files / name).is_file() for name in FILES)
    figures = json.loads((files / "metrics.json").read_text())
    assert figures["view_1_0_rms_px"]["value"] == difference.metrics([difference.views[2]])["rms_px"].value
    assert figures["all_ratio"]["value"] > 10.0
    assert {"distance_mm", "motion_turn_deg", "motion_shift_x_mm", "view_0_1_sigma_mm"} <= set(figures)


def test_the_direct_view_has_its_figures(small_layout: Layout, files: Path) -> None:
    small_layout.replaced(view_from_rig=np.eye(3)).save(files / "direct.json")
    found = comparison_metrics(compare_files(files / "direct.json", files / "direct.json", 400.0), small_layout)
    assert found["direct_rms_px"].value < 1e-9
    assert "all_sigma_px" not in found


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("opencv.yaml", "a calibration as opencv"),
        ("anipose/calibration.toml", "a calibration as anipose"),
        ("nerfstudio/transforms.json", "nerfstudio's cameras"),
        ("deeplabcut/camera_matrix/stereo_params.pickle", "pickles, such as DeepLabCut's, are never opened"),
    ],
)
def test_a_calibration_of_another_tool_is_named_and_a_layout_expected(files: Path, name: str, named: str) -> None:
    write_exports(nominal_layout(), files / "cameras")
    path = files / "cameras" / name
    for pair in ((path, files / "nominal.json"), (files / "nominal.json", path)):
        with pytest.raises(InputError) as caught:
            compare_files(*pair, None)
        assert f"{caught.value}".startswith(f"{path}: {named}")
        assert "expected a layout.json" in f"{caught.value}"


def test_a_layout_that_is_wrong_is_refused_as_one(files: Path) -> None:
    wrong = files / "wrong.json"
    wrong.write_text((files / "nominal.json").read_text().replace('"rows"', '"rosw"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"rosw: not known, did you mean rows\?"):
        compare_files(wrong, files / "nominal.json", None)


def maps(figure: Figure, panel: int) -> list[PatchCollection]:
    return [item for item in figure.axes[panel].collections if isinstance(item, PatchCollection)]


def test_every_view_is_shown_with_what_is_predicted_on_one_scale(tmp_path: Path) -> None:
    a, b = nominal_layout(), sound_calibration().layout
    difference = calibration_difference(a, b, range_mm=400.0)
    path = tmp_path / "difference.png"
    figure = drawn(lambda: difference_figure(difference, a, path), path)
    expected = [("length_px", "difference, px"), ("sigma_px", f"predicted {SIGMA} of B alone, px")]
    expected += [("difference_mm", "difference, mm"), ("sigma_mm", f"predicted {SIGMA} of B alone, mm")]
    for panel, (values, title) in enumerate(expected):
        assert figure.axes[panel].get_title().startswith(f"{title} (RMS of each view")
        shown = maps(figure, panel)
        assert len(shown) == len(difference.views) == 4
        for item, view in zip(shown, difference.views, strict=True):
            np.testing.assert_allclose(values_of(item), getattr(view, values))
        assert {item.get_clim() for item in shown} == {maps(figure, panel // 2 * 2)[0].get_clim()}


def test_nothing_is_predicted_of_layouts_without_covariance(small_layout: Layout, tmp_path: Path) -> None:
    """The direct view, of a layout whose views look along the camera's axis, has panels of its own."""
    layout = small_layout.replaced(view_from_rig=np.eye(3))
    difference = calibration_difference(layout, layout, range_mm=400.0)
    path = tmp_path / "difference.png"
    figure = drawn(lambda: difference_figure(difference, layout, path), path)
    assert [len(maps(figure, panel)) for panel in range(4)] == [2, 1, 2, 1]
