"""`mirrorcam studio`: a page in the browser on which a design is changed by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.console.progress import say
from mirrorcam.optics.base.bounds import Bounds
from mirrorcam.optics.base.values import Value
from mirrorcam.workflow.extras import require

PORT = Bounds(0, 65_535)


class StudioOptions(Value):
    """Change a design by hand on a page of this machine, in the browser; Ctrl-C ends it."""

    design: tyro.conf.Positional[
        Annotated[Path | None, tyro.conf.arg(metavar="[layout.json|design.toml]", help_behavior_hint="")]
    ] = Field(default=None, description="layout or request to begin with; without, the default design")
    port: int = PORT.field(8610, "port of the page on the loopback address; 0: any that is free")
    no_browser: bool = Field(default=False, description="do not open the browser, only print the address")
    out: Path = Field(default=Path("output/studio"), description="folder for what is built and rendered from the page")


def run(options: StudioOptions) -> int:
    """Serve the page until Ctrl-C."""
    require("studio")
    from mirrorcam.studio.serve import opened, serve

    opening = opened(options.design)
    return serve(
        opening, port=options.port, out=options.out, browser=not options.no_browser, tell=lambda t: say("studio", t)
    )
