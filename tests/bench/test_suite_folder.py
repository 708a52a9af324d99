"""Folders of suites: states of sets, manifests that are read strictly, and sets that come from elsewhere."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam.bench.suite_folder import put_files, read_finished, state_of
from mirrorcam.core.disk.files import write_json
from mirrorcam.core.errors import InputError
from mirrorcam.render_scenes.sets.dataset import MANIFEST, Dataset
from tests.small_set import contents

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@pytest.fixture
def suite_folder(finished_suite: Path, tmp_path: Path) -> Path:
    """A copy of the finished suite."""
    shutil.copytree(finished_suite, tmp_path / "suites")
    return tmp_path / "suites"


def first_set(folder: Path) -> Path:
    return sorted((folder / "sets").iterdir())[0]


def test_a_suite_is_read_by_its_manifest_or_its_folder(suite_folder: Path) -> None:
    found = read_finished(suite_folder)
    assert [each.name for each in found.manifest.sets] == ["one", "two"]
    assert list(found.folders) == sorted((suite_folder / "sets").iterdir())
    assert read_finished(suite_folder / "small.suite.json") == found
    shutil.copy(suite_folder / "small.suite.json", suite_folder / "other.suite.json")
    with pytest.raises(InputError, match=r"found other\.suite\.json, small\.suite\.json"):
        read_finished(suite_folder)


@pytest.mark.parametrize(
    "name", ["", "/etc", "C:\\sets\\one", "../sets/one", "sets/../../out", "sets/", "other/one", "sets/one/two"]
)
def test_a_manifest_names_no_folder_outside(name: str, suite_folder: Path) -> None:
    path = suite_folder / "small.suite.json"
    manifest = json.loads(path.read_text())
    manifest["sets"][0]["folder"] = name
    write_json(path, manifest)
    with pytest.raises(InputError):
        read_finished(path)


def test_a_manifest_whose_set_has_changed_is_refused(suite_folder: Path) -> None:
    dataset = first_set(suite_folder) / MANIFEST
    dataset.write_text(dataset.read_text() + " ")
    with pytest.raises(InputError, match=r"is not the set one of small\.suite\.json"):
        read_finished(suite_folder)
    dataset.unlink()
    with pytest.raises(InputError, match="expected the file as rendered"):
        read_finished(suite_folder)


def test_states(suite_folder: Path) -> None:
    folder = first_set(suite_folder)
    assert state_of(folder) == "finished"
    assert state_of(suite_folder / "sets" / "none") == "missing"
    (folder / "frames" / "0001.jpg").unlink()
    assert state_of(folder) == "begun"


def altered(folder: Path) -> None:
    (folder / "frames" / "0001.jpg").write_bytes(b"altered")


def foreign(folder: Path) -> None:
    (folder / MANIFEST).unlink()


def a_file(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_text("mine")


def a_link(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (altered, r"0001\.jpg: was changed since it was written"),
        (foreign, r"but no dataset\.json"),
        (a_file, "is not a folder, expected that of a set, or nothing"),
        (a_link, "is not a folder, expected that of a set, or nothing"),
    ],
)
def test_what_is_not_ours_is_refused(change: Callable[[Path], None], message: str, suite_folder: Path) -> None:
    folder = first_set(suite_folder)
    change(folder)
    with pytest.raises(InputError, match=message):
        state_of(folder)


def test_a_set_from_elsewhere_has_the_same_files(suite_folder: Path, tmp_path: Path) -> None:
    folder = first_set(suite_folder)
    put_files(tmp_path / "other", contents(folder))
    assert contents(tmp_path / "other") == contents(folder)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "suites"]
    put_files(tmp_path / "other", contents(folder))  # a begun or a finished one is gone on with
    assert contents(tmp_path / "other") == contents(folder)


def test_a_begun_set_is_completed_by_one_from_elsewhere(suite_folder: Path, tmp_path: Path) -> None:
    folder = first_set(suite_folder)
    shutil.copytree(folder, tmp_path / "other")
    (tmp_path / "other" / "frames" / "0001.jpg").unlink()
    put_files(tmp_path / "other", contents(folder))
    assert contents(tmp_path / "other") == contents(folder)


def test_a_set_from_elsewhere_that_is_not_whole_leaves_nothing(suite_folder: Path, tmp_path: Path) -> None:
    whole = contents(first_set(suite_folder))
    picture = "frames/0001.jpg"
    dataset = Dataset.model_validate_json(whole[MANIFEST])

    def listing(**files: str) -> dict[str, bytes]:
        listed = dataset.replaced(files=dataset.files | files)
        return whole | {MANIFEST: listed.model_dump_json(by_alias=True).encode()}

    faulty = {
        "does not match its checksum": whole | {picture: b"altered"},
        "expected only the files of a set": listing(**{"../out": "0" * 64}),
        "lacks frames/0001.jpg": whole
        | {
            MANIFEST: dataset.replaced(files={n: s for n, s in dataset.files.items() if n != picture})
            .model_dump_json(by_alias=True)
            .encode()
        },
    }
    for message, files in faulty.items():
        with pytest.raises(InputError, match=message):
            put_files(tmp_path / "sets" / "other", files)
        assert not (tmp_path / "sets" / "other").exists()
    assert not (tmp_path / "out").exists()
