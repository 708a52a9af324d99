"""One design of a sweep, as run by a worker: from a spec as text to its outcome and its layout as text."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module

from mirrorcam.core.disk.program import program_of
from mirrorcam.core.values import Value
from mirrorcam.optics.design.spec_grid import solve
from mirrorcam.optics.geometry.design_spec import DesignSpec

CODE = "mirrorcam.optics.design.spec_grid"

# MUMPS, IPOPT's linear solver, keeps its state in globals: two designs at once in one process crash.
_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Answer:
    """A worker's answer: the outcome and, if the spec was solved, the layout as JSON texts, and the `seconds` taken.

    `made_with` holds the versions of the worker's code and libraries.
    """

    outcome: str
    layout: str = ""
    made_with: Mapping[str, str] = field(default_factory=lambda: program_of(CODE))
    seconds: float = field(default=0.0, compare=False)


def answer(spec_json: str) -> Answer:
    """Design one spec; the time excludes loading the optimiser."""
    import_module("mirrorcam.optics.design.optimise")
    with _one_at_a_time:
        started = time.perf_counter()
        outcome, layout = solve(DesignSpec.model_validate_json(spec_json))
        seconds = time.perf_counter() - started
    return Answer(file_text(outcome), "" if layout is None else file_text(layout), seconds=seconds)


def file_text(value: Value) -> str:
    """The content of a value's file."""
    return value.model_dump_json(indent=1, by_alias=True, exclude_none=True) + "\n"
