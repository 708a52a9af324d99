"""`mirrorcam suite`: render a named list of sets; list the work beforehand, and reuse finished sets."""

from __future__ import annotations

from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mirrorcam.core.bounds import PICTURES
from mirrorcam.core.console.options import Scheduler, Workers, bounded, check_executor
from mirrorcam.core.console.progress import long_work, print_table, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.progress import no_progress
from mirrorcam.core.values import InvalidValue

if TYPE_CHECKING:
    from mirrorcam.bench.suite_run import Plan
    from mirrorcam.bench.suite_run import Workers as Renderers
    from mirrorcam.bench.suite_store import Store
    from mirrorcam.core.disk.output_folder import OutputFolder
    from mirrorcam.render_scenes.suites.suite import Suite

COPIES = PICTURES.narrowed(min=1)


def suite(
    name: Annotated[
        str | None,
        Parameter(
            name="NAME|FILE", help="smoke, standard, or a TOML file of a suite. [default: list the built-in suites]"
        ),
    ] = None,
    /,
    *,
    copies: Annotated[int, bounded(COPIES, "number of copies of each set, which differ only in their seeds")] = 1,
    plan: Annotated[
        bool, Parameter(help="render nothing; list the sets, their states, and the cost of the unfinished ones")
    ] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    fetch: Annotated[
        str | None,
        Parameter(metavar="URL", help="copy sets from a folder, s3://bucket/prefix, ..., instead of rendering"),
    ] = None,
    publish: Annotated[
        str | None,
        Parameter(metavar="URL", help="copy the rendered suite to this address; existing sets are kept"),
    ] = None,
    out: Annotated[
        Path,
        Parameter(help="folder for the sets and manifests of suites, shared by them; an interrupted suite is resumed"),
    ] = Path("output/suites"),
) -> int:
    """Render the sets of a suite: many cameras, boards and hard cases.

    Finished sets are kept. Without a name, list the built-in suites. Exit code 1: a set could not be rendered.

    Examples:
        mirrorcam suite
        mirrorcam suite standard --plan
        mirrorcam suite smoke --out suites
    """
    check_executor(workers, scheduler)
    if name is None:
        if plan:
            raise InputError("--plan: expected the name of a suite, or a .toml file")
        return show_suites()
    chosen = read_copies(name, copies)
    require("render", *(["cluster"] if scheduler is not None else []))
    from mirrorcam.bench.suite_run import make_plan, workers_here, workers_of
    from mirrorcam.bench.suite_store import Store
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.render_scenes.variant import choose_variant

    count = None if scheduler is not None else workers or cores()
    source = None if fetch is None else Store(fetch)
    target = None if publish is None else Store(publish)
    if plan:
        chosen_plan = make_plan(chosen, out, choose_variant(), source)
        print_table(("set", "mirrors", "camera", "pictures", "MB", "s", ""), plan_rows(chosen_plan))
        say("suite", plan_text(chosen_plan, count))
        return 0
    renderers = workers_here(count) if count is not None else workers_of(f"{scheduler}")
    workers_text = f"the workers of {scheduler}" if count is None else count_text(count, "worker")
    with output_folder(out, "suite") as output:
        chosen_plan = make_plan(chosen, out, choose_variant(), source)
        say("suite", plan_text(chosen_plan, count))
        return render_planned(chosen_plan, output, renderers, workers_text, source, target)


