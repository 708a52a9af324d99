"""A stage is done once, and again when anything it depends on has changed."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from mirrorcam.core.disk import stages
from mirrorcam.core.disk.output_folder import HIDDEN, output_folder
from mirrorcam.core.disk.stages import Stage, perform, staleness
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

    return Stage(name, work, "mirrorcam.core.values", parameters=parameters, reads=(root / read,))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "source.txt").write_text("first")
    return tmp_path


def nothing(root: Path) -> None:
    """Change nothing."""


def delete_output(root: Path) -> None:
    (root / "copy" / "deep" / "parameters.txt").unlink()


def alter_output(root: Path) -> None:
    (root / "copy" / "text.txt").write_text("forged")


def delete_folder(root: Path) -> None:
    (root / "copy").rename(root / "elsewhere")


def alter_input(root: Path) -> None:
    (root / "source.txt").write_text("second")


def forget(root: Path) -> None:
    (root / HIDDEN / "results" / "stage-copy").unlink()


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (nothing, ""),
        (delete_output, "deep/parameters.txt is missing"),
        (delete_folder, "deep/parameters.txt is missing"),
        (alter_input, "source.txt changed"),
        (forget, "not made yet"),
    ],
)
def test_a_stage_is_current_until_its_folder_or_its_input_changes(
    root: Path, harm: Callable[[Path], None], reason: str
) -> None:
    stage = copying(root)
    assert staleness(stage, root) == "not made yet"
    done(stage, root)
    harm(root)
    assert staleness(stage, root) == reason
    done(stage, root)
    assert not staleness(stage, root)
    assert (root / "copy" / "text.txt").read_text() == (root / "source.txt").read_text()


def test_other_parameters_code_and_programs_make_it_stale(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = copying(root, size=3)
    done(stage, root)
    assert staleness(copying(root, size=4), root) == "parameters changed"
    assert staleness(replace(stage, programs={"slicer": "2.9"}), root) == "slicer not installed → 2.9"
    monkeypatch.setattr(stages, "program_of", lambda module: {"code": "0" * 64})
    assert staleness(stage, root) == "code changed"


def test_what_somebody_changed_or_added_stays(root: Path) -> None:
    stage = copying(root)
    done(stage, root)
    (root / "copy" / "notes.txt").write_text("mine")
    assert not staleness(stage, root)
    alter_output(root)
    assert staleness(stage, root) == "text.txt is not what was written"
    with pytest.raises(InputError, match=r"text\.txt: was changed since this command wrote it, expected .* --force"):
        done(stage, root)
    assert (root / "copy" / "text.txt").read_text() == "forged"
    done(stage, root, force=True)
    assert not staleness(stage, root)
    assert (root / "copy" / "notes.txt").read_text() == "mine"
    (root / "other").mkdir()
    (root / "other" / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="other: holds files that this command did not write, expected a new folder"):
        done(copying(root, name="other"), root)


def test_what_an_earlier_request_wrote_is_deleted(root: Path) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "other.txt").write_text("other")

    done(copying(root), root)
    done(Stage("copy", work), root)
    assert names(root / "copy") == ["other.txt"]


def test_a_stage_that_reads_another_is_stale_when_its_result_changes(root: Path) -> None:
    first, second = copying(root), copying(root, name="again", read="copy/text.txt")
    done(first, root)
    done(second, root)
    delete_output(root)
    done(first, root)
    assert not staleness(second, root)
    alter_input(root)
    done(first, root)
    assert staleness(second, root) == "copy/text.txt changed"


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_interrupted_work_leaves_the_earlier_result_or_nothing(root: Path, error: type[BaseException]) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "half.txt").write_text("half")
        raise error

    with pytest.raises(error):
        done(Stage("copy", work), root)
    assert names(root) == ["source.txt"]
    done(copying(root), root)
    with pytest.raises(error):
        done(Stage("copy", work), root)
    assert not staleness(copying(root), root)


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
    assert names(root / "set") == ["0000.png", "0001.png", "0002.png"]
    assert sorted(path.name for path in (root / HIDDEN).iterdir()) == ["results", "written.jsonl"]


def test_work_that_resumes_finds_what_was_left_where_a_library_turned_the_interruption_into_an_error(
    root: Path,
) -> None:
    def work(folder: Path, progress: Progress) -> None:
        (folder / "0000.png").touch()
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise RuntimeError("a loop ended early") from error

    with interruption.remembered(), pytest.raises(RuntimeError):
        done(Stage("set", work, parameters={"frames": 2}, resumes=True), root)
    done(growing(2), root)
    assert names(root / "set") == ["0000.png", "0001.png"]


def test_work_that_resumes_does_not_find_what_was_left_of_another_request(root: Path) -> None:
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            done(growing(5), root)
    with pytest.raises(KeyboardInterrupt):
        done(growing(2), root)
    done(growing(2), root)
    assert names(root / "set") == ["0000.png", "0001.png"]


def test_leftovers_of_a_killed_run_are_cleared_and_links_are_not_followed(root: Path) -> None:
    leftover = root / HIDDEN / "unfinished" / "copy"
    leftover.mkdir(parents=True)
    (leftover / "half.txt").write_text("half")
    (root / "theirs").mkdir()
    (root / "theirs" / "thesis.txt").write_text("mine")
    (leftover.parent / "set").symlink_to(root / "theirs")
    done(copying(root), root)
    done(growing(1), root)
    assert not leftover.exists()
    assert not (root / "copy" / "half.txt").exists()
    assert names(root / "theirs") == ["thesis.txt"]
