"""Files for animal-tracking tools: by these tools' formulas, points appear where the mirrors show them."""

from __future__ import annotations

import pickle
import tomllib
from itertools import permutations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write import virtual_cameras
from mirrorcam.optics.camera_files.write.pose_cameras import DIRECT, PoseCamera, pose_cameras, stereo_params
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.camera_files.write.conftest import Case, sideways_layout


def anipose_cameras(path: Path) -> list[dict[str, Any]]:
    """The cameras as aniposelib's `CameraGroup.load` reads them: sorted by table name."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return [tables[name] for name in sorted(tables) if name != "metadata"]


def anipose_pixels(camera: dict[str, Any], points: FloatArray) -> FloatArray:
    """aniposelib's `Camera.project`."""
    found, _ = cv2.projectPoints(
        points,
        np.array(camera["rotation"], dtype=np.float64),
        np.array(camera["translation"], dtype=np.float64),
        np.array(camera["matrix"], dtype=np.float64),
        np.array(camera["distortions"], dtype=np.float64),
    )
    return np.asarray(found, dtype=np.float64)[:, 0]


def in_picture(layout: Layout, pixels: FloatArray, filters: str) -> FloatArray:
    """Map pixels (n, 2) of the frame to the picture made by ffmpeg's filters."""
    for name in filters.split(","):
        if name == "hflip":
            pixels = np.column_stack([layout.camera.width_px - 1 - pixels[:, 0], pixels[:, 1]])
        elif name == "vflip":
            pixels = np.column_stack([pixels[:, 0], layout.camera.height_px - 1 - pixels[:, 1]])
        else:
            _, _, x, y = (int(number) for number in name.removeprefix("crop=").split(":"))
            pixels = pixels - [x, y]
    return pixels


def test_anipose(case: Case, folder: Path) -> None:
    cameras = anipose_cameras(folder / "anipose" / "calibration.toml")
    text = (folder / "anipose" / "calibration.toml").read_text(encoding="utf-8")
    filters = [line.split(" -vf ")[1].split()[0] for line in text.splitlines() if " -vf " in line]
    sizes = [[int(number) for number in each.split("crop=")[1].split(":")[:2]] for each in filters]
    assert [camera["size"] for camera in cameras] == sizes
    mirrored = [(c, f) for c, f in zip(cameras, filters, strict=True) if c["name"] != DIRECT]
    assert [camera["name"] for camera, _ in mirrored] == [view.name for view in case.views]
    for number, (camera, made) in enumerate(mirrored):
        points = case.points_in_rig[number]
        expected = in_picture(case.layout, case.layout.project(points, number), made)
        error = case.views[number].pinhole_error_px
        np.testing.assert_allclose(anipose_pixels(camera, points), expected, atol=error + 1e-5)
        assert (expected > -0.5).all()
        assert (expected < np.array(camera["size"]) - 0.5).all()


def test_the_camera_itself_is_one_more_where_it_looks_at_the_scene(case: Case, folder: Path) -> None:
    cameras = anipose_cameras(folder / "anipose" / "calibration.toml")
    looks = np.allclose(case.layout.view_from_rig, np.eye(3))
    assert (cameras[0]["name"] == DIRECT) == looks
    if looks:
        points = np.random.default_rng(0).uniform([-80.0, -60.0, 400.0], [80.0, 60.0, 900.0], (30, 3))
        np.testing.assert_allclose(anipose_pixels(cameras[0], points), case.layout.camera.project(points), atol=1e-6)


def deeplabcut_points(stereo: dict[str, Any], pixels: list[FloatArray]) -> FloatArray:
    """DeepLabCut's `undistort_points` and `triangulate`: points (n, 3) from the pixels (n, 2) of two cameras."""
    undistorted = [
        cv2.undistortPoints(
            src=seen[:, None],
            cameraMatrix=stereo[f"cameraMatrix{k}"],
            distCoeffs=stereo[f"distCoeffs{k}"],
            P=stereo[f"P{k}"],
            R=stereo[f"R{k}"],
        )[:, 0]
        for k, seen in zip((1, 2), pixels, strict=True)
    ]
    found = cv2.triangulatePoints(stereo["P1"], stereo["P2"], undistorted[0].T, undistorted[1].T)
    return np.asarray((found[:3] / found[3]).T)


@pytest.fixture(scope="module")
def animals() -> tuple[PoseCamera, ...]:
    layout = sideways_layout()
    return pose_cameras(layout, virtual_cameras(layout))


def test_deeplabcut(animals: tuple[PoseCamera, ...]) -> None:
    layout = sideways_layout()
    pairs = pickle.loads(stereo_params(animals))
    numbers = {DIRECT: None, "view_0_0": 0, "view_0_1": 1}
    assert set(pairs) == {f"{a}-{b}" for a, b in permutations(numbers, 2)}
    points = np.random.default_rng(0).uniform([-40.0, -60.0, 300.0], [40.0, 60.0, 500.0], (30, 3))
    seen = {}
    for animal in animals:
        number = numbers[animal.name]
        # Where outlines end does not matter here.
        shown = points if number is None else layout.mirrors[number].reflect(points)
        seen[animal.name] = in_picture(layout, layout.camera.project(shown), animal.filters)
    for name, stereo in pairs.items():
        first, second = name.split("-")
        found = deeplabcut_points(stereo, [seen[first], seen[second]])
        pose = next(animal.camera_from_rig for animal in animals if animal.name == first)
        np.testing.assert_allclose(found, points @ pose[:3, :3].T + pose[:3, 3], atol=1e-3)
        pinhole = [
            np.column_stack(
                [
                    cv2.undistortPoints(
                        seen[each][:, None],
                        stereo[f"cameraMatrix{k}"],
                        stereo[f"distCoeffs{k}"],
                        P=stereo[f"cameraMatrix{k}"],
                    )[:, 0],
                    np.ones(len(points)),
                ]
            )
            for k, each in ((1, first), (2, second))
        ]
        line = pinhole[0] @ stereo["F"].T
        off = np.sum(line * pinhole[1], axis=1) / np.linalg.norm(line[:, :2], axis=1)
        np.testing.assert_allclose(off, 0.0, atol=1e-4)


def test_pictures_have_even_sides_and_a_margin_around_the_mirror(case: Case) -> None:
    for animal, view in zip(
        [each for each in pose_cameras(case.layout, case.views) if each.name != DIRECT], case.views, strict=True
    ):
        cut = animal.crop
        assert all(number % 2 == 0 for number in (cut.x, cut.y, cut.width, cut.height))
        assert animal.crop.x <= view.sub_image.x
        assert animal.crop.x + animal.crop.width >= view.sub_image.x + view.sub_image.width - 1
