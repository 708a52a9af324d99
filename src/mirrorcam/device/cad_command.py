"""`mirrorcam cad`: from a layout to parts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.console.option_texts import ADAPTER_TEXT, FORCE, MIRRORS_TEXT, AdapterKind
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import Value

SHOWN = ("device.", "mirrors.", "elastic.")
"""Prefixes of the names of checks that are printed even if they pass."""


class CadOptions(Value):
    """Generate and check every part of the device of a layout: files to print, cut, assemble and view.

    Open index.html in the output folder. Parts that have not changed since an earlier run are re-used.
    """

    layout: tyro.conf.Positional[Path] = Field(description="layout.json")
    out: Path = Field(default=Path("output/cad"), description="output folder")
    force: bool = FORCE
    hardware: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="TOML file with values that replace those of the table of dimensions (docs/cad.md)"
    )
    camera: Annotated[
        str | None, tyro.conf.arg(metavar="NAME|PATH", help_behavior_hint="(as in --hardware, else the layout's)")
    ] = Field(default=None, description="body of the camera: a name that `mirrorcam camera list` shows, or a TOML file")
    fasteners: Annotated[
        Literal["insert", "nut"] | None,
        tyro.conf.arg(metavar="insert|nut", help_behavior_hint="(as in --hardware, else insert)"),
    ] = Field(default=None, description="threads for the M3 screws: heat-set inserts or nuts")
    adapter: Annotated[
        AdapterKind | None, tyro.conf.arg(metavar="KIND", help_behavior_hint="(as in --hardware, else none)")
    ] = Field(default=None, description=ADAPTER_TEXT)
    mirrors: Annotated[
        Literal["glue", "screws"] | None,
        tyro.conf.arg(metavar="glue|screws", help_behavior_hint="(as in --hardware, else glue)"),
    ] = Field(
        default=None,
        description=MIRRORS_TEXT,
    )
    elastic: bool = Field(
        default=False,
        description="also tell how gravity, warmth and creep move the mirrors, by finite elements (extra fe; minutes)",
    )
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(all cores)")] = WORKERS.field(
        None, "number of worker processes"
    )


def run(options: CadOptions) -> int:
    """Build the parts and print the figures of the device, and every check that fails."""
    from mirrorcam.cad.build import build_parts
    from mirrorcam.cad.plan.hardware import field_of_view
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.device.device_folder import device_folder, read_hardware
    from mirrorcam.optics.geometry.layout import Layout

    layout = Layout.load(options.layout)
    hardware = read_hardware(
        options.hardware,
        camera=options.camera,
        fasteners=options.fasteners,
        adapter=options.adapter,
        mirrors=options.mirrors,
        layout=layout,
    )
    if hardware.camera.field_of_view_deg is None:
        body, seen = hardware.camera.name, field_of_view(layout.camera)
        say("cad", f"camera body {body} states no field_of_view_deg: not compared with that of the layout, {seen}")
    require("cad", *(("fe",) if options.elastic else ()))
    doing = f"a device of {count_text(len(layout.mirrors), 'mirror')}"
    with (
        long_work("cad", doing, "steps") as advance,
        device_folder(options.out, hardware, elastic=options.elastic, force=options.force) as folder,
    ):
        checks = build_parts(
            layout,
            folder,
            hardware,
            previous=options.out,
            workers=options.workers or cores(),
            progress=advance,
            elastic=options.elastic,
        )
    from mirrorcam.cad.plan.prices import summary_of

    failed = {name for name, check in checks.items() if not check.passed}
    print_metrics({"measured": {name: checks[name] for name in checks if name in failed or name.startswith(SHOWN)}})
    limited = sum(check.limit is not None for check in checks.values())
    verdict = f"{len(failed)} of {limited} checks failed" if failed else f"{limited} checks passed"
    others = count_text(len(checks) - limited, "figure")
    say("cad", f"{summary_of(checks)}; prices are estimates, see {options.out / 'bom.md'}")
    say("cad", f"{verdict}, {others} without a limit; open {options.out / 'index.html'}")
    return 1 if failed else 0
