"""Covariances of files, and the derivatives by their parameters."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.bench.scores.consistency import covariance_root, d_parameters, with_covariance
from mirrorcam.bench.scores.gauge import project_by_view, score_points
from mirrorcam.bench.scores.matched_views import matched_views
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.read.registry import rig_of
from mirrorcam.optics.geometry.layout import Uncertainty
from mirrorcam.optics.geometry.transforms import rigid
from tests.optics.camera_files.rigs import DISTANCE_MM, changed, device, lens_of, pose_of, true_rig


def written(path: Path, parameters: list[str], covariance: object, schema: str = "mirrorcam.covariance/1") -> Path:
    path.write_text(json.dumps({"schema": schema, "parameters": parameters, "covariance": covariance}))
    return path


def test_derivatives_are_what_changes_do(tmp_path: Path) -> None:
    names = ["all fx_px", "view_0_1 k1", "view_0_1 ry_rad", "view_1_0 tz_mm", "view_0_0 p2"]
    rig = with_covariance(true_rig(device().truth), written(tmp_path / "c.json", names, np.eye(5).tolist()))
    views = matched_views(rig, device().truth, device().nominal)
    points = score_points(device().truth, range(6), DISTANCE_MM)
    found = d_parameters(rig, views, points.view, points.points_in_rig)

    def pixels(of: object) -> np.ndarray:
        matched = matched_views(of, device().truth, device().nominal)  # type: ignore[arg-type]
        return project_by_view(matched, points.view, points.points_in_rig)[0]

    base, step = pixels(rig), 1e-5
    longer = rig
    for number, camera in enumerate(rig.cameras):
        longer = changed(longer, number, lens=lens_of(camera).replaced(fx_px=lens_of(camera).fx_px + step))
    turn = rigid(Rotation.from_rotvec([0.0, step, 0.0]).as_matrix(), np.zeros(3))
    shift = rigid(np.eye(3), [0.0, 0.0, step])
    cameras = rig.cameras
    distortion = np.array(lens_of(cameras[1]).distortion)
    distortion[0] += step
    others = [
        longer,
        changed(rig, 1, lens=lens_of(cameras[1]).replaced(distortion=distortion)),
        changed(rig, 1, camera_from_rig=turn @ pose_of(cameras[1])),
        changed(rig, 3, camera_from_rig=shift @ pose_of(cameras[3])),
    ]
    for place, other in enumerate(others):
        expected = (pixels(other) - base) / step
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[:, :, place], expected, atol=1e-4 * scale)
    assert not found[points.view != 0, :, 4].any()


@pytest.mark.parametrize(
    ("parameters", "covariance", "schema", "complaint"),
    [
        (["all fz"], [[1.0]], "mirrorcam.covariance/1", "parameter 'all fz', expected CAMERA NAME"),
        (["cam9 fx_px"], [[1.0]], "mirrorcam.covariance/1", "parameter 'cam9 fx_px', expected CAMERA NAME"),
        (["all fx_px"] * 2, np.eye(2).tolist(), "mirrorcam.covariance/1", "a parameter appears twice"),
        (["all fx_px"], np.eye(2).tolist(), "mirrorcam.covariance/1", "covariance has shape (2, 2), expected (1, 1)"),
        (["all fx_px"], [[1.0]], "mirrorcam.layout/1", "schema"),
    ],
)
def test_what_is_no_covariance_is_refused_in_one_line(
    parameters: list[str], covariance: object, schema: str, complaint: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        with_covariance(true_rig(device().truth), written(tmp_path / "c.json", parameters, covariance, schema))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_layout_has_its_own(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="contains its covariance"):
        with_covariance(rig_of(device().truth), written(tmp_path / "c.json", [], []))


def test_a_root_is_one_and_what_has_none_is_refused() -> None:
    random = np.random.default_rng(0)
    half = random.normal(size=(4, 4)) * np.array([1e-6, 1.0, 100.0, 1e-3])[:, None]
    covariance = half @ half.T
    root = covariance_root(Uncertainty(parameters=tuple("abcd"), covariance=covariance))
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-6, atol=1e-20)
    for wrong in (np.diag([1.0, -1.0]), np.array([[1.0, 2.0], [2.0, 1.0]]), np.array([[1.0, 0.5], [0.0, 1.0]])):
        with pytest.raises(InputError, match="the covariance "):
            covariance_root(Uncertainty(parameters=("a", "b"), covariance=wrong))


def test_parameters_of_another_layout_are_refused() -> None:
    rig = rig_of(device().truth)
    rig = replace(rig, uncertainty=Uncertainty(parameters=("mirror 9 x_mm",), covariance=np.eye(1)))
    layout = device().truth.replaced(uncertainty=rig.uncertainty)
    points = score_points(device().truth, [0], DISTANCE_MM)
    with pytest.raises(InputError, match="'mirror 9 x_mm'"):
        d_parameters(replace(rig, layout=layout), (), points.view, points.points_in_rig)
