"""What an installation is said to have: against the metadata, the constraints, and where things are missing."""

from __future__ import annotations

import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import mirrorcam
from mirrorcam.core.extras import MODULES
from mirrorcam.run.installation import PURPOSES, constrained_versions, installation
from tests.test_architecture import ROOT

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]


def test_every_extra_is_told_of_with_what_it_is_for() -> None:
    """But of those that only work on the project itself needs, and of all together."""
    assert set(PURPOSES) == {"base", *EXTRAS} - {"all", "dev", "docs"}
    assert set(MODULES) == set(PURPOSES) - {"base"}


def test_versions_are_those_of_the_metadata_and_of_the_constraints() -> None:
    found = installation()
    assert found.version == mirrorcam.__version__
    assert Path(found.folder) == Path(mirrorcam.__file__).parent
    base = next(extra for extra in found.extras if extra.name == "base")
    packages = {package.name: package for package in base.packages}
    assert packages["numpy"].installed == metadata.version("numpy")
    assert packages["numpy"].tested == constrained_versions()["numpy"]
    assert base.missing == ()


def test_every_library_of_an_extra_has_a_tested_version() -> None:
    packages = [package for extra in installation().extras for package in extra.packages]
    assert len(packages) > 30
    assert [package.name for package in packages if package.tested is None] == []


def test_what_is_missing_is_named_and_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirrorcam.core.extras.find_spec", lambda name: None if name == "lib3mf" else object())
    monkeypatch.setattr("shutil.which", lambda command, path: None)
    found = installation()
    missing = {extra.name: extra.missing for extra in found.extras}
    assert missing["cad"] == ("lib3mf",)
    assert missing["render"] == ()
    assert [program.path for program in found.programs] == [None, None]


def test_an_installed_wheel_reads_the_constraints_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "constraints.txt").write_text("# Comment\nSome_Thing==1.2.3\nother==4\n")
    monkeypatch.setattr(mirrorcam, "__file__", str(tmp_path / "__init__.py"))
    assert constrained_versions() == {"some-thing": "1.2.3", "other": "4"}
