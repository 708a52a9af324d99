"""Figures of the default run: `python -m benchmarks.default_run [FOLDER] [--json FILE]`.

Runs `mirrorcam run --out FOLDER`, which re-uses what is there and still valid, and prints the table of parts of
docs/measured.md. The record `default_run` holds every figure of `metrics.json`, `default_parts` the table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

from benchmarks.records import Figure, Table, add_json_option, table, write_record
from mirrorcam.cad.plan.prices import hours_text
from mirrorcam.cli import main as mirrorcam
from mirrorcam.optics.base.files import read_json
from mirrorcam.optics.base.values import InputError, Metric

HEAD = ("part", "solid", "sliced", "printing", "smallest wall", "needs support")


def parts_table(metrics: Mapping[str, Metric]) -> Table:
    """The printed parts, from the largest; a dash where no slicer was there."""
    names = [key.split(".")[1] for key in metrics if key.startswith("cad.") and key.endswith(".volume_cm3")]

    def value(part: str, name: str) -> float | None:
        metric = metrics.get(f"cad.{part}.{name}")
        return None if metric is None else metric.value

    def said(part: str, name: str, form: str, unit: str) -> str:
        figure = value(part, name)
        return "-" if figure is None else f"{figure:{form}} {unit}"

    rows = [
        (
            part.replace("_", " "),
            said(part, "volume_cm3", ".1f", "cm³"),
            said(part, "print_g", ".0f", "g"),
            hours_text(value(part, "print_minutes")),
            said(part, "wall_mm", ".2f", "mm"),
            f"{said(part, 'overhang_mm2', '.0f', 'mm²')}, {said(part, 'support_filament_mm', '.0f', 'mm of filament')}",
        )
        for part in sorted(names, key=lambda part: -metrics[f"cad.{part}.volume_cm3"].value)
    ]
    return table(HEAD, rows)


def main() -> int:
    """Run, print the table, write the records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("output/default"))
    add_json_option(parser)
    options = parser.parse_args()
    code = mirrorcam(["run", "--out", str(options.folder)])
    if code:
        return code
    try:
        found = read_json(options.folder / "metrics.json")
    except InputError as error:
        parser.error(str(error))
    metrics = {name: Metric.model_validate(each) for name, each in found.items()}
    parts = parts_table(metrics)
    print(parts.markdown())
    values = {name: Figure(value=each.value, unit=each.unit) for name, each in metrics.items()}
    write_record(options.json, "default_run", values, command="mirrorcam run")
    write_record(options.json, "default_parts", table=parts, command="mirrorcam run")
    return 0


if __name__ == "__main__":
    sys.exit(main())
