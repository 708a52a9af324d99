"""Fingerprints: equal for equal things, and differences said in words."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest

from mirrorcam.core.disk import fingerprint
from mirrorcam.core.disk.fingerprint import (
    Fingerprint,
    differing,
    digest,
    distributions,
    file_digest,
    file_digests,
    source_digest,
    source_digests,
    value_digest,
    versions,
)

# sha256 of "abc", from FIPS 180-4.
ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_digests_are_sha256_of_the_content(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"abc")
    assert digest(b"a", b"bc") == file_digest(tmp_path / "a.txt") == ABC
    assert file_digests(tmp_path / "a.txt") == {"a.txt": ABC}


def test_a_folder_is_digested_file_by_file_without_what_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    for name in ("deep/b.txt", "a.txt", ".manifest"):
        (tmp_path / name).write_bytes(b"abc")
    assert list(file_digests(tmp_path, without=".manifest")) == ["a.txt", "deep/b.txt"]


def test_a_value_has_one_digest_whatever_the_order_of_its_keys() -> None:
    assert (
        value_digest({"a": 1, "b": [2.0]}) == value_digest({"b": [2.0], "a": 1}) != value_digest({"a": 1, "b": [3.0]})
    )


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "some_package_of_this_test"
    (folder / "inner").mkdir(parents=True)
    for name in ("__init__.py", "inner/module.py", "page.html"):
        (folder / name).write_text("x = 1")
    monkeypatch.syspath_prepend(str(tmp_path))
    source_digest.cache_clear()
    return folder


@pytest.mark.parametrize("changed", ["__init__.py", "inner/module.py", "page.html"])
def test_the_digest_of_a_package_sees_every_file_of_it(package: Path, changed: str) -> None:
    before = source_digest(package.name)
    (package / changed).write_text("x = 2")
    source_digest.cache_clear()
    assert source_digest(package.name) != before


def test_compiled_files_do_not_count_as_sources(package: Path) -> None:
    before = source_digest(package.name)
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "module.pyc").write_bytes(b"0")
    source_digest.cache_clear()
    assert source_digest(package.name) == before


def test_a_module_that_is_not_there_has_no_digest() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"no module 'mirrorcam\.nonsense'"):
        source_digest("mirrorcam.nonsense")


def test_the_digests_of_a_package_are_those_of_what_is_directly_in_it(package: Path) -> None:
    (package / "other.py").write_text("x = 3")
    found = source_digests(package.name, without=("inner",))
    assert found == {f"{package.name}.other": source_digest(f"{package.name}.other")}
    (package / "inner" / "__init__.py").write_text("")
    assert set(source_digests(package.name)) == {f"{package.name}.other", f"{package.name}.inner"}


def test_distributions_are_those_of_the_metadata_and_their_compiled_ones() -> None:
    base, cad, render = distributions(), distributions("cad"), distributions("render")
    assert {"opencv-contrib-python-headless", "numpy", "pydantic-core", "jinja2", "markupsafe"} <= set(base)
    assert {"markdown-it-py", "cadquery-ocp-novtk"} <= set(cad) - set(base)
    assert {"mitsuba", "drjit", "openexr", "karellen-llvm-core"} <= set(render) - set(base) - set(cad)
    assert not {"ipython", "pytest"} & {*base, *cad, *render}
    assert set(cad) | set(render) <= set(distributions("all"))


@pytest.mark.parametrize(
    ("line", "extras", "found"),
    [
        ("numpy>=2,<3", (), {"numpy"}),
        ("OpenEXR>=3.4; extra == 'render'", (), set()),
        ("OpenEXR>=3.4; extra == 'render'", ("render",), {"openexr"}),
        ('py_lib.x[more]>=1; sys_platform == "linux" and extra == "cad"', ("cad",), {"py-lib-x"}),
        ('tzdata; sys_platform == "win32"', (), {"tzdata"}),
    ],
)
def test_requirements_are_read_with_their_extras(
    line: str, extras: tuple[str, ...], found: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metadata, "requires", lambda name: [line])
    assert fingerprint.required("some", frozenset(extras)) == found


def test_versions_are_the_installed_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    assert versions()["numpy"] == metadata.version("numpy")

    def missing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", missing)
    assert set(versions().values()) == {"not installed"}


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (Fingerprint(parameters={"rows": 4}), "other parameters"),
        (Fingerprint(parameters={"rows": 3}, reads={"layout.json": "1"}), "layout.json changed"),
        (Fingerprint(parameters={"rows": 3}, sources={"mirrorcam.cad": "1"}), "mirrorcam.cad changed"),
        (Fingerprint(parameters={"rows": 3}, versions={"numpy": "2.4"}), "numpy not installed → 2.4"),
        (Fingerprint(parameters={"rows": 3}), ""),
    ],
)
def test_what_changed_is_said_in_words(now: Fingerprint, words: str) -> None:
    before = Fingerprint(parameters={"rows": 3})
    assert now.changed_since(before) == words
    assert (now.digest == before.digest) == (not words)


def test_differing_names_are_those_of_either_side() -> None:
    assert differing({"a": 1, "b": 2, "c": None}, {"b": 3, "a": 1}) == ["b", "c"]
