"""How suites scale: `python -m benchmarks.suite_scale [--sets 200] [--json FILE]`.

- weak scaling: one worker renders a number of small sets, two render twice as many, up to the number of cores.
  Efficiency is the time with one worker divided by that with all, in elapsed time, which other work on the machine
  lengthens, and in processor time per set;
- a cluster: a Dask scheduler with a worker per core renders small sets, and one worker is killed in the middle. All
  sets must exist, with the same bytes as rendered by processes without a cluster.

Exit code 1: a set is missing, or differs.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.bench.suite_run import (
    RenderedSuite,
    Workers,
    layouts_of,
    make_plan,
    render_suite,
    workers_here,
    workers_of,
)
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.processes.worker_pool import Died, cores
from mirrorcam.render_scenes.suites.set_work import SetResult
from mirrorcam.render_scenes.suites.suite import Suite
from mirrorcam.render_scenes.variant import choose_variant

SMALL: dict[str, Any] = {
    "name": "small",
    "binned": 0.125,
    "board": {"kind": "charuco", "cols": 8, "rows": 6, "square_mm": 30.0, "marker_mm": 22.5},
    "frames": 3,
    "base_frames": 1,
}
"""Sets of four pictures of 240 x 135 pixels via nine mirrors."""


@dataclass(frozen=True)
class Run:
    """A rendered suite, and the elapsed seconds without designs."""

    elapsed_s: float
    rendered: RenderedSuite

    @property
    def processor_s(self) -> float:
        """Mean processor seconds of a set."""
        return sum(self.rendered.seconds.values()) / max(len(self.rendered.seconds), 1)

    @property
    def digests(self) -> dict[str, str]:
        """Digests of each set's `dataset.json`, and so of all its files."""
        return {entry.name: entry.dataset_sha256 for entry in self.rendered.manifest.sets}


def small_sets(count: int) -> Suite:
    """Return a suite of a number of small sets, which differ in their seeds."""
    return Suite.model_validate({"name": "small", "version": 1, "set": [SMALL]}).times(count)


def render(suite: Suite, folder: Path, workers: Workers) -> Run:
    """Render the sets of a suite that a folder lacks."""
    with output_folder(folder, "suite") as output:
        plan = make_plan(suite, folder, choose_variant())
        layouts = layouts_of(plan, folder, workers.design)
        start_s = time.perf_counter()
        rendered = render_suite(plan, output, workers, layouts)
    return Run(time.perf_counter() - start_s, rendered)


def weak_scaling(folder: Path, per_worker: int) -> list[dict[str, Any]]:
    """Return rows of workers, sets, elapsed seconds, processor seconds per set, and efficiency."""
    rows: list[dict[str, Any]] = []
    for count in range(1, cores() + 1):
        run = render(small_sets(count * per_worker), folder / f"weak-{count}", workers_here(count))
        row = {"workers": count, "sets": count * per_worker, "elapsed_s": run.elapsed_s, "set_s": run.processor_s}
        first = rows[0] if rows else row
        row["efficiency_elapsed"] = first["elapsed_s"] / row["elapsed_s"]
        row["efficiency_processor"] = first["set_s"] / row["set_s"]
        rows.append(row)
        print(
            f"{count} workers, {row['sets']:.0f} sets: {row['elapsed_s']:.1f} s, {row['set_s']:.2f} processor s a set, "
            f"efficiency {row['efficiency_elapsed']:.2f} elapsed, {row['efficiency_processor']:.2f} in processor time",
            flush=True,
        )
    return rows


def on_cluster(suite: Suite, folder: Path) -> tuple[Run, int]:
    """Render a suite on a Dask cluster on this machine, kill a worker halfway, and count the killed workers."""
    from distributed import Client, LocalCluster

    killed = 0
    with (
        LocalCluster(n_workers=cores(), threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        workers = workers_of(cluster.scheduler_address)

        def with_a_kill(tasks: Sequence[str]) -> Iterator[tuple[int, SetResult | Died]]:
            nonlocal killed
            for done, answer in enumerate(workers.render(tasks)):
                if done == len(tasks) // 2:
                    first = min(client.run(os.getpid).values())
                    os.kill(first, signal.SIGKILL)
                    killed += 1
                    print(f"killed worker {first} after {done} of {len(tasks)} sets", flush=True)
                yield answer

        return render(suite, folder, replace(workers, render=with_a_kill)), killed


def scale(folder: Path, sets: int, per_worker: int) -> dict[str, Any]:
    """Return the figures of weak scaling and of the cluster."""
    figures: dict[str, Any] = {"cores": cores(), "weak_scaling": weak_scaling(folder, per_worker)}
    suite = small_sets(sets)
    clustered, killed = on_cluster(suite, folder / "cluster")
    # Goes on with the sets of weak scaling, which are the first of these.
    alone = render(suite, folder / f"weak-{cores()}", workers_here(cores()))
    same = [name for name, sha256 in alone.digests.items() if clustered.digests.get(name) == sha256]
    figures["cluster"] = {
        "sets": sets,
        "workers": cores(),
        "killed": killed,
        "there": len(clustered.digests),
        "same_bytes": len(same),
        "elapsed_s": clustered.elapsed_s,
        "set_s": clustered.processor_s,
        "missing": clustered.rendered.failures,
    }
    row = figures["cluster"]
    print("cluster: {there} of {sets} sets there, {same_bytes} with the bytes of one without a cluster,".format(**row))
    print("{killed} worker killed, {elapsed_s:.0f} s, {set_s:.2f} processor s a set".format(**row), flush=True)
    return figures


def scale_table(figures: dict[str, Any]) -> Table:
    """Return the measurements of small sets, in the words of docs/suites.md."""
    first, last = figures["weak_scaling"][0], figures["weak_scaling"][-1]
    row = figures["cluster"]
    killed = f"{count_text(row['killed'], 'worker')} killed after {row['sets'] // 2}"
    weak = (
        f"one worker: {first['set_s']:.2f} processor seconds a set; {last['workers']}: {last['set_s']:.2f} "
        f"(efficiency {last['efficiency_processor']:.2f}; by the clock {last['efficiency_elapsed']:.2f})"
    )
    there = f"{row['there']} there, with every checksum; {row['elapsed_s']:.0f} s"
    missing = "".join(f"; {name}: {reason}" for name, reason in row["missing"].items())
    return table(
        ("small sets, of four pictures of 240 x 135 px, with the default tolerances", "measured"),
        [
            (f"weak scaling, {first['sets']} sets a worker", weak),
            (f"{row['sets']} sets on a Dask cluster of {row['workers']} workers, {killed}", there + missing),
            ("of these, with the same bytes as rendered without a cluster", f"{row['same_bytes']} of {row['sets']}"),
        ],
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=200, help="sets of the cluster")
    parser.add_argument("--per-worker", type=int, default=20, help="sets of a worker in weak scaling")
    add_json_option(parser)
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        scaled = scale(Path(folder), options.sets, options.per_worker)
    measured = scale_table(scaled)
    print(measured.markdown())
    row = scaled["cluster"]
    write_record(options.json, "suite_scale", {name: row[name] for name in ("elapsed_s", "set_s")}, measured)
    return int(row["same_bytes"] < options.sets or not row["killed"])


if __name__ == "__main__":
    sys.exit(main())
