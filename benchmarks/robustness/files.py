"""Damaged layouts, boards, cameras, manifests and other JSON, TOML and YAML files: read, and used like in commands."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_text, damaged_value
from benchmarks.robustness.guard import Category, message_fault
from mirrorcam.bench.evaluation import read_evaluation
from mirrorcam.bench.scores.calibration_score import score_calibration
from mirrorcam.bench.scores.consistency import CovarianceFile
from mirrorcam.bench.scores.matched_views import ViewsFile
from mirrorcam.bench.scores.score_report import Limits
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.licence import hardware_toml
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.designs.design_files import read_request
from mirrorcam.device.board_print import page_for
from mirrorcam.device.hardware_choice import HardwareChoice
from mirrorcam.optics.calibration.diagnostics.calibration_difference import calibration_difference
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.write_exports import write_exports
from mirrorcam.optics.geometry.boards import default_board, load_board, save_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import CAMERAS, read_camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import sensor_polygon
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.mirror_finish import draw_finishes
from mirrorcam.render_scenes.sets.set_request import SetRequest, planned_frames
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SurfaceFinish
from mirrorcam.render_scenes.suites.suite import SUITES, read_suite, suite_names
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopSet
from mirrorcam.simulation.render_request import PosesFile, sensor_of
from mirrorcam.simulation.rendering import check_set
from tests.render_scenes.manifests import dataset_of_two_frames, scene_of_two_depths

LAYOUT = Path(__file__).parents[2] / "tests" / "data" / "default_layout.json"
MAX_S = 2.0
"""Maximum processor time of an attempt."""
DISTANCE_MM = 450.0
FILES = {"frames/0000.jpg": "0" * 64, "layout.json": "0" * 64}
COVARIANCE = '{"schema": "mirrorcam.covariance/1", "parameters": ["a", "b"], "covariance": [[1.0, 0.5], [0.5, 2.0]]}'
EVALUATION = (
    '{"schema": "mirrorcam.evaluation/1", "suite": "a", "version": 1, "command": "c", "tried": [], "scores": null, '
    '"changes": [], "passed": true}'
)
POSE = [[1.0, 0.0, 0.0, -120.0], [0.0, 0.0, 1.0, 400.0], [0.0, -1.0, 0.0, 84.0], [0.0, 0.0, 0.0, 1.0]]


@dataclass(frozen=True)
class Kind:
    """A kind of file: its name, the content of a valid one, and its use by a command."""

    name: str
    text: Callable[[], str]
    use: Callable[[Path], object]


@cache
def _layout() -> Layout:
    return Layout.load(LAYOUT)


@cache
def _exported(name: str) -> str:
    with TemporaryDirectory() as folder:
        write_exports(_layout(), Path(folder))
        return Path(folder, name).read_text(encoding="utf-8")


def _board() -> str:
    with TemporaryDirectory() as folder:
        save_board(Path(folder, "board.toml"), default_board())
        return Path(folder, "board.toml").read_text(encoding="utf-8")


def _sensor() -> str:
    values = {key: value for key, value in json.loads(_dump(SENSORS["c920"])).items() if value is not None}
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def _dump(value: Value) -> str:
    return value.model_dump_json(by_alias=True)


def _decode(path: Path) -> None:
    Decoder(Layout.load(path), width_px=16)


def _compare(path: Path) -> None:
    calibration_difference(_layout(), Layout.load(path), range_mm=DISTANCE_MM)


def _score(path: Path) -> None:
    score_calibration(read_rig(path), _layout(), _layout(), DISTANCE_MM)


def _camera(path: Path) -> None:
    camera = read_camera(str(path))
    sensor_polygon(camera)
    assert np.isfinite(camera.unproject(np.array([camera.cx_px, camera.cy_px]))).all()


def _dataset(path: Path) -> None:
    check_set(path.parent)


def _scene(path: Path) -> None:
    scene = TabletopSet.load(path.parent)
    [scene.intact(path.parent, name) for name in scene.files]


def _poses(path: Path) -> None:
    file = read_model(PosesFile, path)
    poses, hz = file.poses.tolist(), file.poses_hz
    planned_frames(SetRequest(layout=_layout(), base_frames=0, poses=poses, poses_hz=hz, rate_hz=1.0))


def _finish(path: Path) -> None:
    draw_finishes(RenderSettings(finish=read_model(SurfaceFinish, path)), 4, np.random.default_rng(0))


KINDS = {
    "layouts": (Kind("layout.json", lambda: LAYOUT.read_text(encoding="utf-8"), _decode),),
    "YAML": (
        Kind("camchain.yaml", partial(_exported, "kalibr_camchain.yaml"), _score),
        Kind("opencv.yaml", partial(_exported, "opencv.yaml"), _score),
        Kind("camera_info.yaml", partial(_exported, "ros/view_0_0.yaml"), _score),
    ),
    "TOML": (
        Kind("board.toml", _board, lambda path: page_for(load_board(path), "")),
        Kind("design.toml", lambda: "rows = 3\nscale_mm = 80.0\ndepths_mm = [300.0, 500.0]\n", read_request),
        Kind("suite.toml", (SUITES / f"{suite_names()[0]}.toml").read_text, lambda path: read_suite(str(path))),
        Kind("camera.toml", (CAMERAS / "c920.toml").read_text, _camera),
        Kind("body.toml", (CAMERAS / "c920.toml").read_text, lambda path: HardwareChoice(body=str(path)).read()),
        Kind("hardware.toml", lambda: hardware_toml(HARDWARE), lambda path: HardwareChoice(hardware=path).read()),
        Kind("limits.toml", lambda: "rms_px = 0.5\nview_0_0_max_px = 2\n[over_sets]\nnees = 2.0\n", Limits.load),
        Kind("sensor.toml", _sensor, lambda path: sensor_of(str(path))),
        Kind("views.toml", lambda: '[cameras]\ncam0 = "view_0_0"\ncam1 = {view = "view_0_1", x = 3}', ViewsFile.load),
    ),
    "JSON": (
        Kind("layout.json", lambda: LAYOUT.read_text(encoding="utf-8"), _compare),
        Kind("design.json", lambda: LAYOUT.read_text(encoding="utf-8"), read_request),
        Kind("camera.json", lambda: _dump(Camera.c920()), _camera),
        Kind("board.json", lambda: _dump(default_board()), load_board),
        Kind(
            "dataset.json", lambda: _dump(dataset_of_two_frames().replaced(files=FILES)), lambda p: check_set(p.parent)
        ),
        Kind("scene.json", lambda: _dump(scene_of_two_depths().replaced(files=FILES)), _scene),
        Kind("poses.json", lambda: json.dumps({"poses": [POSE] * 3, "poses_hz": 2.0}), _poses),
        Kind("finish.json", lambda: _dump(SurfaceFinish(sag_mm=0.01)), _finish),
        Kind("covariance.json", lambda: COVARIANCE, partial(read_model, CovarianceFile)),
        Kind("evaluation.json", lambda: EVALUATION, read_evaluation),
    ),
}


def damaged(text: str, suffix: str, random: np.random.Generator) -> bytes:
    """Return a text with damage to its bytes, to its text, or to the values of JSON."""
    choice = random.random()
    if choice < 0.25:
        return damaged_bytes(text.encode(), random)
    if suffix == ".json" and choice < 0.7:
        return json.dumps(damaged_value(json.loads(text), random)).encode()
    return damaged_text(text, suffix, random).encode()


def attempt(seed: int, folder: Path, *, group: str) -> str:
    """Read a damaged file of a group, and use it if it is readable."""
    random, kinds = np.random.default_rng(seed), KINDS[group]
    kind = kinds[int(random.integers(len(kinds)))]
    path = folder / kind.name
    raw = damaged(kind.text(), path.suffix, random)
    path.write_bytes(raw)
    start_s = time.process_time()
    try:
        kind.use(path)
        wrong = ""
    except InputError as error:
        wrong = message_fault(str(error).replace(str(folder), ""))
    took = time.process_time() - start_s
    if path.read_bytes() != raw or list(folder.iterdir()) != [path]:
        return f"{kind.name}: wrote files next to its input"
    return wrong or (f"{kind.name}: took {took:.1f} s of processor time" if took > MAX_S else "")


CATEGORIES = tuple(Category(name, 3_000, partial(attempt, group=name)) for name in KINDS)
