"""`mirrorcam studio`: a page in the browser on which a design is changed by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import InputError, Value

PORT = Bounds(0, 65_535)


class StudioOptions(Value):
    """Change a design by hand on a page of this machine, in the browser; Ctrl-C ends it."""

    design: tyro.conf.Positional[
        Annotated[Path | None, tyro.conf.arg(metavar="[layout.json|design.toml|SWEEP]", help_behavior_hint="")]
    ] = Field(default=None, description="layout, request or sweep to begin with; without, the default design")
    port: int = PORT.field(8610, "port of the page on the loopback address; 0: any that is free")
    no_browser: bool = Field(default=False, description="do not open the browser, only print the address")
    out: Path = Field(default=Path("output/studio"), description="folder for what is built and rendered from the page")
    snapshot: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html", help_behavior_hint="")] = Field(
        default=None,
        description="serve nothing; write a page that needs no server, with designs of 1 x 2 to 5 x 5 mirrors, four "
        "scales and three trade-offs, which takes about six minutes on two cores",
    )
    force: bool = FORCE


def run(options: StudioOptions) -> int:
    """Serve the page until Ctrl-C."""
    if options.snapshot is not None:
        return _snapshot(options.design, options.snapshot, force=options.force)
    require("studio")
    from mirrorcam.studio.serve import opened, serve

    opening = opened(options.design)
    return serve(
        opening, port=options.port, out=options.out, browser=not options.no_browser, tell=lambda t: say("studio", t)
    )


def _snapshot(design: Path | None, path: Path, *, force: bool) -> int:
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.designs.design_request import read_request
    from mirrorcam.optics.geometry.design_spec import DesignSpec
    from mirrorcam.studio.atlas import AtlasGrid, atlas
    from mirrorcam.studio.page import snapshot_page

    spec = DesignSpec() if design is None else read_request(design)
    if spec.pattern is not None:
        raise InputError(f"{design}: asks for a pattern of views, expected rows and columns for --snapshot")
    grid = AtlasGrid()
    with output_folder(path.parent, "studio", force=force) as output:
        output.refuse_others(path.name)
        with long_work("studio", f"{count_text(len(grid.specs(spec)), 'design')}", "designs") as advance:
            page = snapshot_page(spec, atlas(spec, grid, workers=cores(), progress=advance))
        with output.staged(complete=False) as folder:
            write_text(folder / path.name, page)
    say("studio", f"{path} written, {len(page.encode()) / 1e6:.1f} MB")
    return 0
