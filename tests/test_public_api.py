"""The names that `import mirrorcam` offers: all there, documented, typed, and cheap until they are used."""

from __future__ import annotations

import ast
import inspect
import json
import subprocess
import sys
from pathlib import Path

import pytest

import mirrorcam

ROOT = Path(__file__).parents[1]
# What the library of a light field camera cannot do without.
ASKED_FOR = {
    *("Layout", "Camera", "DesignSpec", "design", "build_parts", "render_set", "calibrate", "validate"),
    *("Decoder", "LightField", "open_light_field", "estimate_depth"),
}


def after(statement: str) -> dict[str, list[str]]:
    """Modules that a fresh interpreter has loaded after a statement, and names that `mirrorcam` has."""
    listed = "{'modules': list(sys.modules), 'names': dir(mirrorcam)}"
    code = f"{statement}\nimport json, sys\nprint(json.dumps({listed}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    found: dict[str, list[str]] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("name", mirrorcam.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    public = getattr(mirrorcam, name)
    assert public.__name__ == name
    documentation = inspect.getdoc(public)
    assert documentation is not None
    if inspect.isfunction(public):
        for section in ("Parameters\n----------\n", "Returns\n-------\n"):
            assert section in documentation or (section[0] == "R" and public.__annotations__["return"] == "None")
        undocumented = [
            parameter for parameter in inspect.signature(public).parameters if f"\n{parameter}" not in documentation
        ]
        assert [name for name in undocumented if f", {name}" not in documentation] == []


def test_what_was_asked_for_is_public() -> None:
    assert set(mirrorcam.__all__) >= ASKED_FOR
    assert mirrorcam.__all__ == sorted(mirrorcam.__all__)


def test_importing_loads_nothing_but_the_standard_library() -> None:
    found = after("import sys; before = set(sys.modules); import mirrorcam")
    ours = [name for name in found["modules"] if name.startswith("mirrorcam")]
    assert ours == ["mirrorcam"]
    assert {"numpy", "pydantic", "cv2", "scipy"}.isdisjoint(found["modules"])
    assert set(mirrorcam.__all__) <= set(found["names"])


def test_a_name_loads_its_own_module_once() -> None:
    found = after("import mirrorcam; assert mirrorcam.Camera is mirrorcam.Camera; mirrorcam.Camera.c920()")
    assert "mirrorcam.optics.geometry.camera" in found["modules"]
    assert {"casadi", "build123d", "mitsuba", "matplotlib"}.isdisjoint(found["modules"])


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'mirrorcam' has no attribute 'nonsense'"):
        _ = mirrorcam.nonsense  # type: ignore[attr-defined]  # the very thing that must fail
    with pytest.raises(ImportError, match="cannot import name 'nonsense'"):
        exec("from mirrorcam import nonsense")


def test_type_checkers_and_the_interpreter_take_names_from_the_same_modules() -> None:
    branches = (node for node in ast.parse(Path(mirrorcam.__file__).read_text()).body if isinstance(node, ast.If))
    (branch,) = (node for node in branches if ast.unparse(node.test) == "TYPE_CHECKING")
    imports = [node for node in branch.body if isinstance(node, ast.ImportFrom)]
    seen_by_checkers = {alias.name: node.module for node in imports for alias in node.names}
    (table,) = (node.value for node in branch.orelse if isinstance(node, ast.Assign))
    assert seen_by_checkers == {name: f"mirrorcam.{module}" for name, module in ast.literal_eval(table).items()}
    assert sorted(seen_by_checkers) == mirrorcam.__all__


def test_no_public_name_is_that_of_a_module() -> None:
    inside = {path.stem for path in Path(mirrorcam.__file__).parent.iterdir()}
    assert inside.isdisjoint(mirrorcam.__all__)
