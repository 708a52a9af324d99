"""`mirrorcam suite`: what it says beforehand, what it refuses, and a whole run of the smoke suite."""

from __future__ import annotations

import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.bench.suite_command import plan_text, read_copies, show_suites, size_text, time_text
from mirrorcam.bench.suite_folder import read_finished
from mirrorcam.bench.suite_run import make_plan, render_suite, workers_here
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.suite import SUITES, read_suite
from mirrorcam.render_scenes.variant import choose_variant
from mirrorcam.simulation.rendering import check_set
from tests.command_line import assert_refused_here
from tests.small_set import BOARD, contents

needs_renderer = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_without_a_name_it_lists_the_suites(capfd: pytest.CaptureFixture[str]) -> None:
    assert show_suites() == 0
    said = capfd.readouterr().out
    for path in SUITES.glob("*.toml"):
        suite = read_suite(path.stem)
        assert re.search(rf"^{suite.name} +{suite.version} +{len(suite.sets)} ", said, flags=re.MULTILINE)


@needs_renderer
def test_a_plan_renders_nothing(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["suite", "smoke", "--plan", "--workers", "2"]) == 0
    said = capfd.readouterr().out
    for recipe in read_suite("smoke").sets:
        assert re.search(rf"^{recipe.name} .* {recipe.pictures} .* missing", said, flags=re.MULTILINE)
    assert re.search(r"smoke 1: 4 sets; to render: 52 pictures, about \d+ MB and \d+ s\b", said)
    assert not list(folder.iterdir())


@pytest.mark.slow
@needs_renderer
def test_copies_are_planned_as_sets_of_their_own(folder: Path) -> None:
    many = make_plan(read_copies("standard", 300), folder, "llvm_ad_mono")
    assert len(many.sets) == 300 * len(read_suite("standard").sets) > 10_000
    assert len({each.folder for each in many.sets}) == len(many.sets)
    assert many.specs == make_plan(read_suite("standard"), folder, "llvm_ad_mono").specs
    assert re.search(r"about \d+\.\d GB and \d+\.\d h of a core like this machine's$", plan_text(many, None))
    with pytest.raises(InputError, match=r"^--copies 100000: 3400000 sets, expected 100000 or fewer$"):
        read_copies("standard", 100_000)


def test_sizes_and_times_for_people() -> None:
    assert [size_text(size) for size in (3e6, 1.25e9, 2e12)] == ["3 MB", "1.2 GB", "2.0 TB"]
    assert [time_text(seconds) for seconds in (40, 89, 600, 7200)] == ["40 s", "89 s", "10 min", "2.0 h"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("suite smoke --workers 2 --scheduler tcp://a:1", "--workers and --scheduler: expected one of the two"),
        ("suite --plan", "--plan: expected the name of a suite"),
        ("suite smok", "suite 'smok': expected one of smoke, standard, or a .toml file"),
        ("suite none.toml", "none.toml: no such file"),
        ("suite smoke --copies 0", "--copies"),
        ("suite smoke --fetch nosuch://bucket", "nosuch://bucket: ValueError: Protocol not known: nosuch"),
        ("suite smoke --publish nosuch://bucket", "nosuch://bucket"),
        ("suite bad.toml", "bad.toml: set.0.frams: not known, did you mean frames?"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    arguments: str, message: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bad = folder / "bad.toml"
    bad.write_text('name = "bad"\nversion = 1\n[[set]]\nname = "a"\nframs = 3\n')
    assert_refused_here(arguments.split(), capfd, message)
    assert list(folder.iterdir()) == [bad]


@needs_renderer
@pytest.mark.slow
def test_a_suite_is_rendered_published_and_fetched_elsewhere(
    folder: Path, default_layout: Layout, capfd: pytest.CaptureFixture[str]
) -> None:
    default_layout.save(folder / "layout.json")
    board = ", ".join(f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in BOARD.model_dump().items())
    tiny = board.replace("30.0", "1.0").replace("22.5", "0.7")
    head = 'name = "mine"\nversion = 2\n[defaults]\nlayout = "layout.json"\nbinned = 0.125\nframes = 3\n'
    good = f'{head}base_frames = 1\n[[set]]\nname = "a"\nboard = {{ {board} }}\n'
    (folder / "good.toml").write_text(good)
    (folder / "bad.toml").write_text(f'{good}[[set]]\nname = "b"\nboard = {{ {tiny} }}\n')
    assert cli.main(["suite", "bad.toml", "--workers", "1", "--out", "here", "--publish", "store"]) == 1
    said = capfd.readouterr().out
    assert "b is missing: board of 8 x 6 squares of 1 mm: too small to be resolved" in said
    assert "1 set copied, 0 already there" in said
    assert not (folder / "store" / "mine.suite.json").exists()
    assert cli.main(["suite", "good.toml", "--workers", "1", "--out", "here", "--publish", "store"]) == 0
    assert "0 sets copied, 1 already there" in capfd.readouterr().out
    shutil.rmtree(folder / "here" / "sets")
    assert cli.main(["suite", "good.toml", "--workers", "1", "--out", "there", "--fetch", "store"]) == 0
    assert "mine 2: 1 set, 1 stored\n" in capfd.readouterr().out
    assert contents(folder / "there" / "sets") == contents(folder / "store" / "sets")
    assert read_finished(folder / "there").manifest == read_finished(folder / "store").manifest


@needs_renderer
@pytest.mark.slow
def test_smoke_stores_what_was_predicted(folder: Path) -> None:
    with output_folder(folder / "suites", "suite") as output:
        plan = make_plan(read_suite("smoke"), output.path, choose_variant())
        from mirrorcam.bench.suite_run import layouts_of

        workers = workers_here(cores())
        done = render_suite(plan, output, workers, layouts_of(plan, output.path, workers.design))
    assert done.failures == {}
    assert all(check_set(each).passed for each in read_finished(folder / "suites").folders)
    stored = sum(path.stat().st_size for path in (output.path / "sets").rglob("*") if path.is_file())
    promised = sum(each.cost.stored_bytes for each in plan.sets)
    assert promised / 1.5 < stored < 1.5 * promised
