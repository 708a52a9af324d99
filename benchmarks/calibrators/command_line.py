"""The command line that all calibrators have: SET OUT."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from mirrorcam.optics.base.values import InputError


def run(description: str | None, calibrate_set: Callable[[Path, Path], None]) -> int:
    """Calibrate the set of the command line and write the file that it names; 2 where that cannot be done."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    try:
        calibrate_set(options.set, options.out)
    except InputError as error:
        print(error)
        return 2
    return 0
