"""What the comparison of depth on foreign scenes says of scenes with a known answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.light_field_depth_errors import RIGHT_PX
from benchmarks.light_field_depth_scenes import judged, main, report, truth_of
from mirrorcam.core.images.pfm import write_pfm
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.formats.hci import HciScene, write_hci
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


@pytest.fixture(scope="module")
def scene() -> HciScene:
    light_field, depth, _ = photograph(grid_views(uneven=False), [Surface(420.0, slope=(0.2, 0.1))])
    disparity = light_field.disparity_px_from_depth(depth).astype(np.float32)
    return HciScene(light_field, disparity, (float(disparity.min()) - 1.0, float(disparity.max()) + 1.0))


def test_a_truth_that_lacks_a_border_is_put_in_the_middle(scene: HciScene, tmp_path: Path) -> None:
    assert scene.disparity_px is not None
    write_pfm(tmp_path / "inner.pfm", scene.disparity_px[5:-5, 5:-5] / np.float32(4.0))
    truth = truth_of(scene, tmp_path / "inner.pfm", 4)
    assert np.isnan(truth[:5]).all() and np.isnan(truth[:, -5:]).all()
    np.testing.assert_allclose(truth[5:-5, 5:-5], scene.disparity_px[5:-5, 5:-5], rtol=1e-6)


def test_a_scene_without_a_truth_is_refused(scene: HciScene) -> None:
    with pytest.raises(InputError, match=r"expected gt_disp_lowres\.pfm in its folder, or SCENE=TRUTH\.pfm"):
        truth_of(replace(scene, disparity_px=None), None, 1)


def test_a_scene_is_judged_beside_stereo(
    scene: HciScene, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmarks.light_field_depth_scenes.best_stereo", lambda *_: ({"bad": 9.0, "mse": 8.0}, {}))
    assert scene.disparity_px is not None
    result = judged("plane", scene, scene.disparity_px, 1, "fast")
    assert result.ours["bad"] < 20.0
    assert result.seconds > 0 and result.pair_seconds > 0
    assert result.sgbm == {"bad": 9.0, "mse": 8.0}
    measured = result.measured
    assert measured.judged.sum() == (90 - 30) * (120 - 30)
    assert np.mean(measured.error_px[measured.judged] < RIGHT_PX) > 0.9
    report([result])
    said = capsys.readouterr().out
    assert f"{result.ours['bad']:8.2f}" in said and "9.00 /   8.00" in said
    shares = [float(line.split(";")[1].split("%")[0]) for line in said.splitlines() if "of the pixels" in line]
    assert sum(shares) == pytest.approx(100.0, abs=0.05 * len(shares))


def test_figures_are_made_without_the_search_for_the_best_stereo(
    scene: HciScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def searched(*_: object) -> None:
        raise AssertionError("it was searched")

    monkeypatch.setattr("benchmarks.light_field_depth_scenes.best_stereo", searched)
    write_hci(tmp_path / "plane", scene.light_field, scene.depth_mm)
    figures = ["--figure", str(tmp_path / "figure.png"), "--pictures", str(tmp_path / "pictures")]
    main(["--no-sgbm", "--fast", *figures, str(tmp_path / "plane")])
    assert read_image(tmp_path / "figure.png").shape[1] > 1000
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["plane.png"]
