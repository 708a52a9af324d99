"""`mirrorcam run`: the complete pipeline, from a design to a page of results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.bounds import SEED
from mirrorcam.core.console.options import AdapterOption, Force, Mounting, bounded
from mirrorcam.core.console.progress import print_metrics, say
from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.errors import InputError


def run(
    design: Annotated[
        Path | None, Parameter(name="DESIGN", help="design.toml or layout.json [default: 3 x 3 mirrors for a C920]")
    ] = None,
    /,
    *,
    quick: Annotated[bool, Parameter(help="smaller example in a minute: 2 x 2 mirrors, half the resolution")] = False,
    adapter: AdapterOption = "none",
    mounting: Mounting = "glue",
    seed: Annotated[int, bounded(SEED, "seed of poses, tolerances and noise")] = 0,
    out: Annotated[
        Path | None,
        Parameter(
            help="output folder; valid results in it are reused [default: output/default, with --quick output/quick]"
        ),
    ] = None,
    force: Force = False,
) -> int:
    """Run the complete pipeline, from a design to a light field, and write a page of results.

    Designs the mirrors, generates and checks all parts, renders frames of a device as built, calibrates it and
    decodes a light field; then writes metrics.json and index.html. Exit code 1: a figure exceeds its limit.

    Examples:
        mirrorcam run
        mirrorcam run --quick --seed 3
        mirrorcam run design.toml --adapter tripod --mounting screws --out output/mine
    """
    if quick and design is not None:
        raise InputError(f"--quick and {design}: expected at most one of the two")
    from mirrorcam.designs.design_files import read_request
    from mirrorcam.run.pipeline import full_recipe, quick_recipe, run_all

    recipe = quick_recipe(seed) if quick else full_recipe(seed)
    if design is not None:
        recipe = replace(recipe, spec=read_request(design).spec)
    recipe = replace(recipe, adapter=adapter, mounting=mounting)
    out = out or Path("output/quick" if quick else "output/default")
    options = f" {design.name}" if design else " --quick" if quick else ""
    options += "" if adapter == "none" else f" --adapter {adapter}"
    options += "" if mounting == "glue" else f" --mounting {mounting}"
    figures = run_all(recipe, out, f"mirrorcam run{options} --seed {seed}", TERMINAL, force=force)
    failed = {name: metric for name, metric in figures.parts.items() if not metric.passed}
    limited = {name: metric for name, metric in figures.validation.items() if metric.limit is not None}
    print_metrics({"measured": failed | limited})
    say("done", f"open {out / 'index.html'}")
    return 0 if figures.passed else 1
