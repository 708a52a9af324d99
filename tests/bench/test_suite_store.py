"""Suites in object storage: on fsspec's memory and local back ends."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam.bench.suite_folder import read_finished
from mirrorcam.bench.suite_run import Plan, fetch_stored, make_plan
from mirrorcam.bench.suite_store import Store, fetch_set, publish
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.dataset import MANIFEST, Dataset
from mirrorcam.render_scenes.variant import choose_variant
from tests.small_set import contents
from tests.small_suite import small_suite

fsspec = pytest.importorskip("fsspec", reason="object storage needs the extra remote")
pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@pytest.fixture(params=["memory", "file"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """An empty place in memory, and one on the disk."""
    yield "memory://bucket/suites" if request.param == "memory" else f"file://{tmp_path}/bucket/suites"
    fsspec.filesystem("memory").store.clear()


@pytest.fixture
def stored(url: str, finished_suite: Path) -> Store:
    """A store that the small suite was published to."""
    store = Store(url)
    assert publish(read_finished(finished_suite).manifest, finished_suite, store) == 2
    return store


def files_of(store: Store) -> dict[str, bytes]:
    files, root = fsspec.core.url_to_fs(store.url)
    return {name.removeprefix(f"{root}/"): files.cat_file(name) for name in files.find(root)}


def change(store: Store, name: str, content: bytes) -> None:
    files, root = fsspec.core.url_to_fs(store.url)
    files.pipe_file(f"{root}/{name}", content)


def plan_of(folder: Path, layout: Layout, store: Store) -> Plan:
    return make_plan(small_suite(layout), folder, choose_variant(), store)


def test_what_is_published_is_fetched_with_the_same_bytes(
    stored: Store, finished_suite: Path, default_layout: Layout, tmp_path: Path
) -> None:
    plan = plan_of(tmp_path / "other", default_layout, stored)
    assert [each.state for each in plan.sets] == ["stored", "stored"]
    assert not plan.unfinished
    done = fetch_stored(plan, stored)
    assert [each.state for each in done.sets] == ["finished", "finished"]
    assert contents(tmp_path / "other" / "sets") == contents(finished_suite / "sets")
    here = plan_of(tmp_path / "other", default_layout, stored)
    assert [each.state for each in here.sets] == ["finished", "finished"]


def test_a_store_is_laid_out_as_the_folder(stored: Store, finished_suite: Path) -> None:
    names = {name for name in contents(finished_suite) if not name.startswith(".mirrorcam")}
    assert files_of(stored) == {name: content for name, content in contents(finished_suite).items() if name in names}


def test_a_second_publication_copies_nothing(stored: Store, finished_suite: Path) -> None:
    before = files_of(stored)
    assert publish(read_finished(finished_suite).manifest, finished_suite, stored) == 0
    assert files_of(stored) == before


def test_an_interrupted_publication_goes_on(stored: Store, finished_suite: Path) -> None:
    before = files_of(stored)
    folder = read_finished(finished_suite).folders[1]
    files, root = fsspec.core.url_to_fs(stored.url)
    files.rm(f"{root}/sets/{folder.name}/{MANIFEST}")
    change(stored, f"sets/{folder.name}/frames/0000.jpg", b"half of it")
    assert publish(read_finished(finished_suite).manifest, finished_suite, stored) == 1
    assert files_of(stored) == before


def test_what_others_have_stored_is_not_replaced(stored: Store, finished_suite: Path) -> None:
    manifest = read_finished(finished_suite).manifest
    for name, message in (
        (f"{manifest.sets[0].folder}/{MANIFEST}", "belongs to a different set"),
        ("small.suite.json", "is not a suite manifest"),
    ):
        before = files_of(stored)
        change(stored, name, b"{}")
        with pytest.raises(InputError, match=message):
            publish(manifest, finished_suite, stored)
        assert files_of(stored)[name] == b"{}"
        change(stored, name, before[name])
    change(stored, "small.suite.json", manifest.replaced(name="other").text.encode())
    with pytest.raises(InputError, match="belongs to the suite other, expected small"):
        publish(manifest, finished_suite, stored)


def test_a_suite_that_lacks_sets_is_published_without_its_manifest(url: str, finished_suite: Path) -> None:
    manifest = read_finished(finished_suite).manifest
    partial = manifest.replaced(sets=manifest.sets[:1], missing=("two",))
    assert publish(partial, finished_suite, Store(url)) == 1
    assert not Store(url).has("small.suite.json")


def test_hostile_and_damaged_sets_are_refused_and_leave_nothing(
    stored: Store, default_layout: Layout, tmp_path: Path
) -> None:
    plan = plan_of(tmp_path / "other", default_layout, stored)
    first = plan.sets[0]
    name = f"sets/{first.folder.name}/{MANIFEST}"
    whole = stored.read(name)
    stated = json.loads(whole)

    def listing(file: str) -> bytes:
        return json.dumps(stated | {"files": stated["files"] | {file: "0" * 64}}).encode()

    def another(**fields: object) -> bytes:
        return Dataset.model_validate_json(whole).replaced(**fields).model_dump_json(by_alias=True).encode()

    faults = {
        b"{": "not valid JSON",
        b"[]": "Input should be an object",
        listing("../../out"): "expected only the files of a set",
        listing("/etc/out"): "expected only the files of a set",
        listing("frames/../../../out"): "expected only the files of a set",
        another(frames=7): "differs in frames",
        another(width_px=241): "differs in width_px",
        json.dumps(stated | {"files": {}}).encode(): "lacks frames/0000.jpg",
        json.dumps(
            stated | {"files": stated["files"] | {"frames/0000.jpg": "0" * 64}}
        ).encode(): "does not match its checksum",
    }
    for content, message in faults.items():
        change(stored, name, content)
        with pytest.raises(InputError, match=message) as refused:
            fetch_stored(plan, stored)
        assert "\n" not in str(refused.value)
        assert not first.folder.exists()
    assert not list(tmp_path.rglob("out"))


def test_a_file_that_is_lost_or_large_is_named(
    stored: Store, default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = plan_of(tmp_path / "other", default_layout, stored).sets[0]
    with monkeypatch.context() as patch:
        patch.setattr("mirrorcam.bench.suite_store.MAX_STORED_BYTES", 10)
        with pytest.raises(InputError, match="bytes, expected 10 or fewer"):
            fetch_set(stored, first.recipe, first.folder)
    files, root = fsspec.core.url_to_fs(stored.url)
    files.rm(f"{root}/sets/{first.folder.name}/frames/0001.jpg")
    with pytest.raises(InputError, match=r"frames/0001\.jpg: does not exist$"):
        fetch_set(stored, first.recipe, first.folder)
    assert not first.folder.exists()


@pytest.mark.parametrize("url", ["nosuch://bucket", "memory", ""])
def test_places_that_fsspec_does_not_know(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if url.startswith("nosuch"):
        with pytest.raises(InputError, match=r"^nosuch://bucket: ValueError: Protocol not known: nosuch"):
            Store(url)
    else:
        assert not Store(url).has("small.suite.json")  # a folder of this machine
    assert not list(tmp_path.iterdir())


def test_a_password_is_not_shown() -> None:
    with pytest.raises(InputError, match=r"^nosuch://host/place: ") as refused:
        Store("nosuch://me:secret@host/place")
    assert "secret" not in str(refused.value)


def test_sets_that_are_here_are_not_looked_for_there(
    finished_suite: Path, default_layout: Layout, tmp_path: Path
) -> None:
    shutil.copytree(finished_suite, tmp_path / "suites")
    store = Store("memory://nothing")
    plan = plan_of(tmp_path / "suites", default_layout, store)
    assert fetch_stored(plan, store) == replace(plan)
    assert [each.state for each in plan.sets] == ["finished", "finished"]
