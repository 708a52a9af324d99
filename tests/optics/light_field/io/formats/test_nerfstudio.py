"""nerfstudio: the cameras that it reads from our files, against the scene."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.formats.nerfstudio import read_nerfstudio, write_nerfstudio
from mirrorcam.optics.light_field.io.formats.ply import point_cloud
from mirrorcam.optics.light_field.io.formats.registry import open_light_fields, write_light_field
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.io.formats.conftest import points
from tests.optics.light_field.wall_cameras import FOCAL_PX, SIZE, cameras, photographs, wall_error
from tests.soon import soon


def nerfstudio_pixels(frame: dict[str, Any], points_in_world_mm: FloatArray) -> FloatArray:
    """Pixels, centres at half, of nerfstudio's cameras: right, up, back, as its documentation has them."""
    camera_from_world = np.linalg.inv(frame["transform_matrix"])
    x, y, z = camera_from_world[:3, :3] @ points_in_world_mm.T / 1000.0 + camera_from_world[:3, 3:]
    return np.stack([frame["cx"] + frame["fl_x"] * x / -z, frame["cy"] - frame["fl_y"] * y / -z], axis=-1)


def test_nerfstudio_sees_the_same_colours_in_all_views(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_nerfstudio(tmp_path, scene[0])
    frames = json.loads((tmp_path / "transforms.json").read_text(encoding="utf-8"))["frames"]
    places, colours = points(scene), point_cloud(*scene)[1][::10].astype(float)
    expected = scene[0].project(places).reshape(9, -1, 2)
    for frame, pixels in zip(frames, expected, strict=True):
        # The rig of a 90 degree fold has y towards the scene and z up, like this world.
        seen = nerfstudio_pixels(frame, places)
        assert np.allclose(seen - 0.5, pixels, atol=1e-6)
        picture = read_image(tmp_path / frame["file_path"]).astype(float)
        u, v = np.floor(seen).astype(int).T
        inside = (u >= 0) & (u < 240) & (v >= 0) & (v < 180)
        assert inside.mean() > 0.6
        assert np.median(np.abs(picture[v[inside], u[inside]] - colours[inside])) < 6.0
        assert frame["mask_path"].startswith("masks/")


def test_points_of_the_depth_are_seen_where_they_are(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_light_field(tmp_path, scene[0], "nerfstudio", scene[1].astype(np.float32))
    stated = json.loads((tmp_path / "transforms.json").read_text(encoding="utf-8"))
    cloud: Any = trimesh.load(tmp_path / stated["ply_file_path"])
    seen = nerfstudio_pixels(stated["frames"][4], 1000.0 * np.asarray(cloud.vertices))
    assert np.allclose(seen - 0.5, scene[0].pixel_grid().reshape(-1, 2), atol=1e-3)
    assert np.array_equal(cloud.colors[:, :3], point_cloud(*scene)[1])


def test_views_are_read_from_nerfstudios_file_alone(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    light_field = scene[0]
    write_nerfstudio(tmp_path, light_field)
    (tmp_path / "views.json").unlink()
    (found,) = read_nerfstudio(tmp_path).frames
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-6)
    assert found.reference_depth_mm == pytest.approx(light_field.reference_depth_mm, abs=1e-4)
    assert np.allclose(found.project(points(scene)), light_field.project(points(scene)), atol=1e-4)
    assert np.array_equal(found.samples, light_field.samples)


def dataset(folder: Path, turn_deg: float, names: list[str], **common: Any) -> tuple[FloatArray, dict[str, Any]]:
    """Write pictures of a wall by a row of cameras with these names, and return their poses and transforms.json."""
    poses = cameras(1, len(names), turn_deg)
    focal_px = np.full(len(names), FOCAL_PX)
    distortion = np.array([common.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])
    frames = []
    for name, pose, picture in zip(names, poses, photographs(poses, focal_px, distortion), strict=True):
        file = folder / (name if name.endswith("g") else f"{name}.png")
        write_image(file, np.repeat(np.rint(255 * picture).astype(np.uint8)[..., None], 3, axis=-1))
        transform = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        transform[:3, 3] /= 1000.0
        frames.append({"file_path": name, "transform_matrix": transform.tolist()})
    return poses, {**common, "frames": frames[::-1]}


@pytest.mark.parametrize(
    ("names", "common", "is_sampled"),
    [
        (["images/0000.png", "images/0001.png", "images/0002.png"], {"fl_x": FOCAL_PX}, False),
        (
            ["./train/r_0", "./train/r_1", "./train/r_2", "./train/r_3"],
            {"fl_x": FOCAL_PX, "k1": -0.1, "p1": 1e-3},
            True,
        ),
        (
            ["z.png", "b c.png", "é.png"],
            {"camera_angle_x": 2 * np.arctan(SIZE[0] / 2 / FOCAL_PX), "aabb_scale": 4},
            True,
        ),
    ],
)
def test_datasets_of_anyone_are_read(
    tmp_path: Path, names: list[str], common: dict[str, Any], is_sampled: bool
) -> None:
    """A row with names of any kind in any order, by nerfstudio, instant-ngp and NeRF."""
    poses, stated = dataset(tmp_path, 2.0 if is_sampled else 0.0, names, **common)
    (tmp_path / "transforms.json").write_text(json.dumps(stated))
    contents = open_light_fields(tmp_path)
    (found,) = contents.frames
    assert found.is_grid
    assert (found.rows, found.cols) == (1, len(names))
    assert found.step_mm() == pytest.approx(20.0, rel=0.03)
    assert any("rectified" in note for note in contents.notes) == is_sampled
    found = replace(found, samples=(found.samples / np.float32(255.0)).astype(np.float32))
    error, valid = wall_error(found)
    assert error < 0.004
    assert valid > 0.85
    centres = np.sort((found.positions_mm @ found.view_from_rig + found.reference_view_in_rig_mm)[0, :, 0])
    assert np.allclose(centres, poses[:, 0, 3], atol=1e-6)


@pytest.mark.parametrize(
    ("common", "message"),
    [
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model 'EQUIRECTANGULAR', expected one of"),
        ({"fl_x": None}, "has no fl_x, expected a focal length"),
        ({"fl_x": 1e300}, "fx_px"),
        ({"k4": 0.1}, "has a coefficient k4"),
        ({"w": 95.5}, "expected the size of a picture"),
        ({"h": 100}, "96x72 px, expected 96x100"),
    ],
)
def test_cameras_that_cannot_be_used_are_refused(tmp_path: Path, common: dict[str, Any], message: str) -> None:
    _, stated = dataset(tmp_path, 1.0, ["a.png", "b.png"], fl_x=FOCAL_PX)
    (tmp_path / "transforms.json").write_text(json.dumps(stated | common))
    with pytest.raises(InputError, match=message) as refused:
        read_nerfstudio(tmp_path)
    assert "\n" not in str(refused.value)


def test_cameras_around_an_object_are_no_light_field(tmp_path: Path) -> None:
    """Refused before any picture is read."""
    turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    frames = [{"file_path": f"{n}.png", "transform_matrix": (np.eye(4), turn)[n % 2].tolist()} for n in range(5)]
    write_image(tmp_path / "0.png", np.zeros((4, 5, 3), np.uint8))
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 5.0, "frames": frames}))
    with pytest.raises(InputError, match=r"is turned by \d+ deg from the mean of all cameras, expected at most 45"):
        read_nerfstudio(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file_path": "../secret_00_00.png"}, "expected the name of a file in this folder"),
        ({"file_path": "/etc/secret_00_00.png"}, "expected the name of a file in this folder"),
        ({"mask_path": "masks/../../secret_00_00.png"}, "expected the name of a file in this folder"),
        ({"fl_x": "700"}, "fl_x: str, expected a number"),
        ({"fl_x": float("nan")}, "fl_x: "),
        ({"transform_matrix": [[1.0]]}, "transform_matrix: "),
        ({"w": 1e300}, "240x180 px, expected 1e"),
        ({"file_path": "images/view_00_99.png"}, r"view_00_99\.png: no such file"),
    ],
)
def test_invalid_frames_and_names_outside_of_the_folder_are_refused(
    scene: tuple[LightField, FloatArray], tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    write_nerfstudio(tmp_path / "a", scene[0])
    (tmp_path / "secret_00_00.png").write_bytes((tmp_path / "a" / "images" / "view_00_00.png").read_bytes())
    path = tmp_path / "a" / "transforms.json"
    stated = json.loads(path.read_text(encoding="utf-8"))
    stated["frames"][0] |= changes
    path.write_text(json.dumps(stated), encoding="utf-8")
    with pytest.raises(InputError, match=message) as refused:
        read_nerfstudio(tmp_path / "a")
    assert str(refused.value).startswith(str(tmp_path / "a"))
    assert "\n" not in str(refused.value)


def test_unknown_names_take_no_time_per_frame(tmp_path: Path) -> None:
    same = {"file_path": "a_0_0.png", "transform_matrix": np.eye(4).tolist(), "w": 9.0, "h": 9.0}
    focal = dict.fromkeys(("fl_x", "fl_y", "cx", "cy"), 9.0)
    names = {f"name {number}": 0 for number in range(9_000)}
    text = json.dumps({**same, **focal, **names, "frames": [{}] * 15_000})
    (tmp_path / "transforms.json").write_text(text)
    with soon(), pytest.raises(InputError, match="15000 frames, expected at most 2000 views"):
        read_nerfstudio(tmp_path)


def test_many_frames_are_refused(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [{}] * 30_000}))
    with pytest.raises(InputError, match="more than 20000 frames"):
        read_nerfstudio(tmp_path)
