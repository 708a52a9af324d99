"""Which package may import what, read from the source of every module, and what `import mirrorcam.cli` may load."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# The four packages and the folders that hold them.
FOLDERS = {
    "mirrorcam.optics": ROOT / "optics",
    "mirrorcam.cad": ROOT / "cad",
    "mirrorcam.render_scenes": ROOT / "render_scenes",
    "mirrorcam": ROOT / "src" / "mirrorcam",
}
OPTICS = {"numpy", "scipy", "cv2", "numba", "simplejpeg", "casadi", "pydantic", "pydantic_core", "shapely", "yaml"}
# Our own packages and libraries that a package may import beside the standard library and itself. What only `cad` and
# `render_scenes` import comes with the extras of these names, distributed with `cluster`, fsspec with `remote`, pyarrow
# with `parquet`, rosbags and its backports.zstd and lz4 with `robot`, rerun with `view`;
# everything else is in the base installation.
MAY_IMPORT = {
    # Videos and animations are read and written, and streams of light fields, where these are made; all imported late.
    # The template kit of HTML pages is in `base`: pages of `cad` and of `mirrorcam` are made with it.
    "mirrorcam.optics": OPTICS
    | {"av", "zarr", "numcodecs", "PIL", "h5py", "jinja2", "markupsafe"}
    # Zstandard is `compression.zstd` of the standard library from Python 3.14 on, and in backports before.
    | {"rosbags", "backports", "compression", "lz4"},
    "mirrorcam.cad": OPTICS
    | {"mirrorcam.optics", "build123d", "OCP", "trimesh", "manifold3d", "ezdxf", "lib3mf", "skfem"}
    | {"matplotlib", "jinja2", "markupsafe", "markdown_it", "tomli_w"},
    "mirrorcam.render_scenes": OPTICS | {"mirrorcam.optics", "mitsuba", "drjit", "OpenEXR", "av"},
    "mirrorcam": OPTICS
    | {*FOLDERS, "matplotlib", "rich", "tyro", "distributed", "pyarrow", "markupsafe", "filelock", "rerun", "fsspec"}
    # The studio's server, and what writes design.toml.
    | {"starlette", "uvicorn", "tomli_w"},
}
# Inside each package, from the ground up: a folder may import those before it, never those after it. The package's own
# modules, beside the folders, stand where its name stands.
LAYERS = {
    "mirrorcam.optics": (
        *("base", "geometry", "design.program", "design.assess", "design", "exports"),
        *("calibration.solver", "calibration.detection", "calibration.diagnostics", "calibration.direct"),
        *(
            "calibration",
            "scoring",
            "scoring.camera_files",
            "light_field",
            "light_field.temporal",
            "light_field.depth",
            "light_field.render",
            "light_field.features",
        ),
        *("light_field.motion", "light_field.filters"),
        *("light_field.io", "light_field.io.formats", "drift", "alignment"),
    ),
    "mirrorcam.cad": (
        *("plan", "splitting", "mirrors", "holder", "parts", "backs", "assembly"),
        *("write", "checks", "elasticity", "documents", ""),
    ),
    "mirrorcam.render_scenes": ("", "boards", "truth", "reference", "fast", "sets", "suites", "tabletop", "preview"),
    "mirrorcam": ("console", "pages", "pages.calibration", "figures", "workflow", "studio", "commands", ""),
}
# Neighbours that do without each other, whatever their order above.
APART = {
    "mirrorcam.optics": (
        *(("design.program", "design.assess"), ("design", "calibration"), ("design", "light_field")),
        *(
            ("design", "exports"),
            ("calibration", "light_field"),
            ("calibration", "exports"),
            ("light_field", "exports"),
            ("light_field", "scoring"),
            ("design", "scoring"),
        ),
    ),
    "mirrorcam.cad": (("holder", "mirrors"), ("parts", "mirrors"), ("checks", "documents"), ("write", "documents")),
    "mirrorcam.render_scenes": (("truth", "reference"), ("truth", "fast"), ("reference", "fast")),
}
LATE_FOR_THE_COMMAND = (
    *("casadi", "build123d", "OCP", "mitsuba", "drjit", "matplotlib", "scipy", "cv2", "shapely"),
    *("dask", "distributed", "pyarrow", "OpenEXR", "av", "zarr", "numcodecs", "PIL", "h5py", "jinja2"),
    *("rosbags", "rerun", "numba", "starlette", "uvicorn", "fsspec"),
)

KERNELS = {"build123d", "OCP", "manifold3d", "trimesh", "ezdxf", "lib3mf"}


def package_of(module: str) -> str:
    """Which of the four packages a module is in."""
    return next(package for package in FOLDERS if module == package or module.startswith(f"{package}."))


@cache
def modules() -> Mapping[str, Path]:
    """Every module of the tree by its dotted name; packages by theirs."""
    found = {}
    for package, folder in FOLDERS.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join([package, *(parts[:-1] if parts[-1] == "__init__" else parts)])] = path
    return found


def imported(source: str, module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of each import in a module's source, wherever in it the import stands."""
    package = module if is_package else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            names = {f"{base}.{alias.name}" for alias in node.names}
            inside = names & modules().keys() if base in modules() or base in FOLDERS else set()
            yield from ((node.lineno, name) for name in sorted(inside or {base}))
            if inside and inside != names:
                yield node.lineno, base
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in {"importlib.import_module", "__import__"}:
            yield from ((node.lineno, str(name.value)) for name in node.args[:1] if isinstance(name, ast.Constant))


