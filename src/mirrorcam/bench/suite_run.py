"""Render a suite: list finished and missing sets and their cost, then solve the designs and render the sets.

One worker renders a complete set: planning and ground truth take time too, and no two processes share a folder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from mirrorcam import DesignSpec, Layout
from mirrorcam.bench.suite_folder import (
    DESIGNS,
    SETS,
    SUFFIX,
    State,
    SuiteManifest,
    SuiteSet,
    put_files,
    state_of,
)
from mirrorcam.bench.suite_store import Store, fetch_set, is_stored
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.disk.fingerprint import differing_keys, file_digest
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died, run_local
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.designs.design_sweep import Runner, layout_name, sweep
from mirrorcam.designs.sweep_files import design_locally, design_on_cluster
from mirrorcam.render_scenes.sets.dataset import MANIFEST
from mirrorcam.render_scenes.suites.recipe import SetRecipe
from mirrorcam.render_scenes.suites.set_work import (
    CODE,
    SetResult,
    SetTask,
    folder_name,
    render_in_turn,
    render_on_one_core,
)
from mirrorcam.render_scenes.suites.suite import Cost, Suite, set_cost

SetRunner = Callable[[Sequence[str]], Iterator[tuple[int, SetResult | Died]]]
MAX_ANSWER_BYTES = 1_000_000_000
"""Maximum size of a set that a worker of a cluster sends back."""


@dataclass(frozen=True)
class Workers:
    """Runners of designs and renderings: on this machine, where each writes its set's folder, or on a cluster."""

    design: Runner
    render: SetRunner
    share_the_folder: bool


def workers_here(count: int) -> Workers:
    """Return runners in processes on this machine, each on one core."""
    return Workers(
        partial(design_locally, workers=count),
        partial(run_local, workers=count, work=render_on_one_core),
        share_the_folder=True,
    )


def workers_of(address: str) -> Workers:
    """Return runners on the workers of a Dask scheduler, which need no shared disk."""
    return Workers(
        partial(design_on_cluster, address=address),
        partial(run_cluster, address=address, work=render_in_turn),
        share_the_folder=False,
    )


@dataclass(frozen=True)
class PlannedSet:
    """A set of a suite: its folder, state and cost."""

    recipe: SetRecipe
    folder: Path
    state: State
    cost: Cost


@dataclass(frozen=True)
class Plan:
    """The sets of a suite in a folder, with their states."""

    suite: Suite
    variant: str
    sets: tuple[PlannedSet, ...]

    @property
    def unfinished(self) -> tuple[PlannedSet, ...]:
        """The sets to render."""
        return tuple(entry for entry in self.sets if entry.state in ("begun", "missing"))

    @property
    def specs(self) -> tuple[DesignSpec, ...]:
        """The distinct designs of the unfinished sets."""
        specs = (entry.recipe.spec for entry in self.unfinished)
        return tuple(dict.fromkeys(spec for spec in specs if spec is not None))


def make_plan(suite: Suite, folder: Path, variant: str, store: Store | None = None) -> Plan:
    """Look for the sets of a suite in a folder and, if missing, in a store.

    Raises InputError if a set's folder contains something else, or a set that has changed since it was written.
    """
    sets = []
    for recipe in suite.sets:
        path = folder / SETS / folder_name(recipe, variant)
        state = state_of(path)
        if store is not None and state != "finished" and is_stored(store, path):
            state = "stored"
        sets.append(PlannedSet(recipe, path, state, set_cost(recipe)))
    return Plan(suite, variant, tuple(sets))


def fetch_stored(plan: Plan, store: Store, progress: Progress = no_progress) -> Plan:
    """Download the stored sets of a plan, and return the plan with these sets finished."""
    queued = [entry for entry in plan.sets if entry.state == "stored"]
    for done, entry in enumerate(queued):
        progress(done, len(queued))
        fetch_set(store, entry.recipe, entry.folder)
    progress(len(queued), len(queued))
    sets = (replace(entry, state="finished") if entry.state == "stored" else entry for entry in plan.sets)
    return replace(plan, sets=tuple(sets))


@dataclass(frozen=True)
class RenderedSuite:
    """A suite's manifest, its file, and, by set name, the reasons for missing sets and the seconds for the others."""

    manifest: SuiteManifest
    path: Path
    failures: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


