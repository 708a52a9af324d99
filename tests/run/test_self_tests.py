"""The tests of an installation's parts: each passes here, and a broken part is told, however it breaks."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mirrorcam.core.extras import MODULES, missing_modules
from mirrorcam.core.processes.child_program import run_program
from mirrorcam.run import self_tests as module
from mirrorcam.run.installation import Extra, Installation, Program
from mirrorcam.run.self_tests import TESTS, SelfTest, expect, parts_to_test, self_tests


def installed(*missing: str, gmsh: str | None = "/usr/bin/gmsh") -> Installation:
    extras = tuple(
        Extra(name=name, purpose="", packages=(), missing=("x",) if name in missing else ()) for name in MODULES
    )
    texts = dict.fromkeys(("version", "folder", "python", "executable", "system"), "")
    return Installation(extras=extras, programs=(Program(name="gmsh", purpose="", path=gmsh),), **texts)


def test_every_extra_has_a_test() -> None:
    assert set(MODULES) <= set(TESTS)


def test_what_is_not_installed_is_not_tried() -> None:
    assert parts_to_test(installed()) == tuple(TESTS)
    assert set(TESTS) - set(parts_to_test(installed("cad", "view"))) == {"cad", "fe", "view"}
    assert set(TESTS) - set(parts_to_test(installed(gmsh=None))) == {"fe"}


# Those of the other extras start libraries that take seconds to load.
@pytest.mark.parametrize("name", ["design", "decode", "parquet", "robot", "studio"])
def test_a_part_of_this_installation_works(name: str) -> None:
    if missing_modules(name) if name in MODULES else []:
        pytest.skip(f"the extra {name} is not installed")
    assert TESTS[name]()


@pytest.mark.slow
def test_all_parts_of_this_installation_work() -> None:
    from mirrorcam.run.installation import installation

    results = list(self_tests(parts_to_test(installation())))
    assert [(result.name, result.said) for result in results if not result.passed] == []


def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str) -> SelfTest:
    """The result where the process of a test runs this code instead."""

    def run(command: list[str], **settings: object) -> object:
        assert command[1:3] == ["-P", "-c"]
        return run_program([*command[:3], code], **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "run_program", run)
    monkeypatch.chdir(tmp_path)
    (result,) = self_tests(("design",))
    return result


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("raise ValueError('3 mirrors designed')", "ValueError: 3 mirrors designed"),
        ("import os; os.kill(os.getpid(), 9)", "ended with exit code"),
        ("print('1' * 9, end=''); raise SystemExit('library not found')", "library not found"),
    ],
)
def test_a_part_that_fails_is_told(code: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = broken(tmp_path, monkeypatch, code)
    assert not result.passed
    assert result.said.startswith(said)


def test_a_part_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TIMEOUT_S", 1.0)
    result = broken(tmp_path, monkeypatch, "import time; time.sleep(60)")
    assert (result.passed, result.said) == (False, "took longer than 1 s")
    assert result.seconds < 30.0


def test_the_process_imports_this_package_and_nothing_of_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mirrorcam").mkdir()
    (tmp_path / "mirrorcam" / "__init__.py").write_text("raise RuntimeError('another mirrorcam')")
    code = "import json, mirrorcam; print('a remark of a library'); print(json.dumps(mirrorcam.__file__))"
    result = broken(tmp_path, monkeypatch, code)
    assert result.passed, result.said
    assert (
        Path(result.said).parts[-3:] == ("src", "mirrorcam", "__init__.py") or os.sep + "site-packages" in result.said
    )


def test_a_wrong_figure_fails() -> None:
    assert expect(True, "a plane at 300 mm") == "a plane at 300 mm"
    with pytest.raises(ValueError, match="a plane at 200 mm"):
        expect(False, "a plane at 200 mm")
