"""A stage is done once, and again when anything it depends on has changed."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from mirrorcam.core.disk import stages
from mirrorcam.core.disk.output_folder import HIDDEN, output_folder
from mirrorcam.core.disk.stages import MANIFEST, Stage, perform, staleness
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes import interruption
from mirrorcam.core.progress import Progress


def done(stage: Stage, root: Path, *, force: bool = False) -> None:
    """Do a stage of a run into a folder."""
    with output_folder(root, "run", force=force) as output:
        perform(stage, output)


def names(root: Path) -> list[str]:
    """Names of everything in a folder but the record of what was written."""
    return sorted(path.name for path in root.iterdir() if path.name != HIDDEN)


def copying(root: Path, name: str = "copy", read: str = "source.txt", **parameters: object) -> Stage:
    """A stage that writes what it reads, and its parameters, into two files, one of them in a folder."""

    def work(folder: Path, progress: Progress) -> None:
        (folder / "text.txt").write_text((root / read).read_text())
        (folder / "deep").mkdir()
        (folder / "deep" / "parameters.txt").write_text(repr(parameters))

    return Stage(
        name=name, work=work, parameters=parameters, reads=(root / read,), sources=("mirrorcam.core.disk.stages",)
    )


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "source.txt").write_text("first")
    return tmp_path


def test_a_finished_stage_is_current(root: Path) -> None:
    stage = copying(root, size=3)
    assert staleness(stage, root)
    done(stage, root)
    assert (root / "copy" / "text.txt").read_text() == "first"
    assert not staleness(stage, root)
    assert names(root) == ["copy", "source.txt"]


def delete_output(root: Path) -> None:
    (root / "copy" / "deep" / "parameters.txt").unlink()


def alter_output(root: Path) -> None:
    (root / "copy" / "text.txt").write_text("forged")


def delete_folder(root: Path) -> None:
    (root / "copy").rename(root / "elsewhere")


def alter_input(root: Path) -> None:
    (root / "source.txt").write_text("second")


def delete_manifest(root: Path) -> None:
    (root / "copy" / MANIFEST).unlink()


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (delete_output, "deep/parameters.txt is missing"),
        (delete_folder, "not made yet"),
        (alter_input, "source.txt changed"),
        (delete_manifest, "not made yet"),
    ],
)
def test_whatever_changes_on_disk_makes_it_stale_until_it_is_done_again(
    root: Path, harm: Callable[[Path], None], reason: str
) -> None:
    stage = copying(root)
    done(stage, root)
    harm(root)
    assert staleness(stage, root) == reason
    done(stage, root)
    assert not staleness(stage, root)
    assert (root / "copy" / "text.txt").read_text() == (root / "source.txt").read_text()


def test_what_somebody_changed_is_replaced_by_force_alone(root: Path) -> None:
    stage = copying(root)
    done(stage, root)
    alter_output(root)
    assert staleness(stage, root) == "text.txt is not what was written"
    with pytest.raises(InputError, match=r"text\.txt: was changed since this command wrote it, expected .* --force"):
        done(stage, root)
    assert (root / "copy" / "text.txt").read_text() == "forged"
    (root / "copy" / MANIFEST).write_text("{")
    with pytest.raises(InputError, match=r"stage\.json: was changed since this command wrote it"):
        done(stage, root)
    done(stage, root, force=True)
    assert not staleness(stage, root)
    assert (root / "copy" / "text.txt").read_text() == "first"


def test_what_somebody_added_stays_and_makes_nothing_stale(root: Path) -> None:
    stage = copying(root)
    done(stage, root)
    (root / "copy" / "notes.txt").write_text("mine")
    assert not staleness(stage, root)
    alter_input(root)
    done(stage, root)
    assert (root / "copy" / "notes.txt").read_text() == "mine"


def test_what_an_earlier_request_wrote_is_deleted(root: Path) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "other.txt").write_text("other")

    done(copying(root), root)
    done(Stage("copy", work), root)
    assert names(root / "copy") == [MANIFEST, "other.txt"]


def test_a_changed_parameter_makes_it_stale(root: Path) -> None:
    done(copying(root, size=3), root)
    assert staleness(copying(root, size=4), root) == "other parameters"
    assert not staleness(copying(root, size=3), root)


def test_changed_sources_make_it_stale(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = copying(root)
    done(stage, root)
    monkeypatch.setattr(stages, "source_digest", lambda module: "0" * 64)
    assert staleness(stage, root) == "mirrorcam.core.disk.stages changed"


def test_a_changed_program_makes_it_stale(root: Path) -> None:
    stage = copying(root)
    done(stage, root)
    assert staleness(replace(stage, programs={"slicer": "2.9"}), root) == "slicer not installed → 2.9"


def test_a_stage_that_reads_another_follows_it(root: Path) -> None:
    first, second = copying(root), copying(root, name="again", read="copy/text.txt")
    done(first, root)
    done(second, root)
    alter_input(root)
    done(first, root)
    assert staleness(second, root)


def test_a_stage_done_again_with_the_same_result_leaves_its_followers_alone(root: Path) -> None:
    first, second = copying(root), copying(root, name="again", read="copy/text.txt")
    done(first, root)
    done(second, root)
    delete_output(root)
    done(first, root)
    assert not staleness(second, root)


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_interrupted_work_leaves_nothing_behind(root: Path, error: type[BaseException]) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "half.txt").write_text("half")
        raise error

    with pytest.raises(error):
        done(Stage("copy", work), root)
    assert names(root) == ["source.txt"]


def test_interrupted_work_leaves_the_earlier_result(root: Path) -> None:
    stage = copying(root)
    done(stage, root)

    def work(folder: Path, progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        done(Stage("copy", work), root)
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
            done(stage, root)
        assert not (root / "set").exists()
        assert staleness(stage, root)
    done(stage, root)
    assert not staleness(stage, root)
    assert sorted(path.name for path in (root / "set").glob("*.png")) == ["0000.png", "0001.png", "0002.png"]
    assert names(root) == ["set", "source.txt"]


def test_work_that_resumes_finds_what_was_left_where_a_library_told_the_interruption_as_an_error(root: Path) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "0000.png").touch()
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise RuntimeError("a loop ended early") from error

    with interruption.remembered(), pytest.raises(RuntimeError):
        done(Stage("set", work, parameters={"frames": 2}, resumes=True), root)
    done(growing(2), root)
    assert sorted(path.name for path in (root / "set").glob("*.png")) == ["0000.png", "0001.png"]


def test_work_that_resumes_does_not_find_what_was_left_of_another_request(root: Path) -> None:
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            done(growing(5), root)
    with pytest.raises(KeyboardInterrupt):
        done(growing(2), root)
    done(growing(2), root)
    assert sorted(path.name for path in (root / "set").glob("*.png")) == ["0000.png", "0001.png"]


def test_leftovers_of_a_killed_run_are_cleared(root: Path) -> None:
    leftover = root / HIDDEN / "unfinished" / "copy"
    leftover.mkdir(parents=True)
    (leftover / "half.txt").write_text("half")
    done(copying(root), root)
    assert not leftover.exists()
    assert not (root / "copy" / "half.txt").exists()


def test_a_folder_of_somebody_else_is_not_replaced(root: Path) -> None:
    (root / "copy").mkdir()
    (root / "copy" / "thesis.txt").write_text("years of work")
    with pytest.raises(
        InputError, match="copy: holds files that this command did not write, expected a new folder, or --force"
    ):
        done(copying(root), root)
    assert (root / "copy" / "thesis.txt").read_text() == "years of work"
