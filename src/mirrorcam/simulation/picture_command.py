"""`mirrorcam picture`: a rendered photograph of the device."""

from __future__ import annotations

import glob
from pathlib import Path

import tyro
from pydantic import Field

from mirrorcam.core.bounds import SAMPLES_PER_PIXEL
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import say
from mirrorcam.core.extras import require
from mirrorcam.core.values import InputError, Value


class PictureOptions(Value):
    """Render the device of a layout, with its printed parts, from the front and from the side (1920 x 1080 pixels).

    From the front, every mirror shows the lens.
    """

    layout: tyro.conf.Positional[Path] = Field(description="layout.json")
    parts: Path = Field(default=Path("output/cad"), description="folder that `mirrorcam cad` wrote for this layout")
    spp: int = SAMPLES_PER_PIXEL.field(64, "samples per pixel: more take longer and give less noise")
    out: Path = Field(default=Path("output/product.jpg"), description="picture to write, .jpg or .png")
    force: bool = FORCE


def run(options: PictureOptions) -> int:
    """Render and write the picture."""
    from mirrorcam.core.images.pictures import WRITTEN_ENDINGS
    from mirrorcam.optics.geometry.layout import Layout

    if options.out.suffix.lower() not in WRITTEN_ENDINGS:
        raise InputError(f"--out {options.out}: expected a name that ends in {', '.join(WRITTEN_ENDINGS)}")
    layout = Layout.load(options.layout)
    require("render")
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.simulation.rendering import write_product_picture

    with output_folder(options.out.parent, "picture", force=options.force) as output:
        output.refuse_others(glob.escape(options.out.name))
        say("picture", f"{options.spp} samples per pixel ...")
        with output.staged(complete=False) as folder:
            write_product_picture(layout, options.parts, folder / options.out.name, spp=options.spp)
    say("picture", f"{options.out} written")
    return 0
