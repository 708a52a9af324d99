"""A small suite, whose sets are made in a second each, and workers that are this process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from mirrorcam.bench.suite_run import RenderedSuite, Workers, make_plan, render_suite
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.designs.sweep_files import design_locally
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.set_work import SetResult, render_on_one_core
from mirrorcam.render_scenes.suites.suite import Suite
from mirrorcam.render_scenes.variant import choose_variant
from tests.small_set import BOARD

SEEDS = {"one": 5, "two": 6}


def small_suite(layout: Layout, name: str = "small", **stated: object) -> Suite:
    """Two sets of three frames and a base frame with a layout before a sensor of 240 x 135 pixels."""
    common = {"layout": layout, "binned": 0.125, "board": BOARD, "frames": 3, "base_frames": 1, **stated}
    return Suite.model_validate(
        {"name": name, "version": 1, "defaults": common, "set": [{"name": n, "seed": s} for n, s in SEEDS.items()]}
    )


def here(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult]]:
    """Sets as this process renders them, one after the other."""
    for number, task in enumerate(tasks):
        yield number, render_on_one_core(task)


def workers(*, share_the_folder: bool = True) -> Workers:
    """This process."""
    return Workers(lambda specs: design_locally(specs, 1), here, share_the_folder)


def rendered_into(folder: Path, suite: Suite, by: Workers | None = None) -> RenderedSuite:
    """Render what is missing of a suite whose sets have layouts."""
    with output_folder(folder, "suite") as output:
        return render_suite(make_plan(suite, folder, choose_variant()), output, by or workers(), {})