def layouts_of(plan: Plan, folder: Path, run: Runner, progress: Progress = no_progress) -> dict[DesignSpec, Layout]:
    """Return the layouts of the designs of a plan's unfinished sets; solve those missing in the folder.

    Raises InputError if a design has no solution.
    """
    specs = plan.specs
    with output_folder(folder / DESIGNS, "suite") as designs:
        outcomes = sweep(specs, designs, run, progress)
    for outcome in outcomes:
        if outcome.status != "solved":
            name = next(entry.recipe.name for entry in plan.unfinished if entry.recipe.spec == outcome.spec)
            raise InputError(f"set {name}: design {outcome.status}: {outcome.constraint} {outcome.finding}")
    return {spec: Layout.load(folder / DESIGNS / layout_name(spec)) for spec in specs}


def render_suite(
    plan: Plan,
    output: OutputFolder,
    workers: Workers,
    layouts: Mapping[DesignSpec, Layout],
    progress: Progress = no_progress,
) -> RenderedSuite:
    """Render the unfinished sets of a plan, and write the manifest of the suite.

    Parameters
    ----------
    plan
        The plan, from `make_plan`.
    output
        The folder, locked by the caller.
    workers
        The workers that render the sets.
    layouts
        The layout of each design of the plan.
    progress
        Called with the number of sets done and their total.

    Raises
    ------
    InputError
        Before any set is rendered, if one is too large to be sent, or the manifest would replace a foreign file.
    """
    name = f"{plan.suite.name}{SUFFIX}"
    output.grouped(name).refuse_others(name)
    if not workers.share_the_folder:
        _refuse_large(plan)
    # Long sets first, so that all workers finish at about the same time.
    queued = sorted(plan.unfinished, key=lambda entry: -entry.cost.seconds)
    failures, seconds = _render_sets(queued, layouts, plan.variant, workers, progress)
    manifest = _manifest(plan, failures)
    with output.grouped(name).staged() as staged:
        write_text(staged / name, manifest.text)
    return RenderedSuite(manifest, output.path / name, failures, seconds)


def _refuse_large(plan: Plan) -> None:
    for entry in plan.unfinished:
        if entry.cost.stored_bytes > MAX_ANSWER_BYTES:
            size = f"{entry.cost.stored_bytes / 1e9:.1f} GB"
            raise InputError(
                f"set {entry.recipe.name}: takes about {size}, expected at most 1 GB from a worker of --scheduler: "
                "fewer frames, or maps = false"
            )


def _render_sets(
    queued: Sequence[PlannedSet],
    layouts: Mapping[DesignSpec, Layout],
    variant: str,
    workers: Workers,
    progress: Progress,
) -> tuple[dict[str, str], dict[str, float]]:
    """Return, by set name, the reasons for failures, and the seconds for the other sets."""
    tasks = [
        SetTask(
            recipe=entry.recipe,
            designed=None if entry.recipe.spec is None else layouts[entry.recipe.spec],
            variant=variant,
            folder=entry.folder.absolute() if workers.share_the_folder else None,
        ).model_dump_json()
        for entry in queued
    ]
    failures: dict[str, str] = {}
    seconds: dict[str, float] = {}
    progress(0, len(queued))
    for done, (number, result) in enumerate(workers.render(tasks), 1):
        entry = queued[number]
        failure = result.reason if isinstance(result, Died) else result.failure
        if isinstance(result, SetResult) and not failure:
            failure = _store(entry, result)
            seconds[entry.recipe.name] = result.seconds
        if failure:
            failures[entry.recipe.name] = shortened(failure)
        progress(done, len(queued))
    return failures, seconds


def _store(entry: PlannedSet, result: SetResult) -> str:
    """Move the files of a result into place; return the reason for a failure, or an empty string."""
    if other := differing_keys(result.made_with, program_of(*CODE)):
        return f"{other[0]} of a worker differs from this machine's, expected the same everywhere"
    try:
        if result.files:
            put_files(entry.folder, dict(result.files))
    except InputError as error:
        return str(error)
    return ""


def _manifest(plan: Plan, failures: dict[str, str]) -> SuiteManifest:
    suite = plan.suite
    return SuiteManifest(
        name=suite.name,
        version=suite.version,
        description=suite.description,
        renderer=plan.variant,
        made_with=program_of(*CODE),
        sets=tuple(
            SuiteSet(
                name=entry.recipe.name,
                folder=f"{SETS}/{entry.folder.name}",
                dataset_sha256=file_digest(entry.folder / MANIFEST),
                why=entry.recipe.why,
            )
            for entry in plan.sets
            if entry.recipe.name not in failures
        ),
        missing=tuple(entry.recipe.name for entry in plan.sets if entry.recipe.name in failures),
    )
