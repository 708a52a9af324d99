"""The installation: this program, the libraries of each extra with their tested versions, and other programs."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
import sysconfig
from importlib import metadata
from pathlib import Path

import mirrorcam
from mirrorcam.cad.write.slicer import PROGRAMS as SLICERS
from mirrorcam.core.disk.program import PACKAGE, normalised, required
from mirrorcam.core.extras import MODULES, missing_modules
from mirrorcam.core.values import Value

CONSTRAINTS = "constraints.txt"
BASE = "base"
PURPOSES = {
    BASE: "design, board, calibrate, decode, depth, and all commands that read light fields",
    "cad": "the parts of a device: mirrorcam cad, camera new, run",
    "render": "synthetic sets and scenes: mirrorcam render, scene, suite, cad picture, validate, run",
    "fe": "mirrorcam cad --elastic (with the program gmsh)",
    "cluster": "the option --scheduler of mirrorcam sweep, render and suite, for a Dask cluster",
    "remote": "suites in object storage: mirrorcam suite --fetch, --publish",
    "parquet": "mirrorcam sweep --table parquet",
    "robot": "ROS 2 bags: mirrorcam decode --to mcap",
    "view": "mirrorcam decode --view, in rerun's viewer",
    "studio": "the pages in the browser: mirrorcam studio, live",
}
PROGRAMS = {
    "PrusaSlicer": (SLICERS, "printing time and plastic of parts, and whether they need support"),
    "gmsh": (("gmsh",), "meshes for mirrorcam cad --elastic"),
}


class Package(Value):
    """A distribution that an extra requires: the installed version, if any, and the tested one, if any."""

    name: str
    installed: str | None
    tested: str | None


class Extra(Value):
    """An extra, or the base installation: its purpose, its packages, and the missing modules."""

    name: str
    purpose: str
    packages: tuple[Package, ...]
    missing: tuple[str, ...]


class Program(Value):
    """An optional external program."""

    name: str
    purpose: str
    path: str | None


class Installation(Value):
    """Everything about an installation that a bug report should state."""

    version: str
    folder: str
    python: str
    executable: str
    system: str
    extras: tuple[Extra, ...]
    programs: tuple[Program, ...]


def installation() -> Installation:
    """Inspect this installation without importing a library."""
    tested = constrained_versions()
    return Installation(
        version=mirrorcam.__version__,
        folder=str(Path(mirrorcam.__file__).parent),
        python=platform.python_version(),
        executable=sys.executable,
        system=platform.platform(),
        extras=tuple(_extra(name, tested) for name in PURPOSES),
        programs=tuple(_program(name) for name in PROGRAMS),
    )


def constrained_versions() -> dict[str, str]:
    """Return the versions with which the tests passed, by normalised distribution name, from `constraints.txt`."""
    folder = Path(mirrorcam.__file__).parent
    files = (folder / CONSTRAINTS, folder.parents[1] / CONSTRAINTS)  # in a wheel, in a checkout
    text = next(file for file in files if file.is_file()).read_text(encoding="utf-8")
    return {normalised(name): version for name, version in re.findall(r"^([\w.-]+)==(\S+)$", text, re.MULTILINE)}


def _extra(name: str, tested: dict[str, str]) -> Extra:
    base = required(PACKAGE, frozenset())
    names = base if name == BASE else required(PACKAGE, frozenset({name})) - base
    packages = tuple(Package(name=name, installed=_version(name), tested=tested.get(name)) for name in sorted(names))
    if name == BASE:
        missing = tuple(package.name for package in packages if package.installed is None)
    else:
        missing = tuple(missing_modules(name)) if name in MODULES else ()
    return Extra(name=name, purpose=PURPOSES[name], packages=packages, missing=missing)


def _version(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def _program(name: str) -> Program:
    commands, purpose = PROGRAMS[name]
    # If Python was started by its path, the folder of its scripts may be missing from PATH.
    search_path = os.pathsep.join((sysconfig.get_path("scripts"), os.environ.get("PATH", "")))
    paths = (path for command in commands if (path := shutil.which(command, path=search_path)))
    return Program(name=name, purpose=purpose, path=next(paths, None))
