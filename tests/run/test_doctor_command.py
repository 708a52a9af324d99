"""`mirrorcam doctor`: what it prints, and when it fails."""

from __future__ import annotations

import json

import pytest

from mirrorcam import __version__, cli
from mirrorcam.run import self_tests as tests_of_parts
from mirrorcam.run.doctor_command import describe
from mirrorcam.run.installation import Extra, Installation, Package, Program
from tests.test_public_api import after

NUMPY = Package(name="numpy", installed="2.4.6", tested="2.4.6")
DASK = Package(name="dask", installed="2026.9", tested="2026.8.0")
FOUND = Installation(
    version="1.2.3",
    folder="/opt/mirrorcam",
    python="3.13.1",
    executable="/opt/python",
    system="Linux",
    extras=(
        Extra(name="base", purpose="", packages=(NUMPY,), missing=()),
        Extra(name="cluster", purpose="sweeps", packages=(DASK,), missing=("distributed",)),
    ),
    programs=(Program(name="gmsh", purpose="meshes", path=None),),
)


def test_each_line_says_what_is_there_what_was_tested_and_what_is_missing() -> None:
    lines = dict(describe(FOUND))
    assert lines["mirrorcam"] == "1.2.3 in /opt/mirrorcam"
    assert lines["base"] == "numpy 2.4.6"
    expected = 'distributed missing; for sweeps: pip install "mirrorcam[cluster]"; installed: dask 2026.9 (2026.8.0)'
    assert lines["cluster"] == expected
    assert lines["gmsh"] == "not found; for meshes"


def test_the_list_is_printed_without_loading_what_it_lists(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--no-tests"]) == 0
    assert f"mirrorcam    {__version__} in " in capsys.readouterr().out
    loaded = after(
        "import mirrorcam.cli as c; c.sys.stdout = open(c.os.devnull, 'w'); "
        "c.main(['doctor', '--no-tests']); c.sys.stdout = c.sys.__stdout__; import mirrorcam"
    )["modules"]
    assert "mirrorcam.run.installation" in loaded
    assert {"numpy", "casadi", "build123d", "mitsuba", "cv2", "numba", "dask"} & set(loaded) <= {"numpy"}


@pytest.mark.parametrize(("wrong", "code"), [(False, 0), (True, 1)])
def test_a_part_that_fails_is_named_and_makes_it_fail(
    wrong: bool, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    results = (
        tests_of_parts.SelfTest(name="design", passed=True, said="4 mirrors designed", seconds=1.0),
        tests_of_parts.SelfTest(name="cad", passed=not wrong, said="a solid", seconds=2.0),
    )
    monkeypatch.setattr(tests_of_parts, "self_tests", lambda names: iter(results))
    assert cli.main(["doctor"]) == code
    *_, design, cad, last = capsys.readouterr().out.splitlines()
    assert design == "test         design     passed: 4 mirrors designed (1.0 s)"
    assert cad == f"test         cad        {'FAILED' if wrong else 'passed'}: a solid (2.0 s)"
    assert last == f"doctor       {'failed: cad' if wrong else '2 parts tested, all work'}"
    assert cli.main(["doctor", "--json"]) == code
    printed = json.loads(capsys.readouterr().out)
    assert (printed["version"], printed["exit_code"]) == (__version__, code)
    assert "messages" not in printed
    assert [test["passed"] for test in printed["tests"]] == [True, not wrong]


def test_the_version_is_printed_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"mirrorcam {__version__}\n"
