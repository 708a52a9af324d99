"""`mirrorcam cad`: from a layout to parts."""

from __future__ import annotations

from pathlib import Path

import tyro
from pydantic import Field

from mirrorcam.extras import require
from mirrorcam.folders import merged
from mirrorcam.progress import count_text, long_work, print_metrics, say
from optics.values import Value


class CadOptions(Value):
    """Build and check the mirror holder of a layout: STEP, STL and DXF."""

    layout: tyro.conf.Positional[Path] = Field(description="layout.json")
    out: Path = Field(default=Path("output/cad"), description="folder for the parts")


def run(options: CadOptions) -> int:
    """Build the parts and print their checks."""
    from optics.layout import Layout

    layout = Layout.load(options.layout)
    require("cad")
    from cad.build import build

    with long_work("cad", f"a holder for {count_text(len(layout.mirrors), 'mirror')}"), merged(options.out) as folder:
        checks = build(layout, folder)
    print_metrics({"measured": checks})
    say("cad", f"parts written to {options.out}")
    return 0 if all(check.passed for check in checks.values()) else 1
