"""Which room may import what, read from the source of every module, and what `import mirrorcam.cli` may load."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = {"optics", "cad", "render_scenes", "mirrorcam"}
OPTICS = {"numpy", "scipy", "cv2", "casadi", "pydantic", "pydantic_core", "shapely"}
# Of our own rooms and of libraries: what a room may import beside the standard library and itself. Those of `cad` and
# `render_scenes` alone come with the extras of these names, distributed and pyarrow with `cluster` and `parquet`;
# everything else is in the base installation.
MAY_IMPORT = {
    # Videos and loops are read and written, and streams of light fields, where these are made; all imported late.
    "optics": OPTICS | {"av", "zarr", "PIL", "h5py"},
    "cad": OPTICS
    | {"optics", "build123d", "OCP", "trimesh", "manifold3d", "ezdxf", "lib3mf", "matplotlib", "jinja2", "markdown_it"},
    "render_scenes": OPTICS | {"optics", "mitsuba", "drjit", "OpenEXR", "av"},
    "mirrorcam": ROOMS | OPTICS | {"matplotlib", "rich", "tyro", "distributed", "pyarrow"},
}
LATE_FOR_THE_COMMAND = (
    *("casadi", "build123d", "OCP", "mitsuba", "drjit", "matplotlib", "scipy", "cv2", "shapely"),
    *("dask", "distributed", "pyarrow", "OpenEXR", "av", "zarr", "PIL", "h5py"),
)


def imported(source: str, module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of each import in a module's source, wherever in it the import stands."""
    package = module if is_package else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            relative = "." * node.level + (node.module or "")
            yield node.lineno, importlib.util.resolve_name(relative, package)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in {"importlib.import_module", "__import__"}:
            yield from ((node.lineno, str(name.value)) for name in node.args[:1] if isinstance(name, ast.Constant))


def trespasses(source: str, module: str, is_package: bool = False) -> list[str]:
    """What a module of one of our rooms imports against the rules, as `module:line imports name`."""
    room = module.partition(".")[0]
    allowed = MAY_IMPORT[room] | {room} | sys.stdlib_module_names
    return [
        f"{module}:{line} imports {name}"
        for line, name in imported(source, module, is_package)
        if name.partition(".")[0] not in allowed
    ]


def modules() -> list[Path]:
    return sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_rooms_import_only_what_they_may(path: Path) -> None:
    is_package = path.name == "__init__.py"
    parts = path.relative_to(ROOT).with_suffix("").parts
    module = ".".join(parts[:-1] if is_package else parts)
    assert trespasses(path.read_text(encoding="utf-8"), module, is_package) == []


def test_every_room_is_looked_at() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in modules()} == ROOMS


@pytest.mark.parametrize(
    ("source", "module", "complaint"),
    [
        ("import cad", "optics.layout", "1 imports cad"),
        ("def f():\n    from cad.build import build", "optics.layout", "2 imports cad.build"),
        ("from render_scenes import dataset", "optics.layout", "1 imports render_scenes"),
        ("import mirrorcam.cli", "optics.layout", "1 imports mirrorcam.cli"),
        ("import mitsuba as mi", "optics.camera", "1 imports mitsuba"),
        ("import drjit", "optics.camera", "1 imports drjit"),
        ("import json\nimport matplotlib.pyplot as plt", "optics.camera", "2 imports matplotlib.pyplot"),
        ("from build123d import *", "optics.camera", "1 imports build123d"),
        ("if TYPE_CHECKING:\n    import trimesh", "optics.camera", "2 imports trimesh"),
        ("import render_scenes.dataset", "cad.build", "1 imports render_scenes.dataset"),
        ("import mitsuba", "cad.build", "1 imports mitsuba"),
        ("import mirrorcam", "cad.build", "1 imports mirrorcam"),
        ("from cad import build", "render_scenes.reference.scene", "1 imports cad"),
        ("import build123d", "render_scenes.reference.scene", "1 imports build123d"),
        ("importlib.import_module('cad.build')", "render_scenes.reference.scene", "1 imports cad.build"),
        ("from tests.helpers import a", "mirrorcam.cli", "1 imports tests.helpers"),
        ("import build123d", "mirrorcam.cli", "1 imports build123d"),
    ],
)
def test_the_check_sees_a_bad_import(source: str, module: str, complaint: str) -> None:
    assert trespasses(source, module) == [f"{module}:{complaint}"]


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ("import numpy, json\nfrom optics.values import Value", "optics.camera"),
        ("from .values import Value\nfrom . import files", "optics.camera"),
        ("from ..values import Value", "optics.design.spec"),
        ("from optics.layout import Layout\nimport build123d", "cad.build"),
        ("from optics.layout import Layout\nimport mitsuba", "render_scenes.reference.scene"),
        ("import cad.build\nimport render_scenes\nimport tyro", "mirrorcam.run"),
    ],
)
def test_the_check_lets_a_good_import_pass(source: str, module: str) -> None:
    assert trespasses(source, module) == []


def test_a_relative_import_out_of_a_package_is_followed() -> None:
    assert list(imported("from . import build", "cad", is_package=True)) == [(1, "cad")]
    assert list(imported("from .build import part", "cad", is_package=True)) == [(1, "cad.build")]


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint('\\n'.join(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return {name.partition(".")[0] for name in done.stdout.split()}


def test_the_command_starts_without_its_heavy_libraries() -> None:
    loaded = loaded_by("import mirrorcam.cli")
    assert "mirrorcam" in loaded
    assert loaded.isdisjoint(LATE_FOR_THE_COMMAND)


def test_the_check_of_loaded_modules_sees_a_heavy_one() -> None:
    assert "cv2" in loaded_by("import optics.files")
