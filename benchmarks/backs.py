"""The default device on every back, built in full: `python -m benchmarks.backs FOLDER [--layout FILE]`.

Builds each device into a folder of FOLDER by the name of its back and adds a line of JSON to FOLDER/backs.jsonl; what
is there is not built again. Then prints the table of docs/cad.md. Masses and times of printing need PrusaSlicer.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path

from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.cad.plan.prices import hours_text
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.values import Metric, Value
from mirrorcam.device.device_folder import write_device
from mirrorcam.device.hardware_choice import HardwareChoice
from mirrorcam.optics.geometry.layout import Layout

DEFAULT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
HEAD = ("back", "device, solid", "price", "printing", "thinnest wall", "stress", "tips at", "checks passed")


class BackResult(Value):
    """What the checks of one device say; `failed` are names of checks past their limit."""

    back: str
    mass_g: float
    price: float
    currency: str
    print_minutes: float | None
    wall_mm: float
    """The thinnest wall of the back's own parts."""
    stress_mpa: float | None
    tips_at_deg: float | None
    checks: int
    failed: tuple[str, ...]


def result_of(back: str, checks: dict[str, Metric]) -> BackResult:
    """What the figures of a device say of its back."""

    def value(name: str) -> float | None:
        return checks[name].value if name in checks else None

    price = checks["device.price"]
    return BackResult(
        back=back,
        mass_g=checks["device.mass_g"].value,
        price=price.value,
        currency=price.unit,
        print_minutes=value("device.print_minutes"),
        wall_mm=min(
            check.value for name, check in checks.items() if name.startswith("adapter_") and name.endswith(".wall_mm")
        ),
        stress_mpa=value("device.back_stress_mpa"),
        tips_at_deg=value("device.tips_at_deg"),
        checks=sum(check.limit is not None for check in checks.values()),
        failed=tuple(sorted(name for name, check in checks.items() if not check.passed)),
    )


def read_results(path: Path) -> dict[str, BackResult]:
    """The lines of an earlier run by back, of each the last; none where there is no file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    results = (BackResult.model_validate_json(line) for line in lines)
    return {result.back: result for result in results}


def table_of(results: Iterable[BackResult]) -> Table:
    """The table of docs/cad.md; a dash where a figure is of no concern to a back."""

    def said(value: float | None, form: str, unit: str) -> str:
        return "-" if value is None else f"{value:{form}} {unit}"

    rows = [
        (
            f"`{each.back}`",
            f"{each.mass_g:.0f} g",
            f"{each.price:.0f} {each.currency}",
            hours_text(each.print_minutes),
            f"{each.wall_mm:.1f} mm",
            said(each.stress_mpa, ".1f", "MPa"),
            said(each.tips_at_deg, ".1f", "°"),
            f"{each.checks - len(each.failed)} of {each.checks}",
        )
        for each in results
    ]
    return table(HEAD, rows)


def main() -> None:
    """Build what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--layout", type=Path, default=DEFAULT)
    add_json_option(parser)
    options = parser.parse_args()
    layout, path = Layout.load(options.layout), options.folder / "backs.jsonl"
    results = read_results(path)
    for back in (kind for kind in BACKS if kind not in results):
        checks = write_device(layout, options.folder / back, HardwareChoice(adapter=back).read(layout))
        results[back] = result_of(back, checks)
        lines = (json.dumps(each.model_dump(mode="json")) for each in results.values())
        write_text(path, "\n".join(lines) + "\n")
    found = table_of(results[kind] for kind in BACKS)
    print(found.markdown())
    write_record(options.json, "backs", table=found)


if __name__ == "__main__":
    main()
