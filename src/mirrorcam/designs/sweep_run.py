"""Runners of a sweep's designs: processes on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Generator, Sequence

from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died, Work, run_local
from mirrorcam.designs.sweep_work import Answer, answer
from mirrorcam.optics.design.spec_grid import structure
from mirrorcam.optics.geometry.design_spec import DesignSpec


def in_order(specs: Sequence[DesignSpec]) -> list[list[int]]:
    """Group the numbers of specs by structure: the problem that is built for one spec of a group serves the next.

    Arrays of many mirrors come first, so that no core is left alone with one at the end.
    """
    groups: dict[tuple[int, int, int, int, str], list[int]] = {}
    for number, spec in enumerate(specs):
        groups.setdefault(structure(spec), []).append(number)
    return sorted(groups.values(), key=lambda group: -specs[group[0]].rows * specs[group[0]].cols)


def design_here(
    specs: Sequence[DesignSpec], workers: int, work: Work[str, Answer] = answer
) -> Generator[tuple[int, Answer | Died], None, None]:
    """Yield number and answer of each spec as it is finished by processes of this machine."""
    yield from run_local([spec.model_dump_json() for spec in specs], workers, work, in_order(specs))


def design_on_cluster(
    specs: Sequence[DesignSpec], address: str, work: Work[str, Answer] = answer
) -> Generator[tuple[int, Answer | Died], None, None]:
    """Yield number and answer of each spec as it is finished by the workers of the scheduler at `address`."""
    order = [number for group in in_order(specs) for number in group]
    for place, got in run_cluster([specs[number].model_dump_json() for number in order], address, work):
        yield order[place], got