def render_planned(
    plan: Plan, output: OutputFolder, workers: Renderers, workers_text: str, source: Store | None, target: Store | None
) -> int:
    """Fetch, design and render the missing sets, and publish the suite; returns 1 if a set is still missing."""
    from mirrorcam.bench.suite_run import fetch_stored, layouts_of, render_suite
    from mirrorcam.bench.suite_store import publish

    if source is not None:
        with long_work("fetch", source.url, "sets") as advance:
            plan = fetch_stored(plan, source, advance)
    layouts = {}
    if plan.specs:
        with long_work("design", f"{count_text(len(plan.specs), 'design')}, {workers_text}", "designs") as advance:
            layouts = layouts_of(plan, output.path, workers.design, advance)
    progress = long_work("render", f"{count_text(len(plan.unfinished), 'set')}, {workers_text}", "sets")
    with progress if plan.unfinished else nullcontext(no_progress) as advance:
        rendered = render_suite(plan, output, workers, layouts, advance)
    for name, failure in rendered.failures.items():
        say("suite", f"{name} is missing: {failure}")
    say("suite", f"{rendered.path} written: {count_text(len(rendered.manifest.sets), 'set')}")
    if target is not None:
        with long_work("publish", target.url, "sets") as advance:
            copied = publish(rendered.manifest, output.path, target, advance)
        say("publish", f"{count_text(copied, 'set')} copied, {len(rendered.manifest.sets) - copied} already there")
    return 1 if rendered.failures else 0


def read_copies(name: str, copies: int) -> Suite:
    """Read a suite by name or file, with copies of each set; raises InputError for too many copies."""
    from mirrorcam.render_scenes.suites.suite import read_suite

    suite = read_suite(name)
    try:
        return suite.times(copies)
    except InvalidValue as error:
        raise InputError(f"--copies {copies}: {error}") from None


def show_suites() -> int:
    """Print the built-in suites."""
    from mirrorcam.render_scenes.suites.suite import read_suite, suite_names

    suites = [read_suite(name) for name in suite_names()]
    rows = [
        (
            suite.name,
            str(suite.version),
            str(sum(recipe.copies for recipe in suite.recipes)),
            str(sum(recipe.copies * recipe.pictures for recipe in suite.recipes)),
            suite.description,
        )
        for suite in suites
    ]
    print_table(("suite", "version", "sets", "pictures", ""), rows)
    return 0


def plan_rows(plan: Plan) -> list[tuple[str, ...]]:
    """Return a row for each set: name, mirrors, camera, pictures, MB, processor seconds, state."""
    return [
        (
            entry.recipe.name,
            str(entry.recipe.mirrors),
            entry.recipe.camera.name,
            str(entry.cost.pictures),
            f"{entry.cost.stored_bytes / 1e6:.0f}",
            f"{entry.cost.seconds:.0f}",
            entry.state,
        )
        for entry in plan.sets
    ]


def plan_text(plan: Plan, workers: int | None) -> str:
    """State the cost of a suite: sets, pictures, size, and time on this machine's workers, or on one cluster core."""
    from mirrorcam.render_scenes.suites.suite import design_seconds, elapsed_s, slowness

    suite, missing = plan.suite, plan.unfinished
    states = Counter(entry.state for entry in plan.sets)
    states_text = ", ".join(f"{states[state]} {state}" for state in ("finished", "stored") if states[state])
    total = f"{suite.name} {suite.version}: {count_text(len(plan.sets), 'set')}{states_text and f', {states_text}'}"
    if not missing:
        return total
    pictures = sum(entry.cost.pictures for entry in missing)
    size = sum(entry.cost.stored_bytes for entry in missing)
    designs, sets = [design_seconds(spec) for spec in plan.specs], [entry.cost.seconds for entry in missing]
    factor = slowness()
    if workers is None:
        time = f"{time_text(factor * (sum(designs) + sum(sets)))} of a core like this machine's"
    else:
        time = time_text(elapsed_s(designs, workers, factor) + elapsed_s(sets, workers, factor))
    return f"{total}; to render: {pictures} pictures, about {size_text(size)} and {time}"


def size_text(size: float) -> str:
    """Format a number of bytes: 3 MB, 1.2 GB."""
    for unit, unit_bytes in (("TB", 1e12), ("GB", 1e9)):
        if size >= unit_bytes:
            return f"{size / unit_bytes:.1f} {unit}"
    return f"{size / 1e6:.0f} MB"


def time_text(seconds: float) -> str:
    """Format a duration: 40 s, 12 min, 5 h."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
