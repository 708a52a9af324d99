"""`mirrorcam live`: a camera with its mirrors on a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.progress import say
from mirrorcam.core.extras import require
from mirrorcam.core.values import Value
from mirrorcam.studio.studio_command import PORT

WIDTH_PX = Bounds(40, 4096)


class LiveOptions(Value):
    """Show a camera on a page of this machine: frame, views, refocused picture and depth; Ctrl-C ends it."""

    source: tyro.conf.Positional[
        Annotated[str, tyro.conf.arg(metavar="[DEVICE|VIDEO|FOLDER]", help_behavior_hint="")]
    ] = Field(
        default="0", description="number (0 if not given) or address of a camera, a video, or a folder of pictures"
    )
    layout: Path = Field(
        description="layout.json: nominal, to align the mirrors by, or calibrated, for views and depth that are right"
    )
    board: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="board.toml of the target, to take calibration pictures and calibrate"
    )
    view_width_px: int = WIDTH_PX.field(320, "width of each view and of the refocused picture")
    depth_width_px: int = WIDTH_PX.field(200, "width of the views that depth is measured in")
    port: int = PORT.field(8611, "port of the page on the loopback address; 0: any that is free")
    no_browser: bool = Field(default=False, description="do not open the browser, only print the address")
    out: Path = Field(
        default=Path("output/live"),
        description="folder for recordings/, pictures/ and calibrations/ made from the page; files in it stay",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.source:
            raise ValueError("source is empty, expected a camera's number or address, a video or a folder")
        return self


def run(options: LiveOptions) -> int:
    """Serve the page until Ctrl-C."""
    require("studio")
    from mirrorcam.studio.live.server import serve_live
    from mirrorcam.studio.live.values import LiveRequest

    request = LiveRequest(
        options.layout,
        options.source,
        view_width_px=options.view_width_px,
        depth_width_px=options.depth_width_px,
    )
    return serve_live(
        request,
        out=options.out,
        board=options.board,
        port=options.port,
        browser=not options.no_browser,
        tell=lambda line: say("live", line),
    )
