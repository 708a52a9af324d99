"""`mirrorcam studio` and `live`: one page in the browser, for a design, its device and its camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.options import Force, Layout, bounded
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require

Port = Annotated[
    int | None,
    bounded(
        Bounds(0, 65_535), "port of the page on the loopback address, 0: any free one", unset="the first free from 8610"
    ),
]
NoBrowser = Annotated[bool, Parameter(help="print the address, and do not open the browser")]


def studio(
    design: Annotated[
        str | None,
        Parameter(
            name="DESIGN", help="design.toml, layout.json, output of a sweep, or the link of a design [default: 3 x 3]"
        ),
    ] = None,
    /,
    *,
    port: Port = None,
    no_browser: NoBrowser = False,
    out: Annotated[Path, Parameter(help="output folder of files built and rendered from the page")] = Path(
        "output/studio"
    ),
    snapshot: Annotated[
        Path | None,
        Parameter(metavar="FILE.html", help="write a page that needs no server (6 minutes on two cores), and end"),
    ] = None,
    force: Force = False,
) -> int:
    """Design, build and use a camera with mirrors, on a page in the browser.

    Serves the page on this machine until Ctrl-C. With --snapshot, writes one HTML file with designs of 1 x 2 to 5 x 5
    mirrors, four scales and three trade-offs.

    Examples:
        mirrorcam studio
        mirrorcam studio output/sweep --port 0
        mirrorcam studio 'http://127.0.0.1:8610/#rows=2&cols=2'
        mirrorcam studio --snapshot designs.html
    """
    if snapshot is not None:
        return _snapshot(None if design is None else Path(design), snapshot, force=force)
    require("studio")
    from mirrorcam.studio.serve import opened, serve

    return serve(opened(design), port=port, out=out, browser=not no_browser, on_note=lambda text: say("studio", text))


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
    port: Port = None,
    no_browser: NoBrowser = False,
    out: Annotated[Path, Parameter(help="output folder of recordings, pictures and calibrations")] = Path(
        "output/live"
    ),
) -> int:
    """Align, focus and calibrate a camera, on a page in the browser.

    Opens the Camera tab of `mirrorcam studio`, which shows the frame, views, a refocused picture and depth until
    Ctrl-C. Writes recordings/, pictures/ and calibrations/.

    Examples:
        mirrorcam live --layout output/mine/layout.json
        mirrorcam live 0 --layout layout.json --board board.toml
    """
    if not source:
        raise InputError("SOURCE is empty, expected a camera's number or address, a video or a folder")
    require("studio")
    from mirrorcam.optics.geometry.design_spec import DesignSpec
    from mirrorcam.studio.live.values import LiveRequest
    from mirrorcam.studio.serve import Opening, serve

    opening = Opening(DesignSpec(), fragment="tab=camera", camera=LiveRequest(layout, source), board=board)
    return serve(opening, port=port, out=out, browser=not no_browser, on_note=lambda text: say("live", text))


def _snapshot(design: Path | None, path: Path, *, force: bool) -> int:
    from mirrorcam.core.disk.files import write_text
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.figures.figure_texts import count_text
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.designs.design_files import DesignRequest, read_request
    from mirrorcam.studio.atlas import AtlasGrid, atlas
    from mirrorcam.studio.page import snapshot_page

    spec = (DesignRequest() if design is None else read_request(design)).spec
    if spec.pattern is not None:
        raise InputError(f"{design}: has a pattern of views, expected rows and columns for --snapshot")
    grid = AtlasGrid()
    with output_folder(path.parent, "studio", force=force) as output:
        output.refuse_others(path.name)
        with long_work("studio", f"{count_text(len(grid.specs(spec)), 'design')}", "designs") as advance:
            page = snapshot_page(spec, atlas(spec, grid, workers=cores(), progress=advance))
        with output.staged(complete=False) as folder:
            write_text(folder / path.name, page)
    say("studio", f"{path} written, {len(page.encode()) / 1e6:.1f} MB")
    return 0
