"""Every export, read back by the tool it is for (or by what that tool reads with), projects as the layout does."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from scipy.spatial.transform import Rotation
from urdf_parser_py.urdf import URDF

from mirrorcam.optics.base.files import read_image, write_image
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.exports import virtual_cameras, write_exports
from mirrorcam.optics.exports.kalibr import radtan
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.exports.conftest import TOLERANCE_PX, Case, seen_through, without_k3


@pytest.fixture(scope="module")
def folder(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exports")
    camera = case.layout.camera
    frame = np.random.default_rng(0).integers(1, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    for name in ("a", "b"):
        write_image(out / f"{name}.png", frame)
    write_exports(case.layout, out / "exports", [out / "a.png", out / "b.png"])
    return out / "exports"


def assert_projects(found_px: FloatArray, expected_px: FloatArray) -> None:
    np.testing.assert_allclose(found_px, expected_px, rtol=0, atol=TOLERANCE_PX)


def as_opencv_does(
    points: FloatArray, camera_from: FloatArray, camera_matrix: FloatArray, distortion: FloatArray
) -> FloatArray:
    turn = cv2.Rodrigues(camera_from[:3, :3])[0]
    found, _ = cv2.projectPoints(points, turn, camera_from[:3, 3], camera_matrix, distortion)
    return np.asarray(found, dtype=np.float64)[:, 0]


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


def urdf_poses(folder: Path) -> dict[str, FloatArray]:
    """root_from_link (4, 4) in metres of every link, by ROS's parser and the definition of rpy."""
    robot = URDF.from_xml_file(str(folder / "mirrorcam_calibrated.urdf"))
    poses = {robot.get_root(): np.eye(4)}
    for joint in robot.joints:  # parents come before their children in the file
        assert joint.type == "fixed"
        about = [Rotation.from_rotvec(angle * axis) for angle, axis in zip(joint.origin.rpy, np.eye(3), strict=True)]
        pose = rigid((about[2] * about[1] * about[0]).as_matrix(), joint.origin.xyz)
        poses[joint.child] = poses[joint.parent] @ pose
    assert set(poses) == {link.name for link in robot.links}
    return poses


def test_ros_camera_info_with_urdf(case: Case, folder: Path) -> None:
    """What an image_geometry user does: frames from the URDF by frame_id, K and D from the camera_info."""
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
        # The lens's k3, where it has one, is met by the other four as well as they can, and the file says how well.
        assert off.max() <= radtan(case.views[place])[1] + TOLERANCE_PX
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
    """Why COLMAP gets whole frames: the principal point of some view lies outside its sub-image."""
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
    # COLMAP takes the reference first, and nothing else does it take first.
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
    # Its z is up, as its own viewer has it.
    up = np.mean([np.array(frame["transform_matrix"])[:3, 1] for frame in meta["frames"]], axis=0)
    assert up[2] > 0.7


def test_pictures_are_the_flipped_frame(case: Case, folder: Path) -> None:
    frame = read_image(folder.parent / "a.png")
    for view in case.views:
        flipped = frame[:, ::-1] if view.flip == "left-right" else frame[::-1]
        for name in ("a.png", "b.png"):
            image = read_image(folder / "colmap" / "images" / view.name / name)
            mask = read_image(folder / "colmap" / "masks" / view.name / f"{name}.png", grey=True)
            np.testing.assert_array_equal(image[mask > 0], flipped[mask > 0])
            assert not image[mask == 0].any()
        part = read_image(folder / "nerfstudio" / "images" / f"{view.name}.png")
        np.testing.assert_array_equal(part, flipped[view.sub_image.slices])


def test_the_same_layout_makes_the_same_bytes(case: Case, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_exports(case.layout, tmp_path / name)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert len(files) > 10
    for path in files:
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes()


def test_a_picture_of_another_size_is_refused(case: Case, tmp_path: Path) -> None:
    write_image(tmp_path / "small.png", np.zeros((10, 20), dtype=np.uint8))
    with pytest.raises(InputError, match=r"small.png: 20x10 px, expected \d+x\d+ as calibrated"):
        write_exports(case.layout, tmp_path / "exports", [tmp_path / "small.png"])


def test_pictures_that_share_a_name_are_refused(case: Case, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pictures share a name"):
        write_exports(case.layout, tmp_path / "exports", [tmp_path / "x" / "a.png", tmp_path / "y" / "a.png"])


def test_the_readme_names_flip_and_every_view(case: Case, folder: Path) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert f"flipped\n{case.views[0].flip}" in text
    lines = [line for line in text.splitlines() if line.startswith("| view_")]
    assert len(lines) == len(case.views)
    assert len({line.split("|")[1] for line in lines}) == len(lines)
    for before, after in pairwise(lines):
        assert before < after
