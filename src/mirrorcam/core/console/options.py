"""Options that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, validators

from mirrorcam.core.bounds import WORKERS

Force = Annotated[bool, Parameter(help="replace files that this command did not write, or that were changed since")]
Workers = Annotated[
    int | None,
    Parameter(
        metavar="INT",
        validator=validators.Number(gte=WORKERS.least, lte=WORKERS.most),
        help="worker processes on this machine. [default: all cores]",
    ),
]
Scheduler = Annotated[
    str | None, Parameter(metavar="ADDRESS", help="Dask scheduler whose workers do the work, such as tcp://host:8786")
]
Layout = Annotated[Path, Parameter(metavar="FILE", help="layout.json, calibrated if possible")]
Adapter = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
