"""`mirrorcam epi`: lines of a light field's pictures, view beside view."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.commands.light_fields import LightFieldsOptions, distinct_names, opened
from mirrorcam.console.progress import count_text, long_work, say


class EpiOptions(LightFieldsOptions):
    """Cut epipolar-plane images out of light fields: a picture with depths as slopes, and arrays."""

    axis: Literal["s", "t"] = Field(default="s", description="views beside each other (s), or above each other (t)")
    line: Annotated[int | None, tyro.conf.arg(metavar="PX", help_behavior_hint="(the middle)")] = Field(
        default=None, ge=0, description="row of the central view for s, column for t"
    )
    depth_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the reference plane's)")] = (
        Field(default=None, gt=0, description="depth from the pupil that stands upright")
    )
    out: Path = Field(
        default=Path("output/epi"),
        description=(
            "folder for NAME_epi.png and NAME_epi.npz (NumPy: samples (n, length, c) 0 to 1, weights (n, length), "
            "positions_mm (n,)) of each light field"
        ),
    )


def run(options: EpiOptions) -> int:
    """Cut and write epipolar-plane images."""
    import numpy as np

    from mirrorcam.figures.epi_figure import draw_epi
    from mirrorcam.optics.base.files import atomic
    from mirrorcam.optics.light_field.render.epipolar_images import epi

    names = distinct_names(options.light_fields, "pictures")
    with long_work("epi", count_text(len(names), "light field"), "files") as advance:
        for done, path in enumerate(options.light_fields, start=1):
            for name, light_field, known in opened(path, options.layout):
                lines = light_field.height_px if options.axis == "s" else light_field.width_px
                line = lines // 2 if options.line is None else options.line
                found = epi(light_field, options.axis, line, depth_mm=options.depth_mm)
                with atomic(options.out / f"{name}_epi.npz") as temporary:
                    np.savez_compressed(
                        temporary,
                        samples=found.samples,
                        weights=found.weights,
                        positions_mm=found.positions_mm,
                        axis=np.array(found.axis),
                        line=np.array(found.line),
                        plane_depth_mm=np.array(found.plane_depth_mm),
                        layout_identity=np.array(light_field.layout_identity),
                    )
                reference = light_field.reference_depth_mm
                draw_epi(
                    options.out / f"{name}_epi.png", light_field, found, known or (0.75 * reference, 2.0 * reference)
                )
            advance(done, len(names))
    say("epi", f"pictures and arrays (.npz) written to {options.out}")
    return 0
