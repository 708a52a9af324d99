"""`mirrorcam scene`: a tabletop scene photographed through a layout, with the ground truth of its light field."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.core.bounds import DEPTH_MM, SAMPLES_PER_PIXEL, SEED
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.extras import require
from mirrorcam.core.values import InputError, Value
from mirrorcam.optics.geometry.design_spec import MOST_DEPTHS
from mirrorcam.simulation.camera_options import SensorOption, TolerancesOption, sensor_from_text, tolerances_from_text

if TYPE_CHECKING:
    from mirrorcam.render_scenes.tabletop.tabletop import NamedMesh


class SceneOptions(Value):
    """Render a tabletop scene as a device built with tolerances sees it, with the true views and depths."""

    layout: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LAYOUT", help_behavior_hint="")] = Field(
        description="nominal layout.json"
    )
    depths_mm: Annotated[
        tuple[Annotated[float, DEPTH_MM.each], ...],
        tyro.conf.arg(metavar="MM...", help_behavior_hint="(the layout's)"),
    ] = Field(
        default=(),
        max_length=MOST_DEPTHS,
        description=f"depths of the objects, nearest first: {MOST_DEPTHS} at most of {DEPTH_MM}",
    )
    mesh: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(metavar="FILE[:x,y,z]", help_behavior_hint=""),
    ] = Field(
        default=(),
        description=(
            "mesh to put on the table (STL, PLY or OBJ, in mm, z up), and the middle of its base in view axes; may be "
            "repeated"
        ),
    )
    seed: int = SEED.field(0, "seed of objects, tolerances and noise; the same seed gives the same bytes")
    spp: int = SAMPLES_PER_PIXEL.cut(least=4).field(64, "samples per pixel")
    sensor: SensorOption = "c920"
    as_built: TolerancesOption = ""
    out: Path = Field(default=Path("output/scene"), description="folder for the scene; an interrupted one is resumed")


def mesh_from_text(text: str) -> NamedMesh:
    """Parse a mesh and its place from a text like vase.stl:10,-30,350, or from the name of its file alone."""
    from mirrorcam.render_scenes.tabletop.tabletop import NamedMesh

    name, colon, place = text.rpartition(":")
    numbers = place.split(",")
    if not colon or len(numbers) != 3:
        return NamedMesh(file=Path(text))
    try:
        return NamedMesh(file=Path(name), place_in_view_mm=[float(number) for number in numbers])
    except ValueError:
        raise InputError(f"--mesh {text}: expected FILE or FILE:x,y,z in mm, view axes") from None


def run(options: SceneOptions) -> int:
    """Render the scene."""
    from mirrorcam.optics.geometry.layout import Layout

    layout = Layout.load(options.layout)
    tolerances, sensor = tolerances_from_text(options.as_built), sensor_from_text(options.sensor)
    require("render")
    from mirrorcam.render_scenes.tabletop.tabletop_set import MANIFEST, TabletopRequest
    from mirrorcam.simulation.rendering import OVERVIEW, write_scene

    request = TabletopRequest(
        layout=layout,
        depths_mm=options.depths_mm,
        meshes=tuple(mesh_from_text(text) for text in options.mesh),
        seed=options.seed,
        tolerances=tolerances,
        sensor=sensor,
        spp=options.spp,
    )
    views = layout.rows * layout.cols
    with long_work("scene", f"1 frame + {views} true views, {options.spp} samples", "pictures") as advance:
        write_scene(request, options.out, advance)
    truth = options.out / "truth"
    say(
        "scene",
        f"{options.out / MANIFEST} written; true views, depths and disparities in {truth}; {OVERVIEW} shows both",
    )
    return 0
