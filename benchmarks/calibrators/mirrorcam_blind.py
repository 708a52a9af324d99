"""This project's own calibration: `python -m benchmarks.calibrators.mirrorcam_blind SET OUT [--without-base]`.

Does what `mirrorcam calibrate` does with a set's frames, base frames, nominal layout and board. Writes OUT, a
`layout.json` with its covariance, and prints the alarms for which the command would end with exit code 1.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.calibrators.command_line import run
from mirrorcam.calibration.calibration_files import calibrate_files
from mirrorcam.calibration.calibration_request import CalibrationRequest


def calibrate_set(folder: Path, out: Path, *, without_base: bool = False) -> tuple[str, ...]:
    """Calibrate a set, write the layout, and return the alarms."""
    base = folder / "base"
    request = CalibrationRequest(
        board=folder / "board.toml",
        layout=folder / "layout.json",
        base=(base,) if base.is_dir() and not without_base else (),
    )
    calibration = calibrate_files([folder / "frames"], request)
    calibration.layout.save(out)
    return () if calibration.diagnostics is None else calibration.diagnostics.alarms


def calibrate(options: argparse.Namespace) -> None:
    """Calibrate according to the options, and print the alarms."""
    for alarm in calibrate_set(options.set, options.out, without_base=options.without_base):
        print(f"alarm: {alarm}")


if __name__ == "__main__":
    sys.exit(run(__doc__, calibrate, lambda parser: parser.add_argument("--without-base", action="store_true")))
