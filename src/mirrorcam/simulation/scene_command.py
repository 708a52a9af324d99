"""`mirrorcam scene`: a tabletop scene photographed through a layout, with the ground truth of its light field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.extras import require
from mirrorcam.simulation.render_request import SceneRequest


def scene(
    layout: Annotated[Path, Parameter(name="LAYOUT", help="nominal layout.json")],
    /,
    *,
    request: SceneRequest = SceneRequest(),
    out: Annotated[Path, Parameter(help="folder for the scene; an interrupted one is resumed")] = Path("output/scene"),
) -> int:
    """Render a tabletop scene, with its true views and depths.

    The frame shows a device built with tolerances. Writes scene.json, layout.json, the frame, and truth/ with the true
    views, depths, disparities and an overview.

    Examples:
        mirrorcam scene layout.json --out tabletop
        mirrorcam scene layout.json --depths-mm 280 350 450 --mesh vase.stl part.ply:20,-30,340
    """
    from mirrorcam.optics.geometry.layout import Layout

    device = Layout.load(layout)
    require("render")
    from mirrorcam.render_scenes.tabletop.tabletop_set import MANIFEST
    from mirrorcam.simulation.rendering import OVERVIEW, write_scene

    requested = request.read(device)
    views = device.rows * device.cols
    with long_work("scene", f"1 frame + {views} true views, {requested.spp} samples", "pictures") as advance:
        write_scene(requested, out, advance)
    truth = out / "truth"
    say("scene", f"{out / MANIFEST} written; true views, depths and disparities in {truth}; {OVERVIEW} shows both")
    return 0
