"""`mirrorcam design`: from what is asked for to a layout."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.console.progress import long_work, print_metrics, say
from mirrorcam.optics.base.values import InputError, Value
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.tolerances import Tolerances

GROUPS = {
    "what the views share": ("grid_error", "pixel_efficiency", "overlap_iou", "fov", "depth_nearest", "depth_farthest"),
    "what tells depth": ("baseline", "disparity", "depth_resolution"),
    "mirrors": ("shortest", "longest", "smallest", "largest", "slab"),
}
"""Titles of the groups of the table, each with how the names of its figures begin."""


class DesignOptions(Value):
    """Optimise a layout of mirrors and compare it with the faceted parabola."""

    spec: Annotated[DesignSpec, tyro.conf.OmitArgPrefixes] = Field(default_factory=DesignSpec)
    tolerance: bool = Field(
        default=False,
        description="draw devices as built with the tolerances below, too: tolerance.json and tolerance.png in the "
        "folder say what to expect of them",
    )
    tolerances: Annotated[Tolerances, tyro.conf.OmitArgPrefixes] = Field(default_factory=Tolerances.hobby)
    out: Path = Field(
        default=Path("output/design"), description="folder for layout.json, parabola.json and before_after.png"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.tolerance and self.tolerances != Tolerances.hobby():
            raise ValueError("tolerances are given, expected --tolerance with them")
        return self


def write_design(spec: DesignSpec, out: Path) -> str:
    """Write layout.json (optimised), parabola.json (where the optimiser starts from) and before_after.png into `out`.

    Some specs have no faceted parabola: then there is no parabola.json, and what is returned says why (else "").
    Raises InfeasibleDesign, before anything is written, when no layout meets the spec.
    """
    from mirrorcam.figures.design_figure import before_after
    from mirrorcam.optics.design.assess.layout_metrics import evaluate
    from mirrorcam.optics.design.assess.verify import verify
    from mirrorcam.optics.design.optimise import design
    from mirrorcam.optics.design.program.seeds import faceted_parabola

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
    from mirrorcam.optics.geometry.layout import Layout

    with long_work("design", f"{options.spec.rows} x {options.spec.cols} mirrors"):
        missing = write_design(options.spec, options.out)
    columns = {} if missing else {"parabola": Layout.load(options.out / "parabola.json")}
    columns["optimised"] = Layout.load(options.out / "layout.json")
    print_metrics({name: layout.metrics for name, layout in columns.items()}, GROUPS)
    print_metrics({name: layout.verdict for name, layout in columns.items()}, {"verdict": ("",)})
    if missing:
        say("design", f"no faceted parabola to compare with: {missing}")
    say("design", f"{options.out / 'layout.json'} and {options.out / 'before_after.png'} written")
    for name in ("tolerance.json", "tolerance.png"):
        (options.out / name).unlink(missing_ok=True)  # of an earlier layout
    if options.tolerance:
        from mirrorcam.workflow.tolerance import print_tolerance, write_tolerance

        with long_work("tolerance", "devices as built"):
            study = write_tolerance(columns["optimised"], options.tolerances, options.out)
        print_tolerance(study)
        say("tolerance", f"{options.out / 'tolerance.json'} and {options.out / 'tolerance.png'} written")
    return 0
