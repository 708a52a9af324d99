"""`mirrorcam run`: the whole pipeline, from a design to a page of results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.commands.option_texts import FORCE
from mirrorcam.console.progress import print_metrics, say
from mirrorcam.console.reporter import TERMINAL
from mirrorcam.optics.base.bounds import SEED
from mirrorcam.optics.base.values import Value


class RunOptions(Value):
    """Run the whole pipeline: design, parts, synthetic frames, blind calibration, light field and a page of results."""

    out: Annotated[
        Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="(output/default or output/quick)")
    ] = Field(
        default=None, description="folder for all results; those of an earlier run that are still valid are re-used"
    )
    force: bool = FORCE
    quick: bool = Field(default=False, description="smaller example in about a minute: 2 x 2 mirrors, half resolution")
    seed: int = SEED.field(0, "seed of poses, tolerances and noise")


def run(options: RunOptions) -> int:
    """Run the pipeline."""
    from mirrorcam.workflow.pipeline import full_recipe, quick_recipe, run_all

    recipe = quick_recipe(options.seed) if options.quick else full_recipe(options.seed)
    out = options.out or Path("output/quick" if options.quick else "output/default")
    command = f"mirrorcam run{' --quick' if options.quick else ''} --seed {options.seed}"
    figures = run_all(recipe, out, command, TERMINAL, force=options.force)
    failed = {name: metric for name, metric in figures.parts.items() if not metric.passed}
    limited = {name: metric for name, metric in figures.validation.items() if metric.limit is not None}
    print_metrics({"measured": failed | limited})
    say("done", f"open {out / 'index.html'}")
    return 0 if figures.passed else 1
