"""`mirrorcam demo`: a rendered frame, decoded here and shown on a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say

PAGE, FRAME, LAYOUT = "index.html", "frame.jpg", "layout.json"


def demo(
    *,
    no_browser: Annotated[bool, Parameter(help="write the page, and do not open it")] = False,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/demo"),
    force: Force = False,
) -> int:
    """Decode a rendered frame, and show its views, depth and features on a page in the browser.

    On the page, the mouse refocuses the picture and moves the viewpoint. The folder also gets the frame and its layout,
    for trying other commands.

    Examples:
        mirrorcam demo
        mirrorcam demo --no-browser --out demo
        mirrorcam decode output/demo/frame.jpg --layout output/demo/layout.json
    """
    import webbrowser
    from contextlib import closing

    from mirrorcam.core.disk.files import read_bytes, write_bytes, write_text
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.processes.worker_pool import in_two_processes
    from mirrorcam.studio.demo.decoded_frame import LARGEST_FRAME_BYTES, DecodedFrame, compile_ahead
    from mirrorcam.studio.demo.demo_page import demo_page

    source = Path(__file__).parent
    inputs = source / FRAME, source / LAYOUT
    with (
        output_folder(out, "demo", force=force) as output,
        in_two_processes(preload=["mirrorcam.studio.demo.decoded_frame"]) as calls,
    ):
        output.refuse_others(PAGE, FRAME, LAYOUT)
        with (
            long_work("demo", "9 views, depth and features of one frame") as advance,
            closing(calls([(DecodedFrame.of, (*inputs, advance)), (compile_ahead, inputs)])) as results,
        ):
            decoded = next(results)
        with output.staged() as folder:
            for name in (FRAME, LAYOUT):
                write_bytes(folder / name, read_bytes(source / name, LARGEST_FRAME_BYTES))
            write_text(folder / PAGE, demo_page(decoded, out))
    say("demo", f"{out / PAGE} written" + ("" if no_browser else ", opening it"))
    if not no_browser:
        webbrowser.open((out / PAGE).absolute().as_uri())
    return 0
