"""`mirrorcam design`: from what is asked for to a layout."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.progress import long_work, print_metrics, say
from optics.spec import DesignSpec
from optics.values import InputError, Value

GROUPS = {
    "what the views share": ("grid_error", "pixel_efficiency", "overlap_iou", "fov", "depth_nearest", "depth_farthest"),
    "what tells depth": ("baseline", "disparity", "depth_resolution"),
    "mirrors": ("shortest", "longest", "smallest", "largest", "slab"),
}
"""Titles of the groups of the table, each with how the names of its figures begin."""


class DesignOptions(Value):
    """Optimise a layout of mirrors and compare it with the faceted parabola."""

    spec: Annotated[DesignSpec, tyro.conf.OmitArgPrefixes] = Field(default_factory=DesignSpec)
    out: Path = Field(
        default=Path("output/design"), description="folder for layout.json, parabola.json and before_after.png"
    )


def write_design(spec: DesignSpec, out: Path) -> str:
    """Write layout.json (optimised), parabola.json (where the optimiser starts from) and before_after.png into `out`.

    Some specs have no faceted parabola: then there is no parabola.json, and what is returned says why (else "").
    Raises InfeasibleDesign, before anything is written, when no layout meets the spec.
    """
    from mirrorcam.figures.design import before_after
    from optics.design.metrics import evaluate
    from optics.design.optimise import design
    from optics.design.seeds import faceted_parabola
    from optics.design.verify import verify

    optimised = design(spec)
    try:
        parabola = faceted_parabola(spec)
        parabola = parabola.replaced(
            spec=spec, metrics=evaluate(parabola, spec.depths_mm), verdict=verify(parabola, spec)
        )
        missing = ""
    except InputError as error:
        parabola, missing = None, str(error)
    before_after(parabola, optimised, out / "before_after.png")
    if parabola is None:
        (out / "parabola.json").unlink(missing_ok=True)
    else:
        parabola.save(out / "parabola.json")
    optimised.save(out / "layout.json")
    return missing


def run(options: DesignOptions) -> int:
    """Design, and print the figures beside those of the parabola, then what was checked and its limits."""
    from optics.layout import Layout

    with long_work("design", f"{options.spec.rows} x {options.spec.cols} mirrors"):
        missing = write_design(options.spec, options.out)
    columns = {} if missing else {"parabola": Layout.load(options.out / "parabola.json")}
    columns["optimised"] = Layout.load(options.out / "layout.json")
    print_metrics({name: layout.metrics for name, layout in columns.items()}, GROUPS)
    print_metrics({name: layout.verdict for name, layout in columns.items()}, {"verdict": ("",)})
    if missing:
        say("design", f"no faceted parabola to compare with: {missing}")
    say("design", f"{options.out / 'layout.json'} and {options.out / 'before_after.png'} written")
    return 0
