"""Four specs of a sweep, and a runner that answers with made-up outcomes in no time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.processes.worker_pool import Died
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Metric
from mirrorcam.designs.design_sweep import Answer, Runner, file_text, sweep
from mirrorcam.optics.design.spec_grid import Outcome, grid
from mirrorcam.optics.geometry.design_spec import DesignSpec

SPECS = grid(
    DesignSpec(),
    counts=[(1, 2), (2, 1)],
    depth_sets_mm=[(300.0, 500.0)],
    scales_mm=[80.0],
    tradeoffs=[0.3, 0.6],
)


def sweep_into(
    specs: Sequence[DesignSpec], folder: Path, run: Runner, progress: Progress = no_progress
) -> list[Outcome]:
    """Sweep in a folder as the command does, without a table."""
    with output_folder(folder, "sweep") as output:
        return sweep(specs, output, run, progress)


class Counting:
    """A runner that answers with made-up outcomes, and remembers which specs it was asked for."""

    def __init__(self, outcome: Callable[[DesignSpec], Outcome] | None = None) -> None:
        self.asked: list[DesignSpec] = []
        self._outcome = outcome or (lambda spec: Outcome(spec=spec, status="infeasible", constraint="depth"))

    def __call__(self, specs: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        for number, spec in reversed(list(enumerate(specs))):
            self.asked.append(spec)
            layout = "{}" if (outcome := self._outcome(spec)).status == "solved" else ""
            yield number, Answer(file_text(outcome), layout)


def solved(spec: DesignSpec) -> Outcome:
    return Outcome(spec=spec, status="solved", metrics={"grid_error": Metric(value=spec.tradeoff, unit="")})
