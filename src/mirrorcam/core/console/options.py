"""Options that commands share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, Token

from mirrorcam.core.bounds import WORKERS, Bounds
from mirrorcam.core.errors import InputError


def _integer(_: object, tokens: Sequence[Token]) -> int:
    return int(tokens[0].value)  # cyclopts by itself rounds 2.5


def bounded(bounds: Bounds, text: str, unset: str = "") -> Parameter:
    """Return a numeric option whose help states its range; `unset` describes a default of None.

    It accepts only integers if the bounds are integers.
    """

    def check(_: object, value: object) -> None:
        if value == ():
            raise ValueError("expected at least one value")
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, int | float) and not bounds.min <= number <= bounds.max:
                raise ValueError(f"expected {bounds}")

    stated = f" [default: {unset}]" if unset else ""
    converter = _integer if isinstance(bounds.min, int) else None
    return Parameter(help=f"{text}, {bounds}{stated}", converter=converter, validator=check)


def check_executor(workers: int | None, scheduler: str | None) -> None:
    """Raise InputError if options request both local processes and a cluster."""
    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler: expected one of the two")


Force = Annotated[bool, Parameter(help="replace files that this command did not write, or that were changed since")]
Workers = Annotated[int | None, bounded(WORKERS, "worker processes on this machine", unset="all cores")]
Scheduler = Annotated[
    str | None, Parameter(metavar="ADDRESS", help="Dask scheduler whose workers do the work, such as tcp://host:8786")
]
Layout = Annotated[Path, Parameter(metavar="FILE", help="layout.json, calibrated if possible")]
Adapter = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
AdapterOption = Annotated[
    Adapter, Parameter(help="part that carries the device: on a desk, a tripod, an arm or others (docs/cad.md)")
]
Mounting = Annotated[
    Literal["glue", "tape", "screws"],
    Parameter(help="mirrors glued or taped to the holder, or each on a carrier that three sprung screws hold and tilt"),
]
