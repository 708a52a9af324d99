"""Lenses of every family in every format, read back by OpenCV, COLMAP or the format's own formula."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from numpy.typing import ArrayLike

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write import VirtualCamera, virtual_cameras, write_exports
from mirrorcam.optics.camera_files.write.held_lens import FORMATS, KALIBR, NERFSTUDIO, OPENCV, ROS
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import with_lens
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.camera_files.write.conftest import seen_through, sideways_layout

COEFFICIENTS: dict[LensName, list[float]] = {
    "rational": [0.2, -0.05, 8e-4, -1.5e-3, 0.02, 0.25, -0.03, 0.01],
    "thin_prism": [0.2, -0.05, 8e-4, -1.5e-3, 0.02, 0.25, -0.03, 0.01, 2e-3, -1e-3, -1.5e-3, 5e-4],
    "fisheye": [-0.01, 0.004, -0.002, 0.0005],
}


@pytest.fixture(scope="module", params=[*COEFFICIENTS, "spline"])
def layout(request: pytest.FixtureRequest) -> Layout:
    plain = sideways_layout()
    if request.param == "spline":
        camera = with_lens(plain.camera, "spline")
        field = 2e-5 * np.random.default_rng(0).standard_normal(len(camera.distortion) - 5)
        return plain.replaced(camera=camera.replaced(distortion=np.append(plain.camera.distortion, field)))
    lens = {"lens_model": request.param, "distortion": COEFFICIENTS[request.param]}
    return plain.replaced(camera=plain.camera.replaced(**lens))


@pytest.fixture(scope="module")
def folder(layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("lenses")
    write_exports(layout, out)
    return out


def in_camera(layout: Layout, view: VirtualCamera, number: int) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) mm from the view's camera, and where they appear in the flipped frame."""
    points = seen_through(layout, number)
    pixels = layout.project(points, number)
    pixels[:, 0] = layout.camera.width_px - 1 - pixels[:, 0]
    return transform(view.camera_from_rig, points), pixels


def by_opencv(points: FloatArray, model: str, matrix: ArrayLike, coefficients: ArrayLike) -> FloatArray:
    zero, matrix, distortion = np.zeros(3), np.array(matrix, np.float64), np.array(coefficients, np.float64)
    if model == "fisheye":
        return np.asarray(cv2.fisheye.projectPoints(points[None], zero, zero, matrix, distortion)[0], np.float64)[0]
    return np.asarray(cv2.projectPoints(points, zero, zero, matrix, distortion)[0], np.float64)[:, 0]


def matrix_of(fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def largest(found: FloatArray, expected: FloatArray) -> float:
    return float(np.linalg.norm(found - expected, axis=1).max())


def test_opencv_and_ros(layout: Layout, folder: Path) -> None:
    model = layout.camera.lens_model
    storage = cv2.FileStorage(str(folder / "opencv.yaml"), cv2.FILE_STORAGE_READ)
    for number, view in enumerate(virtual_cameras(layout)):
        points, pixels = in_camera(layout, view, number)
        node = storage.getNode("views").at(number)
        matrix, distortion = node.getNode("camera_matrix").mat(), node.getNode("distortion_coefficients").mat()
        assert largest(by_opencv(points, model, matrix, distortion), pixels) <= OPENCV.of(view).error_px + 1e-6
        info = yaml.safe_load((folder / "ros" / f"{view.name}.yaml").read_text(encoding="utf-8"))
        assert info["distortion_model"] == ("equidistant" if model == "fisheye" else "rational_polynomial")
        matrix = np.reshape(info["camera_matrix"]["data"], (3, 3))
        distortion = np.array(info["distortion_coefficients"]["data"])
        assert len(distortion) == (4 if model == "fisheye" else 8)
        assert largest(by_opencv(points, model, matrix, distortion), pixels) <= ROS.of(view).error_px + 1e-6


def test_colmap(layout: Layout, folder: Path) -> None:
    reconstruction = pycolmap.Reconstruction(folder / "colmap" / "sparse")
    images = {image.name.split("/")[0]: image for image in reconstruction.images.values()}
    for number, view in enumerate(virtual_cameras(layout)):
        points, pixels = in_camera(layout, view, number)
        camera = images[view.name].camera
        assert camera is not None
        assert camera.model.name == ("OPENCV_FISHEYE" if layout.camera.lens_model == "fisheye" else "FULL_OPENCV")
        found = np.asarray(camera.img_from_cam(points)) - 0.5
        assert largest(found, pixels) <= FORMATS["COLMAP"].of(view).error_px + 1e-6


def test_nerfstudio_and_kalibr(layout: Layout, folder: Path) -> None:
    fisheye = layout.camera.lens_model == "fisheye"
    model = "fisheye" if fisheye else "brown_conrady"
    transforms = json.loads((folder / "nerfstudio" / "transforms.json").read_text(encoding="utf-8"))
    assert transforms["camera_model"] == ("OPENCV_FISHEYE" if fisheye else "OPENCV")
    chain = yaml.safe_load((folder / "kalibr_camchain.yaml").read_text(encoding="utf-8"))
    keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    for number, view in enumerate(virtual_cameras(layout)):
        points, pixels = in_camera(layout, view, number)
        frame, cut = transforms["frames"][number], view.sub_image
        matrix = matrix_of(frame["fl_x"], frame["fl_y"], frame["cx"] - 0.5 + cut.x, frame["cy"] - 0.5 + cut.y)
        found = by_opencv(points, model, matrix, np.array([frame[key] for key in keys]))
        assert largest(found, pixels) <= NERFSTUDIO.of(view).error_px + 1e-6
        camera = chain[f"cam{number}"]
        assert camera["distortion_model"] == ("equidistant" if fisheye else "radtan")
        found = by_opencv(points, model, matrix_of(*camera["intrinsics"]), np.array(camera["distortion_coeffs"]))
        assert largest(found, pixels) <= KALIBR.of(view).error_px + 1e-6


def test_the_readme_says_how_far_each_format_is_off(layout: Layout, folder: Path) -> None:
    view = virtual_cameras(layout)[0]
    text = (folder / "README.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if line.startswith(f"| {view.name}"))
    stated = [float(cell) for cell in row.strip("| ").split("|")[3:]]
    errors = [held.of(view).error_px for held in FORMATS.values()]
    np.testing.assert_allclose(stated[1:], [error if error > 1e-6 else 0.0 for error in errors], rtol=0.06)
    assert (errors[0] > 0.0) == (layout.camera.lens_model == "spline")
    assert max(errors) < 0.2
