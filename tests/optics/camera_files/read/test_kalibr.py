"""Kalibr's camchain: our exports score zero, and every model projects by Kalibr's formulas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.read.kalibr import is_kalibr, read_kalibr
from tests.optics.camera_files.rigs import EXACT, device, pose_of

CAMERA: dict[str, Any] = {
    "camera_model": "pinhole",
    "distortion_coeffs": [0.0, 0.0, 0.0, 0.0],
    "distortion_model": "radtan",
    "intrinsics": [500.0, 510.0, 320.0, 240.0],
    "resolution": [640, 480],
    "rostopic": "/cam/image_raw",
}
T = np.eye(4) + np.array([[0.0] * 3 + [0.1], [0.0] * 4, [0.0] * 4, [0.0] * 4])


def written(folder: Path, **cameras: object) -> Path:
    path = folder / "camchain.yaml"
    path.write_text(yaml.safe_dump(cameras))
    return path


def rays() -> FloatArray:
    random = np.random.default_rng(0)
    return random.uniform([-0.5, -0.5, 0.8], [0.5, 0.5, 2.0], (50, 3))


def test_our_own_scores_zero(exported: Path) -> None:
    rig = read_kalibr(exported / "kalibr_camchain.yaml")
    score = device().score(rig)
    assert score.figures["max_px"].value < EXACT
    assert list(score.views.values()) == [camera.name for camera in rig.cameras]
    assert abs(score.figures["scale_error_percent"].value) < EXACT  # in metres


def test_poses_follow_the_chain(tmp_path: Path) -> None:
    turn = [[0.0, -1.0, 0.0, 0.2], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
    path = written(tmp_path, cam0=CAMERA, cam1=CAMERA | {"T_cn_cnm1": T.tolist()}, cam2=CAMERA | {"T_cn_cnm1": turn})
    rig = read_kalibr(path)
    assert [camera.name for camera in rig.cameras] == ["cam0", "cam1", "cam2"]
    np.testing.assert_allclose(pose_of(rig.cameras[1]), T)
    np.testing.assert_allclose(pose_of(rig.cameras[2]), np.array(turn) @ T)
    assert rig.unit_mm == 1000.0
    assert rig.cameras[0].size_px == (640, 480)


def test_poses_relative_to_an_imu_replace_a_missing_chain(tmp_path: Path) -> None:
    path = written(tmp_path, cam0=CAMERA | {"T_cam_imu": T.tolist()}, cam1=CAMERA | {"T_cam_imu": np.eye(4).tolist()})
    np.testing.assert_allclose(pose_of(read_kalibr(path).cameras[0]), T)


@pytest.mark.parametrize("model", ["omni", "eucm", "ds"])
@pytest.mark.parametrize("distortion", ["radtan", "equidistant", "none"])
def test_models_are_kalibrs(model: str, distortion: str, tmp_path: Path) -> None:
    """Kalibr's projections, restated; `distort` acts on the plane that they project to."""
    sphere = {"omni": [0.9], "eucm": [0.6, 1.1], "ds": [-0.2, 0.55]}[model]
    coefficients = [] if distortion == "none" else [0.05, -0.02, 0.001, -0.002]
    changes = {"camera_model": model, "intrinsics": [*sphere, *CAMERA["intrinsics"]]}
    path = written(
        tmp_path, cam0=CAMERA | changes | {"distortion_model": distortion, "distortion_coeffs": coefficients}
    )
    points = rays()
    x, y, z = points.T
    d1 = np.linalg.norm(points, axis=1)
    if model == "omni":
        below = z + sphere[0] * d1
    elif model == "eucm":
        below = sphere[0] * np.sqrt(sphere[1] * (x**2 + y**2) + z**2) + (1 - sphere[0]) * z
    else:
        k = sphere[0] * d1 + z
        below = sphere[1] * np.sqrt(x**2 + y**2 + k**2) + (1 - sphere[1]) * k
    x, y = x / below, y / below
    r2 = x**2 + y**2
    if distortion == "radtan":
        k1, k2, p1, p2 = coefficients
        radial = k1 * r2 + k2 * r2**2
        x, y = (
            x + x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
            y + y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y**2),
        )
    elif distortion == "equidistant":
        r = np.sqrt(r2)
        angle = np.arctan(r)
        k1, k2, k3, k4 = coefficients
        factor = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8) / r
        x, y = x * factor, y * factor
    expected = np.column_stack([500.0 * x + 320.0, 510.0 * y + 240.0])
    np.testing.assert_allclose(read_kalibr(path).cameras[0].lens.project(points), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"camera_model": "cylinder"}, "camera_model 'cylinder', expected one of pinhole, omni, eucm, ds"),
        ({"distortion_model": "fov"}, "distortion_model 'fov', expected radtan"),
        ({"intrinsics": [1.0, 2.0]}, "intrinsics: 2 numbers, expected 4"),
        ({"intrinsics": [500.0, 500.0, float("nan"), 1.0]}, "expected a finite number"),
        ({"intrinsics": [-500.0, 500.0, 1.0, 1.0]}, "fx_px"),
        ({"distortion_coeffs": "k1"}, "distortion_coeffs: 'k1', expected 4 numbers"),
        ({"resolution": [640.5, 480]}, "expected the size of a picture"),
        ({"resolution": None}, "resolution is missing"),
    ],
)
def test_what_is_no_camera_is_refused_in_one_line(changes: dict[str, object], complaint: str, tmp_path: Path) -> None:
    path = written(tmp_path, cam0=CAMERA | changes)
    with pytest.raises(InputError) as caught:
        read_kalibr(path)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_chain_with_a_gap_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cam1: T_cn_cnm1 is missing"):
        read_kalibr(written(tmp_path, cam0=CAMERA, cam1=CAMERA))
    with pytest.raises(InputError, match="cam0, cam1 and so on"):
        read_kalibr(written(tmp_path, cam0=CAMERA, cam7=CAMERA))
    stretched = (2.0 * T).tolist()
    with pytest.raises(InputError, match="not a rotation"):
        read_kalibr(written(tmp_path, cam0=CAMERA, cam1=CAMERA | {"T_cn_cnm1": stretched}))


def test_a_camchain_is_recognised() -> None:
    assert is_kalibr({"cam0": CAMERA})
    assert not is_kalibr({"cam0": 1})
    assert not is_kalibr([CAMERA])
