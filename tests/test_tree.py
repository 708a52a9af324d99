"""The tests mirror the four folders: a module X/y.py, or src/X/y.py, has its tests in tests/X/test_y.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.test_architecture import FOLDERS, ROOT


def module_paths() -> list[str]:
    """Path of every module below the root or `src`; packages and entry points hold no code of their own to test."""
    paths = (
        Path(folder.name, path.relative_to(folder)) for folder in FOLDERS.values() for path in folder.rglob("*.py")
    )
    return [path.as_posix() for path in sorted(paths) if path.stem not in ("__init__", "__main__")]


def untested(paths: list[str], root: Path) -> set[str]:
    """The modules without a test at the mirrored path."""
    return {
        path for path in paths if not (root / "tests" / path).with_name(f"test_{path.rpartition('/')[2]}").is_file()
    }


def test_every_module_has_its_tests_at_the_mirrored_path() -> None:
    assert len(module_paths()) > 200
    assert sorted(untested(module_paths(), ROOT)) == []


@pytest.mark.parametrize(
    ("present", "missing"),
    [
        ("tests/optics/base/test_files.py", set()),
        ("tests/optics/test_files.py", {"optics/base/files.py"}),
        ("tests/optics/base/files.py", {"optics/base/files.py"}),
    ],
)
def test_a_test_elsewhere_or_of_another_name_does_not_count(present: str, missing: set[str], tmp_path: Path) -> None:
    (tmp_path / present).parent.mkdir(parents=True)
    (tmp_path / present).touch()
    assert untested(["optics/base/files.py"], tmp_path) == missing
