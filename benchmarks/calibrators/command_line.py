"""The command line that all calibrators have: SET OUT, and options of their own."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from mirrorcam.core.errors import InputError


def run(
    description: str | None,
    calibrate: Callable[[argparse.Namespace], object],
    add_options: Callable[[argparse.ArgumentParser], object] = lambda parser: None,
) -> int:
    """Calibrate the `set` of the command line and write its `out`; return the exit code, 2 on failure."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("out", type=Path)
    add_options(parser)
    options = parser.parse_args()
    try:
        calibrate(options)
    except InputError as error:
        print(error)
        return 2
    return 0