def layer_of(module: str, is_package: bool) -> str:
    """The folder that a module is in, within its package, as `LAYERS` names it."""
    package = package_of(module)
    inside = module.removeprefix(package).removeprefix(".")
    folder = inside if is_package else inside.rpartition(".")[0]
    while folder and folder not in LAYERS[package]:
        folder = folder.rpartition(".")[0]
    return folder


def _within(folder: str, other: str) -> bool:
    return folder == other or folder.startswith(f"{other}.")


def trespasses(source: str, module: str, is_package: bool = False) -> list[str]:
    """What a module of ours imports against the rules, as `module:line imports name`."""
    package = package_of(module)
    own, layers = layer_of(module, is_package), LAYERS[package]
    apart = APART.get(package, ())
    wrong = []
    for line, name in imported(source, module, is_package):
        target = name.partition(".")[0]
        if target == "mirrorcam":
            target = package_of(name)
        allowed = target in MAY_IMPORT[package] or target in sys.stdlib_module_names
        if target == package:
            other = layer_of(name, name in modules() and modules()[name].name == "__init__.py")
            upward = own in layers and other in layers and layers.index(other) > layers.index(own)
            kept_apart = any(
                (_within(own, a) and _within(other, b)) or (_within(own, b) and _within(other, a)) for a, b in apart
            )
            # A package's own name is what it shows to others; its modules may read what it says of itself.
            allowed = name == package or not (upward or kept_apart)
        if not allowed:
            wrong.append(f"{module}:{line} imports {name}")
    return wrong


@pytest.mark.parametrize("module", modules(), ids=str)
def test_modules_import_only_what_their_layer_may(module: str) -> None:
    path = modules()[module]
    assert trespasses(path.read_text(encoding="utf-8"), module, path.name == "__init__.py") == []


def test_every_folder_with_modules_has_its_layer() -> None:
    homes = {
        (package_of(module), layer_of(module, path.name == "__init__.py"))
        for module, path in modules().items()
        if module not in FOLDERS and not (package_of(module) == "mirrorcam.optics" and module.count(".") == 1)
    }
    assert homes - {("mirrorcam.optics", "")} <= {
        (package, layer) for package, layers in LAYERS.items() for layer in layers
    }
    assert {package for package, _ in homes} == set(FOLDERS)


