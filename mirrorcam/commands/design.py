"""`mirrorcam design`: from what is asked for to a layout."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.progress import long_work, print_metrics, say
from optics.spec import DesignSpec
from optics.values import Value


class DesignOptions(Value):
    """Optimise a layout of mirrors and compare it with the faceted parabola."""

    spec: Annotated[DesignSpec, tyro.conf.OmitArgPrefixes] = Field(default_factory=DesignSpec)
    out: Path = Field(
        default=Path("output/design"), description="folder for layout.json, parabola.json and before_after.png"
    )


def write_design(spec: DesignSpec, out: Path) -> None:
    """Write layout.json (optimised), parabola.json (where the optimiser starts from) and before_after.png into `out`.

    Raises InfeasibleDesign, before anything is written, when no layout meets the spec.
    """
    from mirrorcam.figures.design import before_after
    from optics.design.metrics import evaluate
    from optics.design.optimise import design
    from optics.design.seeds import faceted_parabola

    optimised = design(spec)
    parabola = faceted_parabola(spec)
    parabola = parabola.replaced(spec=spec, metrics=evaluate(parabola, spec.depths_mm))
    before_after(parabola, optimised, out / "before_after.png")
    parabola.save(out / "parabola.json")
    optimised.save(out / "layout.json")


def run(options: DesignOptions) -> int:
    """Design, and print the figures beside those of the parabola."""
    from optics.layout import Layout

    with long_work("design", f"{options.spec.rows} x {options.spec.cols} mirrors"):
        write_design(options.spec, options.out)
    print_metrics(
        {
            "parabola": Layout.load(options.out / "parabola.json").metrics,
            "optimised": Layout.load(options.out / "layout.json").metrics,
        }
    )
    say("design", f"{options.out / 'layout.json'} and {options.out / 'before_after.png'} written")
    return 0
