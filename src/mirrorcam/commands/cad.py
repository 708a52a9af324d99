"""`mirrorcam cad`: from a layout to parts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.console.progress import long_work, print_metrics, say
from mirrorcam.optics.base.figure_texts import count_text
from mirrorcam.optics.base.values import Value
from mirrorcam.workflow.extras import require

SHOWN = ("device.", "mirrors.")
"""Prefixes of the names of checks that are printed even if they pass."""


class CadOptions(Value):
    """Build and check every part of a layout's device: files to print, cut, assemble and look at.

    Open index.html in the folder. What has not changed since an earlier run into the same folder is taken over.
    """

    layout: tyro.conf.Positional[Path] = Field(description="layout.json")
    out: Path = Field(default=Path("output/cad"), description="folder for everything that is written")
    hardware: Path | None = Field(
        default=None, description="TOML file that replaces any of the table of dimensions (docs/cad.md)"
    )
    camera: str | None = Field(
        default=None,
        description="body of the camera: c920, board_38 or a TOML file (default: c920, or as in --hardware)",
    )
    fasteners: Literal["insert", "nut"] | None = Field(
        default=None, description="what M3 screws are driven into (default: insert, or as in --hardware)"
    )
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(all cores)")] = Field(
        default=None, ge=1, description="processes that share the work"
    )


def run(options: CadOptions) -> int:
    """Build the parts and print the figures of the device, and every check that fails."""
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.workflow.device_folder import read_hardware, write_device

    layout = Layout.load(options.layout)
    hardware = read_hardware(options.hardware, camera=options.camera, fasteners=options.fasteners)
    require("cad")
    doing = f"a device of {count_text(len(layout.mirrors), 'mirror')}"
    with long_work("cad", doing, "steps") as advance:
        checks = write_device(layout, options.out, hardware, workers=options.workers, progress=advance)
    failed = {name for name, check in checks.items() if not check.passed}
    print_metrics({"measured": {name: checks[name] for name in checks if name in failed or name.startswith(SHOWN)}})
    limited = sum(check.limit is not None for check in checks.values())
    verdict = f"{len(failed)} of {limited} checks failed" if failed else f"{limited} checks passed"
    others = count_text(len(checks) - limited, "figure")
    say("cad", f"{verdict}, {others} without a limit; open {options.out / 'index.html'}")
    return 1 if failed else 0