def test_no_modules_import_each_other_in_a_circle() -> None:
    arrows = {
        module: {name for _, name in imported(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")}
        & modules().keys() - {module}
        for module, path in modules().items()
    }
    # What nothing that is left imports, or imports nothing that is left, is in no circle.
    while loose := {
        module
        for module, names in arrows.items()
        if not names & arrows.keys() or not any(module in others for others in arrows.values())
    }:
        arrows = {module: names for module, names in arrows.items() if module not in loose}
    assert sorted(arrows) == []


@pytest.mark.parametrize(
    ("source", "module", "complaint"),
    [
        ("import mirrorcam.cad", "mirrorcam.optics.geometry.layout", "1 imports mirrorcam.cad"),
        ("import optics.layout", "mirrorcam.cad.build", "1 imports optics.layout"),
        (
            "def f():\n    from mirrorcam.cad.build import build_parts",
            "mirrorcam.optics.geometry.layout",
            "2 imports mirrorcam.cad.build",
        ),
        (
            "from mirrorcam import render_scenes",
            "mirrorcam.optics.geometry.layout",
            "1 imports mirrorcam.render_scenes",
        ),
        ("import mirrorcam.cli", "mirrorcam.optics.geometry.layout", "1 imports mirrorcam.cli"),
        ("import mitsuba as mi", "mirrorcam.optics.geometry.camera", "1 imports mitsuba"),
        ("import json\nimport matplotlib.pyplot as plt", "mirrorcam.optics.x", "2 imports matplotlib.pyplot"),
        ("from build123d import *", "mirrorcam.optics.geometry.camera", "1 imports build123d"),
        ("if TYPE_CHECKING:\n    import trimesh", "mirrorcam.optics.geometry.camera", "2 imports trimesh"),
        ("import mirrorcam.render_scenes.variant", "mirrorcam.cad.build", "1 imports mirrorcam.render_scenes.variant"),
        ("import mitsuba", "mirrorcam.cad.build", "1 imports mitsuba"),
        ("import mirrorcam.cli", "mirrorcam.cad.build", "1 imports mirrorcam.cli"),
        ("from mirrorcam.cad import build", "mirrorcam.render_scenes.fast.x", "1 imports mirrorcam.cad.build"),
        (
            "importlib.import_module('mirrorcam.cad.build')",
            "mirrorcam.render_scenes.x",
            "1 imports mirrorcam.cad.build",
        ),
        ("from tests.helpers import a", "mirrorcam.cli", "1 imports tests.helpers"),
        ("import build123d", "mirrorcam.cli", "1 imports build123d"),
        # A lower folder that imports a higher one, and neighbours that do without each other.
        (
            "import mirrorcam.optics.design.optimise",
            "mirrorcam.optics.geometry.x",
            "1 imports mirrorcam.optics.design.optimise",
        ),
        ("from mirrorcam.commands import cad", "mirrorcam.workflow.pipeline", "1 imports mirrorcam.commands.cad"),
        (
            "from mirrorcam.optics.design.assess.verify import verify",
            "mirrorcam.optics.design.program.seeds",
            "1 imports mirrorcam.optics.design.assess.verify",
        ),
        (
            "from mirrorcam.optics.calibration.solver import residuals",
            "mirrorcam.optics.light_field.decoder",
            "1 imports mirrorcam.optics.calibration.solver.residuals",
        ),
    ],
)
def test_the_check_sees_a_bad_import(source: str, module: str, complaint: str) -> None:
    assert trespasses(source, module) == [f"{module}:{complaint}"]


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ("import numpy, json\nfrom mirrorcam.optics.base.values import Value", "mirrorcam.optics.geometry.camera"),
        ("from .camera import Camera", "mirrorcam.optics.geometry.layout"),
        ("from ..base.values import Value", "mirrorcam.optics.geometry.design_spec"),
        ("from mirrorcam.optics.geometry.layout import Layout\nimport build123d", "mirrorcam.cad.build"),
        ("from mirrorcam.optics.geometry.layout import Layout\nimport mitsuba", "mirrorcam.render_scenes.fast.x"),
        ("import mirrorcam.cad.build\nimport mirrorcam.render_scenes\nimport tyro", "mirrorcam.commands.run"),
    ],
)
def test_the_check_lets_a_good_import_pass(source: str, module: str) -> None:
    assert trespasses(source, module) == []


def test_imports_out_of_a_package_are_followed() -> None:
    assert list(imported("from . import build", "mirrorcam.cad", is_package=True)) == [(1, "mirrorcam.cad.build")]
    assert list(imported("from .build import x", "mirrorcam.cad", is_package=True)) == [(1, "mirrorcam.cad.build")]


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint('\\n'.join(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return {name.partition(".")[0] for name in done.stdout.split()}


def test_the_command_starts_without_its_heavy_libraries() -> None:
    loaded = loaded_by("import mirrorcam.cli")
    assert "mirrorcam" in loaded
    assert loaded.isdisjoint(LATE_FOR_THE_COMMAND)


def test_plans_of_parts_are_numbers_without_a_cad_kernel() -> None:
    plans = [module for module in modules() if module.startswith("mirrorcam.cad.plan")]
    assert len(plans) > 8
    assert loaded_by(f"import {', '.join(plans)}").isdisjoint(KERNELS)


def test_the_check_of_loaded_modules_sees_a_heavy_one() -> None:
    assert "cv2" in loaded_by("import mirrorcam.optics.base.pictures")
