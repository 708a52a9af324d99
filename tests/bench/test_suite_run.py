"""Rendering of suites: what is there is not rendered again, a bad set loses no other, and workers may share no disk."""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

import pytest

from mirrorcam.bench.suite_folder import state_of
from mirrorcam.bench.suite_run import layouts_of, make_plan, workers_here, workers_of
from mirrorcam.core.disk.output_folder import HIDDEN
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.set_work import SetResult, render_in_turn
from mirrorcam.render_scenes.suites.suite import Suite
from mirrorcam.render_scenes.variant import choose_variant
from tests.small_set import BOARD, contents
from tests.small_suite import here, rendered_into, small_suite, workers

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@pytest.fixture
def suite_folder(finished_suite: Path, tmp_path: Path) -> Path:
    """A copy of the finished suite."""
    shutil.copytree(finished_suite, tmp_path / "suites")
    return tmp_path / "suites"


def of_suite(folder: Path) -> dict[str, bytes]:
    """Sets and manifests of a folder, without the program's own records."""
    return {name: content for name, content in contents(folder).items() if HIDDEN not in name.split("/")}


def folders(suite: Suite, folder: Path) -> dict[str, Path]:
    return {each.recipe.name: each.folder for each in make_plan(suite, folder, choose_variant()).sets}


def nothing(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult]]:
    assert not tasks
    yield from ()


def test_a_second_run_renders_nothing_and_writes_the_same(suite_folder: Path, default_layout: Layout) -> None:
    before = of_suite(suite_folder)
    rendered_into(suite_folder, small_suite(default_layout), replace(workers(), render=nothing))
    assert of_suite(suite_folder) == before


def test_a_set_that_two_suites_share_is_rendered_once(suite_folder: Path, default_layout: Layout) -> None:
    mine = small_suite(default_layout, "mine")
    rendered_into(suite_folder, mine, replace(workers(), render=nothing))
    theirs, ours = ((suite_folder / f"{name}.suite.json").read_text() for name in ("small", "mine"))
    assert ours == theirs.replace('"small"', '"mine"')


def test_folders_follow_from_what_is_asked_for_and_not_from_the_order(default_layout: Layout, tmp_path: Path) -> None:
    suite = small_suite(default_layout)
    asked = folders(suite, tmp_path)
    assert folders(suite.replaced(recipes=suite.recipes[::-1]), tmp_path) == asked
    assert folders(small_suite(default_layout, "other"), tmp_path) == asked
    other = folders(small_suite(default_layout, frames=4), tmp_path)
    assert not set(other.values()) & set(asked.values())
    on_gpu = make_plan(suite, tmp_path, "cuda_ad_mono").sets
    assert not {each.folder for each in on_gpu} & set(asked.values())


def test_an_interrupted_suite_goes_on_and_gives_the_same(
    suite_folder: Path, default_layout: Layout, tmp_path: Path
) -> None:
    suite, begun = small_suite(default_layout), tmp_path / "begun"

    def interrupted(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult]]:
        yield from islice(here(tasks), 1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendered_into(begun, suite, replace(workers(), render=interrupted))
    (folders(suite, begun)["one"] / "frames" / "0002.jpg").unlink()
    states = [each.state for each in make_plan(suite, begun, choose_variant()).sets]
    assert states == ["begun", "missing"]
    rendered_into(begun, suite)
    assert of_suite(begun) == of_suite(suite_folder)


@pytest.mark.slow
def test_workers_that_share_no_disk_send_the_same_files(
    suite_folder: Path, default_layout: Layout, tmp_path: Path
) -> None:
    rendered_into(tmp_path / "sent", small_suite(default_layout), workers(share_the_folder=False))
    assert of_suite(tmp_path / "sent") == of_suite(suite_folder)


@pytest.mark.slow
def test_a_bad_set_and_a_dead_worker_lose_no_other(default_layout: Layout, tmp_path: Path) -> None:
    suite = small_suite(default_layout)
    tiny = BOARD.replaced(square_mm=1.0, marker_mm=0.7)
    bad = [suite.recipes[0].replaced(name=name, board=tiny) for name in ("tiny", "deadly")]
    suite = suite.replaced(recipes=(bad[0], *suite.recipes, bad[1]))

    def one_dies(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult | Died]]:
        for number, task in enumerate(tasks):
            yield (
                (number, Died("3 workers died of it"))
                if '"deadly"' in task
                else next((number, got) for _, got in here([task]))
            )

    done = rendered_into(tmp_path, suite, replace(workers(), render=one_dies))
    assert [each.name for each in done.manifest.sets] == ["one", "two"]
    assert done.manifest.missing == ("tiny", "deadly")
    assert "too small to be resolved" in done.failures["tiny"]
    assert done.failures["deadly"] == "3 workers died of it"
    assert set(done.seconds) == {"one", "two"}


