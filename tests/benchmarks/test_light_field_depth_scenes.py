"""What the comparison of depth on foreign scenes says of scenes with a known answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.light_field_depth_scenes import RIGHT_PX, at_edges, judged, sigma_px, truth_of
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.io.formats.hci import HciScene
from mirrorcam.optics.light_field.io.pfm import write_pfm
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


def test_edges_are_those_of_depth_and_not_of_a_slanted_plane() -> None:
    v, u = np.mgrid[:60, :80].astype(np.float32)
    truth = 0.05 * u + 0.02 * v + np.where(u > 40, np.float32(1.0), np.float32(0.0))
    found = at_edges(truth.astype(np.float32), 1)
    assert found[:, 37:45].all()
    assert not found[:, 5:34].any()


def test_a_scene_is_judged_beside_stereo_with_errors_in_its_own_sigmas(
    scene: HciScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.light_field_depth_scenes.best_stereo", lambda *_: ({"bad": 9.0, "mse": 9.0}, {}))
    assert scene.disparity_px is not None
    result = judged("plane", scene, scene.disparity_px, 1, "fast")
    assert result.ours["bad"] < 20.0
    assert result.seconds > 0 and result.pair_seconds > 0
    assert len(result.error_px) == len(result.sigmas) == len(result.confidence) == (90 - 30) * (120 - 30)
    assert np.mean(result.error_px < RIGHT_PX) > 0.9
    found = DepthEstimator(scene.light_field).estimate(scene.light_field)
    near = found.depth_mm < np.nanmedian(found.depth_mm)
    # A pixel of the farthest view is less depth nearer by.
    per_mm = sigma_px(found) / found.sigma_mm
    assert np.nanmedian(per_mm[near]) > np.nanmedian(per_mm[~near])
