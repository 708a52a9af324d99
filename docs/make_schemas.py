"""Write the JSON Schemas of the files of MirrorCam into docs/schemas/: `python docs/make_schemas.py`.

They are those of the models that read these files, so that editors and other programs can check a file first. A
model checks more than its schema says: shapes that depend on each other, outlines, rotations.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from mirrorcam.bench.calibrator_run import DescribedViews
from mirrorcam.bench.evaluation import Evaluation
from mirrorcam.bench.scores.leaderboard import Leaderboard
from mirrorcam.bench.scores.score_report import ScoreReport
from mirrorcam.bench.suite_folder import SuiteManifest
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.values import Metric
from mirrorcam.designs.design_files import DesignRequest
from mirrorcam.designs.sweep_files import SweepRequest
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.calibrated_camera import CalibratedCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import CameraProfile
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import GravityTable
from mirrorcam.optics.light_field.equalisation import Equalisation
from mirrorcam.optics.light_field.io.views_file import ViewsFile
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.settings import RenderSettings, SensorModel
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopSet
from mirrorcam.simulation.render_request import PosesFile

FOLDER = Path(__file__).with_name("schemas")
FILES: dict[str, Any] = {
    "board": CalibrationBoard,
    "calibrated_camera": CalibratedCamera,
    "camera": Camera,
    "camera_profile": CameraProfile,
    "dataset": Dataset,
    "design": DesignRequest,
    "device_views": DescribedViews,
    "equalisation": Equalisation,
    "evaluation": Evaluation,
    "gravity": GravityTable,
    "hardware": Hardware,
    "layout": Layout,
    "leaderboard": Leaderboard,
    "metrics": dict[str, Metric],
    "pattern": Pattern,
    "poses": PosesFile,
    "scene": TabletopSet,
    "score": ScoreReport,
    "render_settings": RenderSettings,
    "sensor": SensorModel,
    "suite": SuiteManifest,
    "sweep": SweepRequest,
    "views": ViewsFile,
}
"""The type that reads a kind of file, by the name of its schema."""
DERIVED_KEYS = {"camera_profile": ("name", "cx_px", "cy_px", "fy_px")}
"""Keys that are derived from the rest of the file when it is read, so that its tables may omit them."""


ATTRIBUTE = re.compile(r"^(\w+(?:, \w+)*) : .*\n((?:    .*\n?)+)", flags=re.MULTILINE)


def _described(value: Any) -> Any:
    """A schema without generated titles, with the attributes of a docstring as descriptions of the properties."""
    if isinstance(value, list):
        return [_described(item) for item in value]
    if not isinstance(value, dict):
        return value
    table = {key: _described(item) for key, item in value.items() if key != "title" or not isinstance(item, str)}
    if isinstance(value.get("properties"), dict) and "description" in table:
        summary, _, attributes = table["description"].partition("\n\nAttributes\n----------\n")
        table["description"] = summary
        for names, text in ATTRIBUTE.findall(attributes):
            for name in names.split(", "):
                texts = [" ".join(text.split()).rstrip("."), table["properties"].get(name, {}).get("description", "")]
                if name in table["properties"]:
                    table["properties"][name]["description"] = "; ".join(filter(None, texts))
    return table


def schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a kind of file."""
    json_schema = TypeAdapter(FILES[name]).json_schema(by_alias=True, mode="validation")
    for table in json_schema.get("$defs", {}).values():
        if "required" in table:
            table["required"] = [key for key in table["required"] if key not in DERIVED_KEYS.get(name, ())]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": name, **_described(json_schema)}


def schema_text(name: str) -> str:
    """The content of the file of a schema."""
    return json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    """Write all schemas."""
    FOLDER.mkdir(exist_ok=True)
    for name in FILES:
        write_text(FOLDER / f"{name}.schema.json", schema_text(name))


if __name__ == "__main__":
    main()
