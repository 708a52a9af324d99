"""One design of a sweep, as run by a worker: from a spec as text to the files to write as text."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from typing import Literal

from pydantic import Field

from mirrorcam.core.disk.fingerprint import digest, source_digests, versions
from mirrorcam.core.values import Value
from mirrorcam.optics.design.spec_grid import Outcome, solve
from mirrorcam.optics.geometry.design_spec import DesignSpec

# Packages of `optics` that no design depends on.
UNRELATED = ("alignment", "calibration", "camera_files", "drift", "light_field")

# MUMPS, IPOPT's linear solver, keeps its state in globals: two designs at once in one process crash.
_one_at_a_time = threading.Lock()


class Record(Value):
    """The file of one finished design: its outcome, its layout's sha256, and the versions that made it."""

    schema_id: Literal["mirrorcam.sweep/1"] = Field(default="mirrorcam.sweep/1", alias="schema")
    outcome: Outcome
    layout_sha256: str = ""
    made_with: dict[str, str]


@dataclass(frozen=True)
class Answer:
    """A worker's answer: the text of the record's file, of the layout's if the spec was solved, and the time taken."""

    record: str
    layout: str = ""
    seconds: float = field(default=0.0, compare=False)


@cache
def made_with() -> dict[str, str]:
    """Digests of the sources and versions of the distributions that decide about a design, in this process."""
    return source_digests("mirrorcam.core") | source_digests("mirrorcam.optics", without=UNRELATED) | versions()


def file_text(value: Value) -> str:
    """The text of a value's file."""
    return value.model_dump_json(indent=1, by_alias=True, exclude_none=True) + "\n"


def record_text(outcome: Outcome, layout: str = "") -> str:
    """The text of the record of an outcome, with the digest of its layout's text."""
    layout_sha256 = digest(layout.encode()) if layout else ""
    return file_text(Record(outcome=outcome, layout_sha256=layout_sha256, made_with=made_with()))


def answer(spec_json: str) -> Answer:
    """Design one spec; the time is that of the design, without that of loading the optimiser."""
    import_module("mirrorcam.optics.design.optimise")
    with _one_at_a_time:
        started = time.perf_counter()
        outcome, layout = solve(DesignSpec.model_validate_json(spec_json))
        seconds = time.perf_counter() - started
    text = file_text(layout) if layout is not None else ""
    return Answer(record_text(outcome, text), text, seconds)
