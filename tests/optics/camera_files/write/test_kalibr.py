"""Kalibr's camchain, with Kalibr's own formulas, projects as the layout does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write import virtual_cameras, write_exports
from mirrorcam.optics.camera_files.write.held_lens import KALIBR
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.camera_files.write.conftest import TOLERANCE_PX, Case, seen_through, without_k3
from tests.optics.camera_files.write.read_back import assert_projects


def kalibr_cameras(text: str) -> list[dict[str, Any]]:
    """The chain as Kalibr's ConfigReader takes it: its checks, restated."""
    chain = yaml.safe_load(text)
    cameras = [chain[f"cam{place}"] for place in range(len(chain))]
    for place, camera in enumerate(cameras):
        assert camera["camera_model"] == "pinhole"
        assert camera["distortion_model"] == "radtan"
        assert len(camera["distortion_coeffs"]) == 4
        assert len(camera["intrinsics"]) == 4
        assert all(type(value) is float for value in camera["intrinsics"] + camera["distortion_coeffs"])
        assert min(camera["intrinsics"]) >= 0.0
        assert all(type(side) is int for side in camera["resolution"])
        assert isinstance(camera["rostopic"], str)
        assert place not in camera["cam_overlaps"]
        assert ("T_cn_cnm1" in camera) == (place > 0)
    return cameras


def radtan_pixels(points: FloatArray, camera: dict[str, Any]) -> FloatArray:
    """Kalibr's pinhole-radtan model."""
    k1, k2, p1, p2 = camera["distortion_coeffs"]
    fu, fv, pu, pv = camera["intrinsics"]
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    rho = x * x + y * y
    radial = k1 * rho + k2 * rho * rho
    xd = x + x * radial + 2.0 * p1 * x * y + p2 * (rho + 2.0 * x * x)
    yd = y + y * radial + 2.0 * p2 * x * y + p1 * (rho + 2.0 * y * y)
    return np.column_stack([fu * xd + pu, fv * yd + pv])


def test_kalibr(case: Case, folder: Path) -> None:
    cameras = kalibr_cameras((folder / "kalibr_camchain.yaml").read_text(encoding="utf-8"))
    assert len(cameras) == len(case.views)
    cam_from_cam0 = np.eye(4)
    for place, camera in enumerate(cameras):
        if place > 0:
            cam_from_cam0 = np.array(camera["T_cn_cnm1"]) @ cam_from_cam0
        in_rig = np.column_stack([case.points_in_rig[place], np.full(len(case.points_in_rig[place]), 1.0)])
        in_cam0 = in_rig @ case.views[0].camera_from_rig.T / 1000.0
        in_cam0[:, 3] = 1.0
        found = radtan_pixels((in_cam0 @ cam_from_cam0.T)[:, :3], camera)
        off = np.linalg.norm(found - case.flipped_px[place], axis=1)
        # The lens's k3, where it has one, is met by the other four as well as they can, and the file says how well.
        assert off.max() <= KALIBR.of(case.views[place]).error_px + TOLERANCE_PX
        assert off.max() < 0.02


def test_kalibr_of_a_lens_without_k3_is_exact(case: Case, tmp_path: Path) -> None:
    layout = without_k3(case.layout)
    views = virtual_cameras(layout)
    write_exports(layout, tmp_path)
    camera = kalibr_cameras((tmp_path / "kalibr_camchain.yaml").read_text(encoding="utf-8"))[0]
    points = seen_through(layout, 0)
    in_camera = transform(views[0].camera_from_rig, points)
    assert_projects(radtan_pixels(in_camera, camera), views[0].project(points))
