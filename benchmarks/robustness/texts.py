"""Texts with what their languages allow and nobody expects: calibrations in YAML, and files in TOML and JSON."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_text
from benchmarks.robustness.guard import Category, refused_well
from benchmarks.robustness.layouts import LAYOUT
from mirrorcam.bench.evaluation_reading import read_evaluation
from mirrorcam.bench.scores.calibration_score import score_calibration
from mirrorcam.bench.scores.figure_limits import Limits
from mirrorcam.bench.scores.matched_views import ViewsFile
from mirrorcam.bench.scores.stated_covariance import CovarianceFile
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.licence import hardware_toml
from mirrorcam.cli import camera_from_text
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.values import InputError
from mirrorcam.designs.design_request import read_request, request_toml
from mirrorcam.device.board_print import page_for
from mirrorcam.device.device_folder import read_hardware
from mirrorcam.optics.calibration.diagnostics.calibration_difference import calibration_difference
from mirrorcam.optics.camera_files.read.file_text import yaml_documents
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.write_exports import write_exports
from mirrorcam.optics.geometry.camera_library import CAMERAS
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import default_board, load_board, save_board
from mirrorcam.render_scenes.suites.suite import SUITES, read_suite, suite_names

ATTEMPTS = 3000
LONGEST_S = 2.0
"""Processor time that an attempt may take."""
DISTANCE_MM = 450.0
COVARIANCE = '{"schema": "mirrorcam.covariance/1", "parameters": ["a", "b"], "covariance": [[1.0, 0.5], [0.5, 2.0]]}'
EVALUATION = (
    '{"schema": "mirrorcam.evaluation/1", "suite": "a", "version": 1, "command": "c", "tried": [], "scores": null, '
    '"changes": [], "passed": true}'
)


@dataclass(frozen=True)
class Kind:
    """A file: its name, what it holds when it is good, and what a command does with it."""

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


def _message() -> str:
    """The camera_info of a view as `ros2 topic echo` prints it."""
    values: Any = yaml_documents(_exported("ros/view_0_0.yaml"))[0]
    lines = [f"{key}: {values[name]}" for name, key in (("image_height", "height"), ("image_width", "width"))]
    lines += [f"distortion_model: {values['distortion_model']}"]
    names = ("distortion_coefficients", "camera_matrix", "rectification_matrix", "projection_matrix")
    lines += [f"{key}: {values[name]['data']}" for name, key in zip(names, "dkrp", strict=True)]
    stamp = "header:\n  stamp: {sec: 0, nanosec: 0}\n  frame_id: mirrorcam_view_0_0_optical_frame\n"
    return stamp + "\n".join(lines) + "\n---\n"


def _board() -> str:
    with TemporaryDirectory() as folder:
        path = Path(folder, "board.toml")
        save_board(path, default_board())
        return path.read_text(encoding="utf-8")


def _score(path: Path) -> None:
    score_calibration(read_rig(path), _layout(), _layout(), DISTANCE_MM)


def _compare(path: Path) -> None:
    calibration_difference(_layout(), Layout.load(path), range_mm=DISTANCE_MM)


KINDS = {
    "YAML": (
        Kind("camchain.yaml", partial(_exported, "kalibr_camchain.yaml"), _score),
        Kind("opencv.yaml", partial(_exported, "opencv.yaml"), _score),
        Kind("camera_info.yaml", partial(_exported, "ros/view_0_0.yaml"), _score),
        Kind("message.yaml", _message, _score),
    ),
    "TOML": (
        Kind("board.toml", _board, lambda path: page_for(load_board(path), "")),
        Kind("design.toml", lambda: request_toml(_layout().spec or DesignSpec()), read_request),
        Kind("suite.toml", (SUITES / f"{suite_names()[0]}.toml").read_text, lambda path: read_suite(str(path))),
        Kind("camera.toml", (CAMERAS / "c920.toml").read_text, lambda path: camera_from_text(str(path))),
        Kind("body.toml", (CAMERAS / "c920.toml").read_text, lambda path: read_hardware(camera=str(path))),
        Kind("hardware.toml", lambda: hardware_toml(HARDWARE), read_hardware),
        Kind("limits.toml", lambda: "rms_px = 0.5\nview_0_0_max_px = 2\n[over_sets]\nnees = 2.0\n", Limits.load),
        Kind("views.toml", lambda: '[cameras]\ncam0 = "view_0_0"\ncam1 = {view = "view_0_1", x = 3}', ViewsFile.load),
    ),
    "JSON": (
        Kind("layout.json", lambda: LAYOUT.read_text(encoding="utf-8"), _compare),
        Kind("design.json", lambda: LAYOUT.read_text(encoding="utf-8"), read_request),
        Kind("covariance.json", lambda: COVARIANCE, partial(read_model, CovarianceFile)),
        Kind("evaluation.json", lambda: EVALUATION, read_evaluation),
        Kind("opencv.json", lambda: json.dumps(yaml_documents(_exported("opencv.yaml"))[0]), _score),
    ),
}


def attempt(seed: int, folder: Path, *, language: str) -> str:
    """Read a file of a language, damaged, and use it where it can be read."""
    random, kinds = np.random.default_rng(seed), KINDS[language]
    kind = kinds[int(random.integers(len(kinds)))]
    path, text = folder / kind.name, kind.text()
    if random.random() < 0.2:
        path.write_bytes(damaged_bytes(text.encode(), random))
    else:
        path.write_text(damaged_text(text, path.suffix, random), encoding="utf-8")
    begun = time.process_time()
    try:
        kind.use(path)
        wrong = ""
    except InputError as error:
        wrong = refused_well(str(error).replace(str(folder), ""))
    took = time.process_time() - begun
    return wrong or (f"{kind.name}: took {took:.1f} s of processor time" if took > LONGEST_S else "")


CATEGORIES = tuple(Category(name, ATTEMPTS, partial(attempt, language=name)) for name in KINDS)
