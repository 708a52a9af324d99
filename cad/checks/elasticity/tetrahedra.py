"""Tetrahedral meshes of the solids in STEP files, by the program gmsh."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.child_program import run_program
from mirrorcam.core.values import FloatArray

# Number of elements around a full circle, and minimum size of an element.
ELEMENTS_PER_CIRCLE, MIN_SIZE_MM = 6, 1.0
TIMEOUT_S = 600.0
NO_GMSH = (
    'gmsh is not installed or does not start, but finite elements need it: pip install "mirrorcam[fe]"; '
    "on Linux also libglu1-mesa, libxft2, libxcursor1, libxinerama1"
)
TETRAHEDRON = 4  # gmsh's element type


@dataclass(frozen=True)
class Tetrahedra:
    """Points (n, 3) in mm, and the indices (m, 4) of each tetrahedron's corners."""

    points: FloatArray
    corners: NDArray[np.int64]

    @property
    def volume_mm3(self) -> float:
        """Total volume of the tetrahedra."""
        edges = self.points[self.corners[:, 1:]] - self.points[self.corners[:, :1]]
        return float(np.abs(np.linalg.det(edges)).sum() / 6.0)


@cache
def gmsh_program() -> str | None:
    """Path of gmsh, next to this Python (as pip installs it) or on the path; None if it is missing or does not start.

    gmsh is under the GPL: it is run as a separate program, and neither imported nor linked. Its wheel needs the
    system's libraries for windows, although it opens none (libGLU, libXft, libXcursor, libXinerama).
    """
    installed = shutil.which("gmsh", path=sysconfig.get_path("scripts"))
    for program in (installed, shutil.which("gmsh")):
        if program and run_program([*_command(program), "--version"], timeout_s=TIMEOUT_S).returncode == 0:
            return program
    return None


def _command(program: str) -> list[str]:
    """The command of a program: pip's script is run by this Python, whichever Python is first on the path."""
    with Path(program).open("rb") as opened:
        first = opened.readline(200)
    return [sys.executable, program] if first.startswith(b"#!") and b"python" in first else [program]


def tetrahedra_of(step: Path, size_mm: float) -> Tetrahedra:
    """Mesh the solid of a STEP file with elements of a given size; raises InputError if gmsh is missing or fails."""
    program = gmsh_program()
    if program is None:
        raise InputError(NO_GMSH)
    with TemporaryDirectory() as folder:
        mesh = Path(folder, "part.msh")
        sizes = ["-clmax", f"{size_mm:g}", "-clmin", f"{MIN_SIZE_MM:g}", "-clcurv", f"{ELEMENTS_PER_CIRCLE}"]
        options = [str(step), "-3", *sizes, "-algo", "hxt", "-nt", "1", "-format", "msh22", "-o", str(mesh)]
        command = [*_command(program), *options]
        try:
            run = run_program(command, timeout_s=TIMEOUT_S)
        except subprocess.TimeoutExpired:
            raise InputError(f"{step}: gmsh took longer than {TIMEOUT_S:g} s to mesh it") from None
        if run.returncode != 0 or not mesh.is_file():
            output = (run.stdout + run.stderr).decode("utf-8", "replace")
            errors = [line for line in output.splitlines() if "Error" in line]
            raise InputError(
                f"{step}: gmsh could not mesh it: {errors[0] if errors else f'exit code {run.returncode}'}"
            )
        tetrahedra = read_msh22(mesh.read_text(encoding="utf-8"))
    if len(tetrahedra.corners) == 0:
        raise InputError(f"{step}: gmsh could not mesh it: no solid in it")
    return tetrahedra


def read_msh22(text: str) -> Tetrahedra:
    """The tetrahedra of a mesh in gmsh's text format 2.2 (gmsh's reference manual, chapter on file formats)."""
    nodes = _section(text, "Nodes")
    nodes_by_number = np.array([line.split() for line in nodes], dtype=np.float64).reshape(-1, 4)
    index_of = {int(number): index for index, number in enumerate(nodes_by_number[:, 0])}
    elements = [[int(word) for word in line.split()] for line in _section(text, "Elements")]
    tetrahedra = [[index_of[node] for node in element[-4:]] for element in elements if element[1] == TETRAHEDRON]
    corners = np.array(tetrahedra, dtype=np.int64).reshape(-1, 4)
    used, new_indices = np.unique(corners, return_inverse=True)
    return Tetrahedra(nodes_by_number[used, 1:4], new_indices.reshape(-1, 4))


def _section(text: str, name: str) -> list[str]:
    """The lines of a section, without the first, which is their count."""
    return text.partition(f"${name}\n")[2].partition(f"$End{name}")[0].splitlines()[1:]
