"""`mirrorcam live`: a camera with its mirrors on a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Layout
from mirrorcam.core.console.progress import say
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.studio.studio_command import NoBrowser, Port


def live(
    source: Annotated[
        str, Parameter(name="SOURCE", help="number or address of a camera, a video, or a folder of pictures")
    ] = "0",
    /,
    *,
    layout: Layout,
    board: Annotated[
        Path | None, Parameter(metavar="FILE", help="board.toml, to take calibration pictures and calibrate")
    ] = None,
    port: Port = 8611,
    no_browser: NoBrowser = False,
    out: Annotated[Path, Parameter(help="output folder of recordings, pictures and calibrations")] = Path(
        "output/live"
    ),
) -> int:
    """Align, focus and calibrate a camera, on a page in the browser.

    Shows frame, views, a refocused picture and depth on this machine until Ctrl-C. What is made from the page goes to
    recordings/, pictures/ and calibrations/.

    Examples:
        mirrorcam live --layout output/mine/layout.json
        mirrorcam live 0 --layout layout.json --board board.toml
    """
    if not source:
        raise InputError("SOURCE is empty, expected a camera's number or address, a video or a folder")
    require("studio")
    from mirrorcam.studio.live.server import serve_live
    from mirrorcam.studio.live.values import LiveRequest

    return serve_live(
        LiveRequest(layout, source),
        out=out,
        board=board,
        port=port,
        browser=not no_browser,
        on_note=lambda line: say("live", line),
    )
