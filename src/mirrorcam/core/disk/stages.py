"""Stages: steps of work that are repeated only when their inputs have changed.

A stage owns one subfolder of the run's folder. It works in a hidden folder, whose files are moved into the subfolder
when the work succeeds. The store of results then keeps their checksums and inputs: parameters, contents of the files
read, the code of the stage, and versions of libraries. Interrupted work leaves nothing that could be mistaken for a
result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mirrorcam.core.disk.files import is_inside
from mirrorcam.core.disk.fingerprint import file_digests, intact, value_digest
from mirrorcam.core.disk.output_folder import OutputFolder, results_folder
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.disk.results import Results
from mirrorcam.core.processes import interruption
from mirrorcam.core.progress import Progress, no_progress


@dataclass(frozen=True)
class Stage:
    """One step of the pipeline; `work` writes its files into an empty folder, and reports its progress.

    Parameters
    ----------
    name
        Name of the stage and of its folder.
    work
        Function that does the work.
    code
        Module that does the work: the code that it imports, and the versions of libraries, may change the result.
    doing, unit
        Description of the work in progress, and the unit of its progress.
    parameters
        JSON values that determine the result.
    reads
        Files or folders that it reads.
    programs
        Versions of other programs that it runs.
    resumes
        Whether the work resumes an interrupted run from its unfinished files.
    """

    name: str
    work: Callable[[Path, Progress], None]
    code: str = ""
    doing: str = ""
    unit: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    reads: tuple[Path, ...] = ()
    programs: Mapping[str, str] = field(default_factory=dict)
    resumes: bool = False


def made_of(stage: Stage, root: Path) -> dict[str, str]:
    """Return the current inputs of a stage."""
    reads: dict[str, str] = {}
    for path in stage.reads:
        name = path.relative_to(root).as_posix() if path.is_relative_to(root) else str(path)
        digests = file_digests(path)
        reads |= {name if path.is_file() else f"{name}/{inner}": value for inner, value in digests.items()}
    program = program_of(stage.code) if stage.code else {}
    return {"parameters": value_digest(stage.parameters)} | reads | program | dict(stage.programs)


def staleness(stage: Stage, root: Path) -> str:
    """Return why a stage must be done (again), in a few words; empty if its folder contains a valid result."""
    results, now = Results(results_folder(root)), made_of(stage, root)
    contents = results.get(_result_name(stage), now)
    if contents is None:
        return results.difference(_result_name(stage), now)
    folder, files = root / stage.name, {name: sha256.decode(errors="replace") for name, sha256 in contents.items()}
    altered = sorted(files.keys() - intact(folder, files).keys())
    if not altered:
        return ""
    return f"{altered[0]} {'is not what was written' if (folder / altered[0]).is_file() else 'is missing'}"


def refuse_foreign(stages: Iterable[Stage], output: OutputFolder) -> None:
    """Raise InputError if the folder of a stage contains files that no stage wrote, or that were changed since."""
    for stage in stages:
        subfolder = output.subfolder(stage.name)
        subfolder.refuse_unknown()
        subfolder.refuse_changed()


def perform(stage: Stage, output: OutputFolder, progress: Progress = no_progress) -> None:
    """Do the work of a stage, and replace an earlier result in its subfolder.

    Raises InputError, before any work, if the subfolder contains files that no stage wrote, or that were changed since.
    """
    inputs = made_of(stage, output.root)
    refuse_foreign([stage], output)
    target, keep = output.subfolder(stage.name), False
    # Resume an interrupted run with the same inputs; remove other unfinished files.
    folder = target.unfinished / value_digest(inputs)
    if not (stage.resumes and folder.is_dir() and is_inside(output.root, folder.relative_to(output.root).as_posix())):
        target.discard()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        stage.work(folder, progress)
        files = {name: sha256.encode() for name, sha256 in file_digests(folder).items()}
        target.adopt(folder)
        output.results.put(_result_name(stage), inputs, files)
    except BaseException as error:
        keep = stage.resumes and interruption.caused(error)
        raise
    finally:
        if not keep:
            target.discard()


def _result_name(stage: Stage) -> str:
    return f"stage-{stage.name}"
