"""A leaderboard from `evaluation.json` files, anyone's, and its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mirrorcam.bench.evaluation import Evaluation
from mirrorcam.bench.evaluation_reading import read_evaluation
from mirrorcam.bench.leaderboard_page import leaderboard_page
from mirrorcam.bench.scores.attempt import Attempt
from mirrorcam.bench.scores.leaderboard import Leaderboard, leaderboard
from mirrorcam.bench.scores.leaderboard_texts import markdown
from mirrorcam.core.disk.output_folder import refuse_texts, write_texts
from mirrorcam.core.messages import shortened
from mirrorcam.core.names import LONGEST
from mirrorcam.core.values import InputError

COMMAND = "leaderboard"
MOST_CHARS = 500


def read_leaderboard(evaluations: Sequence[str], not_run: Sequence[str] = ()) -> Leaderboard:
    """The board of evaluations as `NAME=FILE`, several of one name together, and of `NAME=WHY` that were not run.

    Raises InputError in one line for a file that is no evaluation, or results that do not fit together.
    """
    attempts: dict[str, list[Attempt]] = {}
    commands: dict[str, list[str]] = {}
    for given in evaluations:
        name, file = _pair(given, "NAME=FILE")
        evaluation = read_evaluation(Path(file))
        attempts.setdefault(name, []).extend(attempts_of(evaluation))
        told = commands.setdefault(name, [])
        if evaluation.command not in told:
            told.append(evaluation.command)
    left_out = dict(_pair(given, "NAME=WHY") for given in not_run)
    if both := sorted(left_out.keys() & attempts.keys()):
        raise InputError(f"--not-run: {both[0]} has an evaluation, expected none")
    lines = {name: shortened("; ".join(told), MOST_CHARS - 10) for name, told in commands.items()}
    return leaderboard(attempts, lines, left_out)


def attempts_of(evaluation: Evaluation) -> list[Attempt]:
    """What came of each set; raises InputError for one that has neither a score nor a failure."""
    scored, found = evaluation.scored, []
    for each in evaluation.tried:
        if (each.name in scored) == bool(each.failure):
            raise InputError(f"{each.name}: expected either a score or a failure")
        figures = {} if each.failure else scored[each.name].figures
        found.append(Attempt(**each.model_dump(), figures=figures))
    return found


def _pair(given: str, form: str) -> tuple[str, str]:
    name, _, rest = given.partition("=")
    if not rest or not name or len(name) > LONGEST or not name.isprintable() or not rest.isprintable():
        raise InputError(f"{shortened(given, 80)!r}: expected {form}, NAME with 1 to {LONGEST} printable characters")
    if form.endswith("WHY") and len(rest) > MOST_CHARS:
        raise InputError(f"--not-run {name}: {len(rest)} characters, expected {MOST_CHARS} at most")
    return name, rest


def texts(board: Leaderboard, page: Path, markdown_file: Path | None, json_file: Path | None) -> Mapping[Path, str]:
    """The files of a board by their paths; raises InputError where a path appears twice."""
    found = {page: leaderboard_page(board)}
    for path, content in ((markdown_file, markdown(board)), (json_file, board.text())):
        if path is not None:
            if path in found:
                raise InputError(f"{path}: is to be written twice, expected different files")
            found[path] = content
    return found


def write_leaderboard(files: Mapping[Path, str], *, force: bool) -> None:
    """Write the files, each atomically; raises InputError before any where one would replace a file of the user's."""
    refuse_texts(files, COMMAND, force=force)
    write_texts(files, COMMAND, force=force)
