"""What the loader does not find is told with the package that holds it, by every command and by the doctor."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.console.system_libraries import missing_library, missing_library_of
from mirrorcam.run.self_tests import self_tests

GLIBC = "libGL.so.1: cannot open shared object file: No such file or directory"
MUSL = "Error loading shared library libGL.so.1: No such file or directory (needed by /usr/lib/OCP.so)"
PACKAGE = "the system library libGL.so.1 is missing: apt-get install libgl1 (on Fedora, dnf install mesa-libGL)"


@pytest.mark.parametrize("text", [GLIBC, MUSL, f"Traceback\nImportError: {GLIBC}"])
def test_the_package_of_a_library_is_named(text: str) -> None:
    assert missing_library(text) == PACKAGE


def test_other_libraries_are_named_themselves_and_other_errors_are_none() -> None:
    found = missing_library("libfoo-2.so.5: cannot open shared object file: No such file or directory")
    assert found is not None
    assert "the system library libfoo-2.so.5 is missing" in found
    assert missing_library("No module named 'libGL'") is None
    assert missing_library_of(ValueError(GLIBC)) is None


def test_the_loader_of_this_system_words_it_so() -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("the loaders of Linux are known")
    with pytest.raises(OSError, match="libnone") as error:
        ctypes.CDLL("libnone-of-mirrorcam.so.1")
    found = missing_library_of(error.value)
    assert found is not None
    assert "the system library libnone-of-mirrorcam.so.1 is missing" in found


def test_a_command_ends_with_the_package(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def fails() -> int:
        try:
            raise ImportError(GLIBC)
        except ImportError as error:
            raise RuntimeError("cannot load") from error

    monkeypatch.setattr("mirrorcam.run.doctor_command.doctor", fails)
    assert cli.main(["doctor"]) == 2
    assert capsys.readouterr().err == f"mirrorcam: {PACKAGE}\n"


def test_the_doctor_names_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "build123d.py").write_text(f"raise ImportError({GLIBC!r})")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (result,) = self_tests(("cad",))
    assert (result.passed, result.said) == (False, PACKAGE)
