"""A stage is done once, and again when anything it depends on has changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from mirrorcam.optics.base.progress import Progress
from mirrorcam.optics.base.values import InputError
from mirrorcam.workflow import stages
from mirrorcam.workflow.stages import MANIFEST, Stage, perform, staleness


def copying(root: Path, name: str = "copy", read: str = "source.txt", **parameters: object) -> Stage:
    """A stage that writes what it reads, and its parameters, into two files, one of them in a folder."""

    def work(folder: Path, progress: Progress) -> None:
        (folder / "text.txt").write_text((root / read).read_text())
        (folder / "deep").mkdir()
        (folder / "deep" / "parameters.txt").write_text(repr(parameters))

    return Stage(
        name=name, work=work, parameters=parameters, reads=(root / read,), sources=("mirrorcam.workflow.stages",)
    )


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "source.txt").write_text("first")
    return tmp_path


def test_a_finished_stage_is_current(root: Path) -> None:
    stage = copying(root, size=3)
    assert staleness(stage, root)
    perform(stage, root)
    assert (root / "copy" / "text.txt").read_text() == "first"
    assert not staleness(stage, root)
    assert sorted(path.name for path in root.iterdir()) == ["copy", "source.txt"]


def delete_output(root: Path) -> None:
    (root / "copy" / "deep" / "parameters.txt").unlink()


def alter_output(root: Path) -> None:
    (root / "copy" / "text.txt").write_text("forged")


def add_output(root: Path) -> None:
    (root / "copy" / "0001.png").write_text("from an earlier run")


def delete_folder(root: Path) -> None:
    (root / "copy").rename(root / "elsewhere")


def alter_input(root: Path) -> None:
    (root / "source.txt").write_text("second")


def delete_manifest_content(root: Path) -> None:
    (root / "copy" / MANIFEST).write_text("{")


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (delete_output, "deep/parameters.txt is missing"),
        (alter_output, "text.txt is not what was written"),
        (add_output, "0001.png is not what was written"),
        (delete_folder, "not made yet"),
        (alter_input, "source.txt changed"),
        (delete_manifest_content, "not made yet"),
    ],
)
def test_whatever_changes_on_disk_makes_it_stale_until_it_is_done_again(
    root: Path, harm: Callable[[Path], None], reason: str
) -> None:
    stage = copying(root)
    perform(stage, root)
    harm(root)
    assert staleness(stage, root) == reason
    perform(stage, root)
    assert not staleness(stage, root)
    assert (root / "copy" / "text.txt").read_text() == (root / "source.txt").read_text()
    assert not (root / "copy" / "0001.png").exists()


def test_a_changed_parameter_makes_it_stale(root: Path) -> None:
    perform(copying(root, size=3), root)
    assert staleness(copying(root, size=4), root) == "other parameters"
    assert not staleness(copying(root, size=3), root)


def test_changed_sources_make_it_stale(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = copying(root)
    perform(stage, root)
    monkeypatch.setattr(stages, "source_digest", lambda module: "0" * 64)
    assert staleness(stage, root) == "mirrorcam.workflow.stages changed"


def test_a_changed_program_makes_it_stale(root: Path) -> None:
    stage = copying(root)
    perform(stage, root)
    assert staleness(replace(stage, programs={"slicer": "2.9"}), root) == "slicer not installed → 2.9"


def test_a_stage_that_reads_another_follows_it(root: Path) -> None:
    first, second = copying(root), copying(root, name="again", read="copy/text.txt")
    perform(first, root)
    perform(second, root)
    alter_input(root)
    perform(first, root)
    assert staleness(second, root)


def test_a_stage_done_again_with_the_same_result_leaves_its_followers_alone(root: Path) -> None:
    first, second = copying(root), copying(root, name="again", read="copy/text.txt")
    perform(first, root)
    perform(second, root)
    alter_output(root)
    perform(first, root)
    assert not staleness(second, root)


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_interrupted_work_leaves_nothing_behind(root: Path, error: type[BaseException]) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "half.txt").write_text("half")
        raise error

    with pytest.raises(error):
        perform(Stage("copy", work), root)
    assert [path.name for path in root.iterdir()] == ["source.txt"]


def test_interrupted_work_leaves_the_earlier_result(root: Path) -> None:
    stage = copying(root)
    perform(stage, root)

    def work(folder: Path, progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        perform(Stage("copy", work), root)
    assert not staleness(stage, root)


def growing(frames: int) -> Stage:
    """A stage that is interrupted at each new frame until it has them all."""

    def work(folder: Path, progress: Progress) -> None:
        found = len(list(folder.glob("*.png")))
        (folder / f"{found:04d}.png").touch()
        if found + 1 < frames:
            raise KeyboardInterrupt

    return Stage("set", work, parameters={"frames": frames}, resumes=True)


def test_work_that_resumes_finds_what_was_left(root: Path) -> None:
    stage = growing(3)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            perform(stage, root)
        assert not (root / "set").exists()
        assert staleness(stage, root)
    perform(stage, root)
    assert not staleness(stage, root)
    assert sorted(path.name for path in (root / "set").glob("*.png")) == ["0000.png", "0001.png", "0002.png"]
    assert sorted(path.name for path in root.iterdir()) == ["set", "source.txt"]


def test_work_that_resumes_does_not_find_what_was_left_of_another_request(root: Path) -> None:
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            perform(growing(5), root)
    with pytest.raises(KeyboardInterrupt):
        perform(growing(2), root)
    perform(growing(2), root)
    assert sorted(path.name for path in (root / "set").glob("*.png")) == ["0000.png", "0001.png"]


def test_leftovers_of_a_killed_run_are_cleared(root: Path) -> None:
    leftover = root / ".copy-unfinished"
    leftover.mkdir()
    (leftover / "half.txt").write_text("half")
    stage = copying(root)
    perform(stage, root)
    assert not leftover.exists()
    assert not (root / "copy" / "half.txt").exists()


def test_a_folder_of_somebody_else_is_not_replaced(root: Path) -> None:
    (root / "copy").mkdir()
    (root / "copy" / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"copy: exists and holds no \.stage\.json"):
        perform(copying(root), root)
    assert (root / "copy" / "thesis.txt").read_text() == "years of work"
