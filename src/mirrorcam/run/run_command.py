"""`mirrorcam run`: the whole pipeline, from a design to a page of results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import SEED
from mirrorcam.core.console.option_texts import ADAPTER_TEXT, FORCE, MIRRORS_TEXT, AdapterKind
from mirrorcam.core.console.progress import print_metrics, say
from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.values import Value


class RunOptions(Value):
    """Run the whole pipeline: design, parts, synthetic frames, blind calibration, light field and a page of results."""

    design: tyro.conf.Positional[
        Annotated[Path | None, tyro.conf.arg(metavar="[design.toml|layout.json]", help_behavior_hint="")]
    ] = Field(default=None, description="what to design, as `mirrorcam studio` saves it; without, 3 x 3 for a C920")
    out: Annotated[
        Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="(output/default or output/quick)")
    ] = Field(
        default=None, description="folder for all results; those of an earlier run that are still valid are re-used"
    )
    force: bool = FORCE
    quick: bool = Field(default=False, description="smaller example in about a minute: 2 x 2 mirrors, half resolution")
    adapter: Annotated[AdapterKind, tyro.conf.arg(metavar="KIND")] = Field(default="none", description=ADAPTER_TEXT)
    mirrors: Annotated[Literal["glue", "screws"], tyro.conf.arg(metavar="glue|screws")] = Field(
        default="glue", description=MIRRORS_TEXT
    )
    seed: int = SEED.field(0, "seed of poses, tolerances and noise")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.quick and self.design is not None:
            raise ValueError(f"--quick and {self.design}: expected one of the two")
        return self


def run(options: RunOptions) -> int:
    """Run the pipeline."""
    from mirrorcam.designs.design_request import read_request
    from mirrorcam.run.pipeline import full_recipe, quick_recipe, run_all

    recipe = quick_recipe(options.seed) if options.quick else full_recipe(options.seed)
    if options.design is not None:
        recipe = replace(recipe, spec=read_request(options.design))
    recipe = replace(recipe, adapter=options.adapter, mirrors=options.mirrors)
    out = options.out or Path("output/quick" if options.quick else "output/default")
    design = f" {options.design.name}" if options.design else ""
    carried = "" if options.adapter == "none" else f" --adapter {options.adapter}"
    carried += "" if options.mirrors == "glue" else f" --mirrors {options.mirrors}"
    command = f"mirrorcam run{design}{' --quick' if options.quick else ''}{carried} --seed {options.seed}"
    figures = run_all(recipe, out, command, TERMINAL, force=options.force)
    failed = {name: metric for name, metric in figures.parts.items() if not metric.passed}
    limited = {name: metric for name, metric in figures.validation.items() if metric.limit is not None}
    print_metrics({"measured": failed | limited})
    say("done", f"open {out / 'index.html'}")
    return 0 if figures.passed else 1
