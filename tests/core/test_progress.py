"""One way to report progress: every function that works long takes the same callback."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.test_architecture import FOLDERS, ROOT


def callbacks() -> Iterator[tuple[str, str, str]]:
    """Place, annotation and default of every parameter `progress` in the four packages."""
    for folder in FOLDERS.values():
        for path in sorted(folder.rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    given = node.args
                    named = [*given.posonlyargs, *given.args]
                    defaults = [None] * (len(named) - len(given.defaults)) + [*given.defaults, *given.kw_defaults]
                    for argument, default in zip([*named, *given.kwonlyargs], defaults, strict=True):
                        if argument.arg == "progress":
                            annotation = ast.unparse(argument.annotation) if argument.annotation else ""
                            place = f"{path.relative_to(ROOT)}:{node.name}"
                            yield place, annotation, ast.unparse(default) if default else ""


def test_every_progress_is_the_same_callback_that_by_default_reports_to_nobody() -> None:
    found = list(callbacks())
    assert len(found) > 10
    assert [each for each in found if each[1] != "Progress" or each[2] not in ("", "no_progress")] == []
