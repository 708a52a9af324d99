"""Solved designs for every count, scale and trade-off of a grid, for the studio without a server."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from mirrorcam.core.processes.worker_pool import Died, run_local
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import RefusedDesign, SolvedDesign


@dataclass(frozen=True)
class AtlasGrid:
    """The values of an atlas, which contains a design for every combination."""

    rows: tuple[int, ...] = (1, 2, 3, 4, 5)
    cols: tuple[int, ...] = (1, 2, 3, 4, 5)
    scales_mm: tuple[float, ...] = (40.0, 60.0, 80.0, 120.0)
    tradeoffs: tuple[float, ...] = (0.1, 0.3, 0.6)

    def specs(self, common: DesignSpec) -> list[DesignSpec]:
        """Return the requests, except for a single mirror."""
        return [
            common.replaced(rows=rows, cols=cols, scale_mm=scale_mm, tradeoff=tradeoff)
            for rows, cols, scale_mm, tradeoff in product(self.rows, self.cols, self.scales_mm, self.tradeoffs)
            if rows * cols > 1
        ]

    @property
    def axes(self) -> dict[str, list[float]]:
        """The values of each field of the request, by its name."""
        return {
            "rows": [*map(float, self.rows)],
            "cols": [*map(float, self.cols)],
            "scale_mm": [*self.scales_mm],
            "tradeoff": [*self.tradeoffs],
        }


def key_of(spec: DesignSpec) -> str:
    """Return the key of a request in an atlas."""
    return ",".join(f"{getattr(spec, name):g}" for name in AtlasGrid().axes)


def atlas(common: DesignSpec, grid: AtlasGrid, *, workers: int, progress: Progress = no_progress) -> dict[str, Any]:
    """Return the drawings of all designs of a grid as JSON values, by the keys of their requests.

    All other fields of the requests are those of `common`. A drawing has no request, which its key contains. Raises
    RuntimeError if the processes that solve a design die.
    """
    specs = grid.specs(common)
    designs: dict[str, Any] = {}
    for number, result in sorted(_solved(specs, workers, progress)):
        spec = specs[number]
        if isinstance(result, RefusedDesign):
            designs[key_of(spec)] = {"constraint": result.constraint, "finding": result.finding}
            continue
        designs[key_of(spec)] = result.drawing.model_dump(mode="json", exclude={"spec"})
    return {"axes": grid.axes, "designs": designs}


def _solved(
    specs: Sequence[DesignSpec], workers: int, progress: Progress
) -> Iterator[tuple[int, SolvedDesign | RefusedDesign]]:
    """Yield the index of each request and its result, as it is solved."""
    answers = run_local(specs, workers, design_work.solve, preload=design_work.PRELOAD)
    for done, (number, result) in enumerate(answers, 1):
        if isinstance(result, Died):
            raise RuntimeError(f"{key_of(specs[number])}: {result.reason}")
        progress(done, len(specs))
        yield number, result