def test_an_altered_set_is_refused_before_anything_is_rendered(suite_folder: Path, default_layout: Layout) -> None:
    suite = small_suite(default_layout)
    (folders(suite, suite_folder)["two"] / "frames" / "0000.jpg").write_bytes(b"mine")
    with pytest.raises(InputError, match="was changed since it was written"):
        make_plan(suite, suite_folder, choose_variant())


def test_a_manifest_of_others_is_not_replaced(suite_folder: Path, default_layout: Layout) -> None:
    manifest = suite_folder / "small.suite.json"
    manifest.write_text("mine")
    with pytest.raises(InputError, match="was changed since this command wrote it"):
        rendered_into(suite_folder, small_suite(default_layout))
    assert manifest.read_text() == "mine"


@pytest.mark.slow
def test_designs_without_a_solution_are_refused_by_the_name_of_their_set(tmp_path: Path) -> None:
    suite = Suite.model_validate(
        {"name": "s", "version": 1, "set": [{"name": "narrow", "design": {"rows": 1, "cols": 2, "spacing_mm": 500.0}}]}
    )
    plan = make_plan(suite, tmp_path, choose_variant())
    with pytest.raises(InputError, match="set narrow: design infeasible: "):
        layouts_of(plan, tmp_path, workers_here(1).design)


def test_a_set_too_large_for_a_message_is_refused(default_layout: Layout, tmp_path: Path) -> None:
    suite = small_suite(default_layout, binned=1.0, maps=True, frames=100)
    with pytest.raises(InputError, match=r"set one: takes about 1\.. GB, expected at most 1 GB"):
        rendered_into(tmp_path, suite, workers(share_the_folder=False))


@pytest.mark.slow
def test_an_answer_of_another_version_is_no_set(default_layout: Layout, tmp_path: Path) -> None:
    def older(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult]]:
        for number, got in here(tasks):
            yield number, replace(got, made_with=dict(got.made_with) | {"numpy": "1.0"})

    done = rendered_into(tmp_path, small_suite(default_layout), replace(workers(share_the_folder=False), render=older))
    assert done.failures["one"] == "numpy of a worker differs from this machine's, expected the same everywhere"
    assert not (tmp_path / "sets").exists()


@pytest.mark.slow
def test_a_killed_worker_of_a_cluster_costs_no_set(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], suite_folder: Path, default_layout: Layout, tmp_path: Path
) -> None:
    address, (_, first, _) = cluster

    def with_a_kill(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult | Died]]:
        first.send_signal(signal.SIGKILL)
        yield from run_cluster(tasks, address, render_in_turn)

    rendered_into(tmp_path / "sent", small_suite(default_layout), replace(workers_of(address), render=with_a_kill))
    assert of_suite(tmp_path / "sent") == of_suite(suite_folder)


@pytest.mark.slow
def test_processes_of_this_machine_give_the_same(suite_folder: Path, default_layout: Layout, tmp_path: Path) -> None:
    rendered_into(tmp_path / "both", small_suite(default_layout), workers_here(2))
    assert of_suite(tmp_path / "both") == of_suite(suite_folder)
    states = map(state_of, (tmp_path / "both" / "sets").iterdir())
    assert list(states) == ["finished"] * 2
