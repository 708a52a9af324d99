"""nerfstudio: the cameras that it reads from our files, against the scene."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.formats.nerfstudio import read_nerfstudio, write_nerfstudio
from mirrorcam.optics.light_field.io.formats.ply import point_cloud
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.io.formats.conftest import points


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


def test_views_are_read_from_nerfstudios_file_alone(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    light_field = scene[0]
    write_nerfstudio(tmp_path, light_field)
    (tmp_path / "views.json").unlink()
    found = read_nerfstudio(tmp_path)
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-6)
    assert found.reference_depth_mm == pytest.approx(light_field.reference_depth_mm, abs=1e-4)
    assert np.allclose(found.project(points(scene)), light_field.project(points(scene)), atol=1e-4)
    assert np.array_equal(found.samples, light_field.samples)


def test_datasets_that_are_not_light_fields_are_refused(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_nerfstudio(tmp_path, scene[0])
    (tmp_path / "views.json").unlink()
    path = tmp_path / "transforms.json"
    good = path.read_text(encoding="utf-8")

    def bad(change: Any) -> None:
        said = json.loads(good)
        change(said["frames"])
        path.write_text(json.dumps(said), encoding="utf-8")

    def turn(frames: Any) -> None:
        frames[3]["transform_matrix"][0][0] = 0.9

    for change, message in (
        (lambda frames: frames.pop(4), "not a dataset of a grid"),
        (lambda frames: frames[0].update(k1=0.1), "have distortion"),
        (lambda frames: frames[0].update(cx=5.0), "do not share a plane"),
        (lambda frames: frames[0].pop("fl_x"), "not a dataset of a grid"),
        (turn, "different orientations"),
    ):
        bad(change)
        with pytest.raises(InputError, match=message):
            read_nerfstudio(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file_path": "../secret_00_00.png"}, "expected the name of a file in this folder"),
        ({"file_path": "/etc/secret_00_00.png"}, "expected the name of a file in this folder"),
        ({"mask_path": "masks/../../secret_00_00.png"}, "expected the name of a file in this folder"),
        ({"fl_x": "700"}, "fl_x: Input should be a valid number"),
        ({"fl_x": float("nan")}, "fl_x: "),
        ({"transform_matrix": [[1.0]]}, "transform_matrix: "),
        ({"w": 1e300}, "240x180 px, expected 1e"),
        ({"file_path": "images/view_00_99.png"}, "not a dataset of a grid of views"),
    ],
)
def test_invalid_frames_and_names_outside_of_the_folder_are_refused(
    scene: tuple[LightField, FloatArray], tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    write_nerfstudio(tmp_path / "a", scene[0])
    (tmp_path / "secret_00_00.png").write_bytes((tmp_path / "a" / "images" / "view_00_00.png").read_bytes())
    path = tmp_path / "a" / "transforms.json"
    dataset = json.loads(path.read_text(encoding="utf-8"))
    dataset["frames"][0] |= changes
    path.write_text(json.dumps(dataset), encoding="utf-8")
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
    begun = time.process_time()
    with pytest.raises(InputError, match=r"a_0_0\.png: no such file"):
        read_nerfstudio(tmp_path)
    assert time.process_time() - begun < 1.0


def test_large_numbers_in_names_allocate_no_memory(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    write_nerfstudio(tmp_path, scene[0])
    path = tmp_path / "transforms.json"
    stated = json.loads(path.read_text())
    stated["frames"][-1]["file_path"] = "images/view_999999999_999999999.png"
    path.write_text(json.dumps(stated))
    with pytest.raises(InputError, match="9 views, expected 1000000000x1000000000"):
        read_nerfstudio(tmp_path)
    path.write_text(json.dumps({**stated["frames"][0], "frames": [{}] * 30_000}))
    with pytest.raises(InputError, match="more than 20000 frames"):
        read_nerfstudio(tmp_path)
