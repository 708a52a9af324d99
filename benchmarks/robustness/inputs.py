"""Mutated files beside layouts: boards, cameras, dimensions, manifests of sets, poses, sensors and finishes."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from datetime import date
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_value
from benchmarks.robustness.guard import Category, refused_well
from benchmarks.robustness.layouts import LAYOUT
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cli import camera_from_text
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.values import InputError, Value
from mirrorcam.device.board_print import page_for
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import CAMERAS, read_body
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import sensor_polygon
from mirrorcam.optics.geometry.targets import Checkerboard, default_board, load_board
from mirrorcam.render_scenes.mirror_finish import draw_finishes
from mirrorcam.render_scenes.sets.set_request import SetRequest, planned_frames
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SurfaceFinish
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopSet
from mirrorcam.simulation.render_request import PosesFile, sensor_of
from mirrorcam.simulation.rendering import check_set
from tests.render_scenes.manifests import dataset_of_two_frames, scene_of_two_depths

ATTEMPTS = 3000
FILES = {"frames/0000.jpg": "0" * 64, "layout.json": "0" * 64}
Use = Callable[[Path], object]
"""Reads a file, and uses what it holds as a command would."""


def toml_text(table: Mapping[str, Any], path: str = "") -> str:
    """A table as TOML: its values, then the tables in it; raises TypeError for what TOML does not know."""
    lines = [f"{json.dumps(key)} = {_toml(value)}" for key, value in table.items() if not isinstance(value, dict)]
    for key, value in table.items():
        if isinstance(value, dict):
            name = f"{path}{json.dumps(key)}"
            lines += [f"[{name}]", toml_text(value, f"{name}.")]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return "nan" if value != value else str(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(each)}" for key, each in value.items()) + "}"
    if value is None:
        return date(2020, 1, 1).isoformat()  # TOML has no null: what JSON does not know
    return str(value) if isinstance(value, int) else json.dumps(value)


def _dump(value: Value) -> dict[str, Any]:
    dumped: dict[str, Any] = json.loads(value.model_dump_json(by_alias=True))
    return dumped


@cache
def _layout() -> Layout:
    return Layout.load(LAYOUT)


def _use_board(path: Path) -> None:
    target = load_board(path)
    assert len(target.corners_in_board_mm) == (target.cols - 1) * (target.rows - 1)
    page_for(target, "")


def _use_camera(path: Path) -> None:
    camera = camera_from_text(str(path))
    sensor_polygon(camera)
    assert np.isfinite(camera.unproject(np.array([camera.cx_px, camera.cy_px]))).all()
    DesignSpec(camera=camera)


def _use_hardware(path: Path) -> None:
    read_model(Hardware, path)


def _use_body(path: Path) -> None:
    read_body(str(path))


def _use_dataset(path: Path) -> None:
    check_set(path.parent)


def _use_scene(path: Path) -> None:
    scene = TabletopSet.load(path.parent)
    [scene.intact(path.parent, name) for name in scene.files]


def _use_poses(path: Path) -> None:
    poses = read_model(PosesFile, path)
    request = SetRequest(
        layout=_layout(), base_frames=0, poses=poses.poses.tolist(), poses_hz=poses.poses_hz, rate_hz=1.0
    )
    planned_frames(request)


def _use_sensor(path: Path) -> None:
    sensor_of(str(path))


def _use_finish(path: Path) -> None:
    settings = RenderSettings(finish=read_model(SurfaceFinish, path))
    draw_finishes(settings, 4, np.random.default_rng(0))


def _board(random: np.random.Generator) -> dict[str, Any]:
    plain = Checkerboard(cols=9, rows=6, square_mm=25.0)
    return _dump(default_board() if random.random() < 0.5 else plain)


def _dataset(random: np.random.Generator) -> dict[str, Any]:
    return _dump(dataset_of_two_frames().replaced(files=FILES))


def _scene(random: np.random.Generator) -> dict[str, Any]:
    return _dump(scene_of_two_depths().replaced(files=FILES))


def _poses(random: np.random.Generator) -> dict[str, Any]:
    pose = [[1.0, 0.0, 0.0, -120.0], [0.0, 0.0, 1.0, 400.0], [0.0, -1.0, 0.0, 84.0], [0.0, 0.0, 0.0, 1.0]]
    return {"poses": [pose, pose, pose], "poses_hz": 2.0}


def _body(random: np.random.Generator) -> dict[str, Any]:
    names = sorted(CAMERAS.glob("*.toml"))
    return tomllib.loads(names[int(random.integers(len(names)))].read_text(encoding="utf-8"))


def _camera(random: np.random.Generator) -> dict[str, Any]:
    return _dump(Camera.c920().replaced(distortion=[0.05, -0.1, 0.0, 0.0, 0.0]))


def _hardware(random: np.random.Generator) -> dict[str, Any]:
    return Hardware().model_dump(mode="json", by_alias=True, exclude_none=True)


def _sensor(random: np.random.Generator) -> dict[str, Any]:
    return _dump(SENSORS["c920"])


def _finish(random: np.random.Generator) -> dict[str, Any]:
    return _dump(SurfaceFinish(sag_mm=0.01))


def mutated(value: dict[str, Any], suffix: str, random: np.random.Generator) -> bytes:
    """The bytes of a file with some damage to its values, or to its bytes."""
    whole = random.random() < 0.3
    changed = value if whole else damaged_value(value, random)
    if suffix == ".toml" and isinstance(changed, dict):
        raw = toml_text(changed).encode("utf-8", "surrogatepass")
    else:
        raw = json.dumps(changed).encode("utf-8")
    return damaged_bytes(raw, random) if whole else raw


def attempt(
    seed: int, folder: Path, *, good: Callable[[np.random.Generator], dict[str, Any]], use: Use, names: tuple[str, ...]
) -> str:
    """Read a mutated file, and use it where it can be read."""
    random = np.random.default_rng(seed)
    path = folder / names[int(random.integers(len(names)))]
    path.write_bytes(mutated(good(random), path.suffix, random))
    before = path.read_bytes()
    try:
        use(path)
    except InputError as error:
        return refused_well(str(error).replace(str(folder), ""))
    return "" if path.read_bytes() == before and list(folder.iterdir()) == [path] else "wrote beside its input"


def _category(name: str, good: Callable[[np.random.Generator], dict[str, Any]], use: Use, *names: str) -> Category:
    return Category(name, ATTEMPTS, partial(attempt, good=good, use=use, names=names))


CATEGORIES = (
    _category("boards", _board, _use_board, "board.toml", "board.json"),
    _category("cameras", _camera, _use_camera, "camera.toml", "camera.json"),
    _category("hardware", _hardware, _use_hardware, "hardware.toml"),
    _category("camera bodies", _body, _use_body, "body.toml"),
    _category("data sets", _dataset, _use_dataset, "dataset.json"),
    _category("scenes", _scene, _use_scene, "scene.json"),
    _category("poses", _poses, _use_poses, "poses.json"),
    _category("sensors", _sensor, _use_sensor, "sensor.toml"),
    _category("finishes", _finish, _use_finish, "finish.toml"),
)
