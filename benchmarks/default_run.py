"""Figures of the default run: `python -m benchmarks.default_run [FOLDER] [--json FILE]`.

Runs `mirrorcam run --out FOLDER`, which reuses valid results in FOLDER. The record `default_run` holds every
figure of its `metrics.json`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.records import Figure, add_json_option, write_record
from mirrorcam.cli import main as mirrorcam
from mirrorcam.core.disk.files import read_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric


def main() -> int:
    """Run the pipeline, and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("output/default"))
    add_json_option(parser)
    options = parser.parse_args()
    code = mirrorcam(["run", "--out", str(options.folder)])
    if code:
        return code
    try:
        content = read_json(options.folder / "metrics.json")
    except InputError as error:
        parser.error(str(error))
    metrics = {name: Metric.model_validate(value) for name, value in content.items()}
    values = {name: Figure(value=metric.value, unit=metric.unit) for name, metric in metrics.items()}
    write_record(options.json, "default_run", values, command="mirrorcam run")
    return 0


if __name__ == "__main__":
    sys.exit(main())
