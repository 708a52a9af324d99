"""The JSON Schemas: those of the models, kept in docs/schemas, agreeing with what is written and what is refused."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.make_schemas import FILES, FOLDER, schema, schema_text
from mirrorcam.bench.calibrator_run import described_views
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.write.licence import hardware_toml
from mirrorcam.core.disk.files import write_json, write_metrics, write_text
from mirrorcam.core.values import Metric
from mirrorcam.designs.design_files import request_toml
from mirrorcam.device.board_files import print_board
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import CAMERAS
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.io.views_file import write_views
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.render_scenes.sets.render_set import render_set
from tests.shared import built_once
from tests.small_set import small_set_request

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")


def findings(name: str, content: Any) -> list[str]:
    """What a schema has against the content of a file."""
    validator = jsonschema.Draft202012Validator(schema(name))
    return [f"{list(each.absolute_path)}: {each.message[:200]}" for each in validator.iter_errors(content)]


def of_file(path: Path) -> Any:
    text = path.read_text(encoding="utf-8")
    return tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)


@pytest.fixture(scope="module")
def rendered(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small rendered set."""
    request = small_set_request(default_layout)
    return built_once(tmp_path_factory, "small_set", lambda out: render_set(request, out))


@pytest.mark.parametrize("name", FILES)
def test_the_files_are_those_of_the_models(name: str) -> None:
    path = FOLDER / f"{name}.schema.json"
    assert path.read_text(encoding="utf-8") == schema_text(name), "run python docs/make_schemas.py"
    jsonschema.Draft202012Validator.check_schema(schema(name))


def test_there_are_no_others() -> None:
    assert {path.name for path in FOLDER.iterdir()} == {f"{name}.schema.json" for name in FILES}


@pytest.mark.parametrize("path", sorted(CAMERAS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_cameras_of_the_library_are_valid(path: Path) -> None:
    assert findings("camera_profile", of_file(path)) == []


def test_files_of_a_rendered_set_are_valid(rendered: Path) -> None:
    assert findings("layout", of_file(rendered / "layout.json")) == []
    assert findings("layout", of_file(rendered / "truth" / "layout.json")) == []
    assert findings("board", of_file(rendered / "board.toml")) == []
    assert findings("dataset", of_file(rendered / "dataset.json")) == []


def test_files_that_a_user_writes_are_valid(tmp_path: Path) -> None:
    write_text(tmp_path / "design.toml", request_toml(DesignSpec(pattern=Pattern.hexagonal(1))))
    assert findings("design", of_file(tmp_path / "design.toml")) == []
    assert findings("design", {"camera": "brio", "rows": 2}) == []
    write_text(tmp_path / "hardware.toml", hardware_toml(Hardware()))
    assert findings("hardware", of_file(tmp_path / "hardware.toml")) == []
    assert findings("hardware", {"camera": "brio", "prices": {"each": {"M3 nut": 0.1}}}) == []
    assert findings("camera", Camera.c920().model_dump(mode="json")) == []
    assert findings("poses", {"poses": np.eye(4)[None].tolist()}) == []
    print_board(tmp_path / "board.pdf")
    assert findings("board", of_file(tmp_path / "board.toml")) == []


def test_figures_and_views_are_valid(tmp_path: Path) -> None:
    write_metrics(tmp_path / "metrics.json", {"error": Metric(value=0.1, unit="px", limit=1.0)})
    assert findings("metrics", of_file(tmp_path / "metrics.json")) == []
    places = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0]), axis=-1)
    write_views(tmp_path / "views.json", Views.parallel(places, (4, 3), 100.0, 400.0))
    assert findings("views", of_file(tmp_path / "views.json")) == []


def test_the_views_of_a_device_are_valid(default_layout: Layout) -> None:
    described = json.loads(described_views(default_layout).model_dump_json(by_alias=True))
    assert findings("device_views", described) == []
    assert findings("views", described) != []


def test_every_kind_of_file_has_a_schema_name_of_its_own() -> None:
    stated = [schema(name).get("properties", {}).get("schema", {}).get("const") for name in FILES]
    names = [each for each in stated if each is not None]
    assert len(names) > 10
    assert sorted(names) == sorted(set(names))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("design", {"row": 2}),
        ("design", {"rows": 13}),
        ("poses", {"poses": np.eye(3)[None].tolist()}),
        ("pattern", {"positions": [[0.0, 1.0, 2.0]]}),
        ("board", {"kind": "charuco", "cols": 1, "rows": 3}),
        ("camera", {"width_px": 640}),
        ("metrics", {"error": {"value": "small", "unit": "px"}}),
    ],
)
def test_what_models_refuse_a_schema_refuses(name: str, content: Any, tmp_path: Path) -> None:
    write_json(tmp_path / "file.json", content)
    assert findings(name, of_file(tmp_path / "file.json")) != []
