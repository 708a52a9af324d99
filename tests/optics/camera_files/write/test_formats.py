"""Lenses of every family in every format, read back by OpenCV, COLMAP or the format's own formula."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from numpy.typing import ArrayLike

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write import VirtualCamera, virtual_cameras, write_exports
from mirrorcam.optics.camera_files.write.formats import FORMATS, KALIBR, NERFSTUDIO, OPENCV, ROS
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import with_lens
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.camera_files.write.conftest import TOLERANCE_PX, Case, seen_through, sideways_layout, without_k3
from tests.optics.camera_files.write.read_back import as_opencv_does, assert_projects, urdf_poses

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
def lens_folder(layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_opencv_and_ros(layout: Layout, lens_folder: Path) -> None:
    model = layout.camera.lens_model
    storage = cv2.FileStorage(str(lens_folder / "opencv.yaml"), cv2.FILE_STORAGE_READ)
    for number, view in enumerate(virtual_cameras(layout)):
        points, pixels = in_camera(layout, view, number)
        node = storage.getNode("views").at(number)
        matrix, distortion = node.getNode("camera_matrix").mat(), node.getNode("distortion_coefficients").mat()
        assert largest(by_opencv(points, model, matrix, distortion), pixels) <= OPENCV.of(view).error_px + 1e-6
        info = yaml.safe_load((lens_folder / "ros" / f"{view.name}.yaml").read_text(encoding="utf-8"))
        assert info["distortion_model"] == ("equidistant" if model == "fisheye" else "rational_polynomial")
        matrix = np.reshape(info["camera_matrix"]["data"], (3, 3))
        distortion = np.array(info["distortion_coefficients"]["data"])
        assert len(distortion) == (4 if model == "fisheye" else 8)
        assert largest(by_opencv(points, model, matrix, distortion), pixels) <= ROS.of(view).error_px + 1e-6


def test_colmap(layout: Layout, lens_folder: Path) -> None:
    reconstruction = pycolmap.Reconstruction(lens_folder / "colmap" / "sparse")
    images = {image.name.split("/")[0]: image for image in reconstruction.images.values()}
    for number, view in enumerate(virtual_cameras(layout)):
        points, pixels = in_camera(layout, view, number)
        camera = images[view.name].camera
        assert camera is not None
        assert camera.model.name == ("OPENCV_FISHEYE" if layout.camera.lens_model == "fisheye" else "FULL_OPENCV")
        found = np.asarray(camera.img_from_cam(points)) - 0.5
        assert largest(found, pixels) <= FORMATS["COLMAP"].of(view).error_px + 1e-6


def test_nerfstudio_and_kalibr(layout: Layout, lens_folder: Path) -> None:
    fisheye = layout.camera.lens_model == "fisheye"
    model = "fisheye" if fisheye else "brown_conrady"
    transforms = json.loads((lens_folder / "nerfstudio" / "transforms.json").read_text(encoding="utf-8"))
    assert transforms["camera_model"] == ("OPENCV_FISHEYE" if fisheye else "OPENCV")
    chain = yaml.safe_load((lens_folder / "kalibr_camchain.yaml").read_text(encoding="utf-8"))
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


def test_the_readme_says_how_far_each_format_is_off(layout: Layout, lens_folder: Path) -> None:
    view = virtual_cameras(layout)[0]
    text = (lens_folder / "README.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if line.startswith(f"| {view.name}"))
    stated = [float(cell) for cell in row.strip("| ").split("|")[3:]]
    errors = [held.of(view).error_px for held in FORMATS.values()]
    np.testing.assert_allclose(stated[1:], [error if error > 1e-6 else 0.0 for error in errors], rtol=0.06)
    assert (errors[0] > 0.0) == (layout.camera.lens_model == "spline")
    assert max(errors) < 0.2


def matrix(node: cv2.FileNode, name: str) -> FloatArray:
    return np.asarray(node.getNode(name).mat(), dtype=np.float64)


def test_opencv(case: Case, folder: Path) -> None:
    file = cv2.FileStorage(str(folder / "opencv.yaml"), cv2.FILE_STORAGE_READ)
    frame = np.arange(6, dtype=np.uint8).reshape(2, 3)
    flipped = cv2.flip(frame, int(file.getNode("flip_code").real()))
    np.testing.assert_array_equal(flipped, case.views[0].flipped(frame))
    assert file.getNode("image_width").real() == case.layout.camera.width_px
    nodes = file.getNode("views")
    assert nodes.size() == len(case.views)
    for place, view in enumerate(case.views):
        node = nodes.at(place)
        assert node.getNode("name").string() == view.name
        pose = np.hstack([matrix(node, "R"), matrix(node, "T")])
        found = as_opencv_does(
            case.points_in_rig[place],
            pose,
            matrix(node, "camera_matrix"),
            matrix(node, "distortion_coefficients"),
        )
        assert_projects(found, case.flipped_px[place])
        cut = view.sub_image
        assert node.getNode("roi").mat().tolist() == [[cut.x, cut.y, cut.width, cut.height]]


def test_ros_camera_info_with_urdf(case: Case, folder: Path) -> None:
    """The steps of an image_geometry user: frames from the URDF by frame_id, K and D from the camera_info."""
    poses = urdf_poses(folder)
    for place, view in enumerate(case.views):
        info = yaml.safe_load((folder / "ros" / f"{view.name}.yaml").read_text(encoding="utf-8"))
        # As camera_calibration_parsers reads them: K, R 3x3, P 3x4, D of any length.
        matrices = {}
        for name, shape in {
            "camera_matrix": (3, 3),
            "rectification_matrix": (3, 3),
            "projection_matrix": (3, 4),
            "distortion_coefficients": (1, 5),
        }.items():
            assert (info[name]["rows"], info[name]["cols"]) == shape
            assert all(type(value) is float for value in info[name]["data"])
            matrices[name] = np.array(info[name]["data"]).reshape(shape)
        assert info["distortion_model"] == "plumb_bob"
        assert (info["image_width"], info["image_height"]) == (view.camera.width_px, view.camera.height_px)
        roi = info["roi"]
        assert roi["x_offset"] + roi["width"] <= info["image_width"]
        assert roi["y_offset"] + roi["height"] <= info["image_height"]
        camera_from_rig = np.linalg.inv(poses[info["frame_id"]]) @ poses["mirrorcam_camera_optical_frame"]
        found = as_opencv_does(
            case.points_in_rig[place] / 1000.0,
            camera_from_rig,
            matrices["camera_matrix"],
            matrices["distortion_coefficients"],
        )
        assert_projects(found, case.flipped_px[place])
        ideal = matrices["projection_matrix"] @ np.vstack([np.eye(3), np.zeros(3)])
        np.testing.assert_array_equal(ideal, matrices["camera_matrix"])


def test_the_urdf_camera_link_has_x_forward_and_z_up(folder: Path) -> None:
    pose = urdf_poses(folder)["mirrorcam_camera_optical_frame"]
    np.testing.assert_allclose(pose[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 1], [0.0, 0.0, -1.0], atol=1e-12)


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
        # The other four coefficients approximate the lens's k3, and the file states the error.
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


def test_colmap_sparse_model(case: Case, folder: Path) -> None:
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse")
    assert (len(model.rigs), len(model.frames)) == (1, 1)
    names = {image.name: image for image in model.images.values()}
    assert set(names) == {f"{view.name}/a.png" for view in case.views}
    for place, view in enumerate(case.views):
        image = names[f"{view.name}/a.png"]
        found = [image.project_point(point / 1000.0) for point in case.points_in_rig[place]]
        # COLMAP: the centre of the top-left pixel is (0.5, 0.5).
        assert_projects(np.array(found) - 0.5, case.flipped_px[place])
        assert not image.camera.has_bogus_params(0.1, 10.0, 1.0)
    reference = names[f"{case.views[case.layout.central_index].name}/a.png"]
    assert reference.is_ref_in_frame()


def test_colmap_would_drop_cropped_views(case: Case) -> None:
    """COLMAP gets entire frames because the principal point of some view lies outside its sub-image."""
    dropped = []
    for view in case.views:
        cut = view.cropped
        camera = pycolmap.Camera(model="PINHOLE", width=cut.width_px, height=cut.height_px)
        camera.params = [cut.fx_px, cut.fy_px, cut.cx_px + 0.5, cut.cy_px + 0.5]
        dropped.append(camera.has_bogus_params(0.1, 10.0, 1.0))
    assert any(dropped)


def test_colmap_rig_config(case: Case, folder: Path) -> None:
    (rig,) = pycolmap.read_rig_config(folder / "colmap" / "rig_config.json")
    reference = case.views[case.layout.central_index]
    # COLMAP requires the reference sensor first.
    assert [camera.ref_sensor for camera in rig.cameras] == [True] + [False] * (len(case.views) - 1)
    assert rig.cameras[0].image_prefix == f"{reference.name}/"
    by_prefix = {camera.image_prefix: camera for camera in rig.cameras}
    for view, points_in_rig, pixels in zip(case.views, case.points_in_rig, case.flipped_px, strict=True):
        camera = by_prefix[f"{view.name}/"]
        points = transform(reference.camera_from_rig, points_in_rig)
        points = points / 1000.0
        if not camera.ref_sensor:
            points = np.array([camera.cam_from_rig * point for point in points])
        assert camera.camera is not None
        assert_projects(np.asarray(camera.camera.img_from_cam(points)) - 0.5, pixels)


def test_nerfstudio(case: Case, folder: Path) -> None:
    """As nerfstudio's data parser and its undistortion read it: OpenGL poses, half a pixel, OpenCV's lens."""
    meta = json.loads((folder / "nerfstudio" / "transforms.json").read_text(encoding="utf-8"))
    assert meta["camera_model"] == "OPENCV"
    world_from_rig = rigid(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ case.layout.view_from_rig, np.zeros(3))
    for place, (frame, view) in enumerate(zip(meta["frames"], case.views, strict=True)):
        camera_from_world = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(np.array(frame["transform_matrix"]))
        fx, fy, cx, cy = (frame[name] for name in ("fl_x", "fl_y", "cx", "cy"))
        camera_matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
        distortion = np.array([frame[name] for name in ("k1", "k2", "p1", "p2", "k3")])
        points = case.points_in_rig[place] / 1000.0
        found = as_opencv_does(points, camera_from_world @ world_from_rig, camera_matrix, distortion)
        cut = view.sub_image
        assert_projects(found + np.array([cut.x, cut.y]), case.flipped_px[place])
        for name in (frame["file_path"], frame["mask_path"]):
            assert read_image(folder / "nerfstudio" / name).shape[:2] == (frame["h"], frame["w"])
    # z is up, as in nerfstudio's viewer.
    up = np.mean([np.array(frame["transform_matrix"])[:3, 1] for frame in meta["frames"]], axis=0)
    assert up[2] > 0.7
