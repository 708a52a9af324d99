"""Calibrators on rendered suites, and the leaderboard: `python -m benchmarks.leaderboard SUITE... --out FOLDER`.

SUITE is a `NAME.suite.json` that `mirrorcam suite` wrote. Each of `CALIBRATORS` is run on each suite by
`mirrorcam score suite`, like any user's; evaluations that exist in FOLDER are reused. Then `mirrorcam score
leaderboard` writes `leaderboard.html`, `.md` and `.json` of all of them into FOLDER. docs/leaderboard.md shows the
results of the suites `smoke` and `standard`, from `--json FILE`.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.records import add_json_option, table, write_record
from benchmarks.referees.mrcal_runner import python_with_mrcal
from mirrorcam.bench.scores.leaderboard import Leaderboard, board_rows, set_rows
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.names import markdown_text

ROOT = Path(__file__).parents[1]
EVALUATION = "evaluation.json"
INPUT_ERROR = 2
"""Exit code of bad input, after which there is no evaluation."""


@dataclass(frozen=True)
class Calibrator:
    """A module of `benchmarks.calibrators`, the file that it writes, and further options."""

    name: str
    module: str
    writes: str = "cameras.yaml"
    options: str = ""

    @property
    def command(self) -> str:
        """The shell command."""
        python = shlex.quote(sys.executable)
        line = f'{python} -m benchmarks.calibrators.{self.module} "$MIRRORCAM_SET" "$MIRRORCAM_RESULT/{self.writes}"'
        return f"{line} {self.options}".rstrip()


COVARIANCE = '--covariance "$MIRRORCAM_RESULT/covariance.json"'
CALIBRATORS = {
    "mirrorcam": Calibrator("MirrorCam", "mirrorcam_blind", "layout.json"),
    "mirrorcam-no-base": Calibrator(
        "MirrorCam, no bare pictures", "mirrorcam_blind", "layout.json", options="--without-base"
    ),
    "mrcal": Calibrator("mrcal, one lens", "mrcal_joint", options=COVARIANCE),
    "mrcal-spline": Calibrator("mrcal, one spline", "mrcal_joint", options="--spline"),
    "opencv-joint": Calibrator("OpenCV, joint", "opencv_joint", options=COVARIANCE),
    "opencv-per-view": Calibrator("OpenCV, each view alone", "opencv_per_view"),
}
"""Calibrators by the names of their folders."""
NOT_RUN = {
    "Kalibr": "it is distributed neither by PyPI, whose kalibr is a different program, nor by Debian, and is built "
    "inside ROS 1; mirrorcam score reads its results"
}
NO_MRCAL = "no interpreter here has it: Debian's package is python3-mrcal, and PyPI had no wheel for this Python"


def evaluate(calibrator: Calibrator, suite: Path, folder: Path, timeout_s: float) -> Path:
    """Evaluate a calibrator on a suite, unless done before; return the evaluation's path. Raises SystemExit."""
    path = folder / EVALUATION
    if path.exists():
        return path
    line = [sys.executable, "-m", "mirrorcam", "score", "suite", str(suite), "--command", calibrator.command]
    process = subprocess.run(
        [*line, "--out", str(folder), "--timeout-s", f"{timeout_s:g}"],
        check=False,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if process.returncode >= INPUT_ERROR or not path.exists():
        raise SystemExit(f"{calibrator.name} on {suite}: {process.stderr[-500:]}")
    print(f"{calibrator.name} on {suite.name}: done", flush=True)
    return path


def write_board(path: Path | None, board: Leaderboard) -> None:
    """Write the records of both tables of docs/leaderboard.md; figures are named by the folders of the calibrators."""
    names = {calibrator.name: name for name, calibrator in CALIBRATORS.items()}
    compared = {f"{names[row.calibrator]}.{key}": value for row in board.rows for key, value in row.over_common.items()}
    by_set = {
        f"{names[row.calibrator]}.{set_name}": value for row in board.rows for set_name, value in row.rms_px.items()
    }
    for key, figures, rows in (("", compared, board_rows(board)), ("_sets", by_set, set_rows(board))):
        header, *cells = ([markdown_text(cell) for cell in row] for row in rows)
        command = "python -m benchmarks.leaderboard SUITE... --out FOLDER"
        write_record(path, f"leaderboard{key}", figures, table(header, cells), command=command)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suites", type=Path, nargs="+", metavar="SUITE")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="+", choices=tuple(CALIBRATORS), default=tuple(CALIBRATORS))
    parser.add_argument(
        "--at-once", type=int, default=1, help="number of simultaneous evaluations, which then take longer"
    )
    parser.add_argument("--timeout-s", type=float, default=600.0)
    add_json_option(parser)
    options = parser.parse_args()
    not_run = dict(NOT_RUN)
    chosen = {name: CALIBRATORS[name] for name in options.only}
    with_mrcal = [name for name in chosen if name.startswith("mrcal")]
    if with_mrcal and python_with_mrcal(None) is None:
        not_run |= {chosen.pop(name).name: NO_MRCAL for name in with_mrcal}
    jobs = [(name, suite.resolve()) for suite in options.suites for name in chosen]

    def run_job(job: tuple[str, Path]) -> str:
        name, suite = job
        folder = options.out.resolve() / suite.name.removesuffix(".suite.json") / name
        return f"{chosen[name].name}={evaluate(chosen[name], suite, folder, options.timeout_s)}"

    with ThreadPoolExecutor(options.at_once) as pool:
        evaluations = list(pool.map(run_job, jobs))
    line = [sys.executable, "-m", "mirrorcam", "score", "leaderboard", *evaluations]
    line += ["--not-run", *(f"{name}={reason}" for name, reason in not_run.items())]
    line += ["--out", str(options.out)]
    code = subprocess.run(line, check=False).returncode
    if not code:
        write_board(options.json, read_model(Leaderboard, options.out / "leaderboard.json"))
    return code


if __name__ == "__main__":
    sys.exit(main())
