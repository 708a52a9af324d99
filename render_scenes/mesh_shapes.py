"""Triangle meshes from STL, PLY and OBJ files and from formulas; Mitsuba itself cannot read STL."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

MESH_SUFFIXES = (".stl", ".ply", ".obj")
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


@dataclass(frozen=True, eq=False)
class Triangles:
    """A triangle mesh: points (n, 3), mm, vertex indices (m, 3), and vertex colours (n, 3), linear RGB, or none."""

    points: FloatArray
    faces: NDArray[np.uint32]
    colours: FloatArray | None = None


def read_mesh(path: Path) -> Triangles:
    """Read the triangles of an STL, PLY or OBJ file, in its own units and frame; raise InputError if invalid.

    Mitsuba reads PLY and OBJ: its variant must be set.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise InputError(f"{path}: not a readable mesh, expected {', '.join(MESH_SUFFIXES)}")
    raw = read_bytes(path)
    mesh = _read_stl(path, raw) if suffix == ".stl" else _read_by_mitsuba(path, suffix[1:])
    if not len(mesh.faces) or not np.isfinite(mesh.points).all():
        reason = "contains a point that is not finite" if len(mesh.faces) else "contains no triangle"
        raise InputError(f"{path}: {reason}, expected a surface")
    return mesh


def _read_stl(path: Path, raw: bytes) -> Triangles:
    count = int.from_bytes(raw[80:84], "little") if len(raw) >= 84 else 0
    if len(raw) == 84 + count * _FACET.itemsize and len(raw) >= 84:
        corners = np.frombuffer(raw, _FACET, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
    elif raw.lstrip().startswith(b"solid") and raw.rstrip().split(b"\n")[-1].lstrip().startswith(b"endsolid"):
        try:
            corners = np.array([[float(n) for n in vertex] for vertex in _VERTEX.findall(raw)]).reshape(-1, 3)
        except ValueError as error:
            raise InputError(f"{path}: not a valid STL: {error}") from None
        if len(corners) % 3:
            raise InputError(f"{path}: not a valid STL: {len(corners)} corners, expected three for each triangle")
    else:
        raise InputError(f"{path}: not a valid STL, or a truncated one")
    points, index = np.unique(corners, axis=0, return_inverse=True)
    return Triangles(points, index.reshape(-1, 3).astype(np.uint32))


def _read_by_mitsuba(path: Path, plugin: str) -> Triangles:
    import mitsuba as mi

    try:
        buffers = mi.traverse(mi.load_dict({"type": plugin, "filename": str(path)}))
    except RuntimeError as error:
        last = str(error).strip().splitlines()[-1].strip()
        raise InputError(f"{path}: not a valid {plugin.upper()}: {last}") from None
    points = np.array(buffers["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    return Triangles(points, np.array(buffers["faces"], dtype=np.uint32).reshape(-1, 3))


def leaves(size_mm: float, seed: int) -> Triangles:
    """Generate twigs with randomly oriented leaves that fill a cube of side `size_mm` around the origin."""
    random = np.random.default_rng(seed)
    length_steps = np.linspace(0.0, 1.0, 9)
    width_steps = np.array([-1.0, 0.0, 1.0])
    half_width = 0.26 * np.sin(np.pi * length_steps**0.8)
    points: list[FloatArray] = []
    faces: list[NDArray[np.uint32]] = []
    colours: list[FloatArray] = []

    def add(grid_points: FloatArray, colour: FloatArray) -> None:
        """Append the triangles of a grid (rows, columns, 3) of points."""
        rows, columns = grid_points.shape[:2]
        first = sum(len(grid) for grid in points) + np.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = first[:-1, :-1], first[:-1, 1:], first[1:, :-1], first[1:, 1:]
        faces.append(np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3).astype(np.uint32))
        points.append(grid_points.reshape(-1, 3))
        shade = random.uniform(0.75, 1.25, (rows * columns, 1))
        colours.append(np.clip(colour * shade, 0.02, 0.9))

    for _ in range(5):
        start, end = random.uniform(-0.5, 0.5, (2, 3)) * size_mm
        end[0] = -start[0]
        twig = start + length_steps[:, None] * (end - start)
        twig[:, 2] += 0.15 * size_mm * np.sin(np.pi * length_steps)
        offset = 0.01 * size_mm * np.array([[[0.0, 0.0, 0.0], [0.0, 0.6, 1.0], [0.0, -0.6, 1.0], [0.0, 0.0, 0.0]]])
        add(twig[:, None] + offset, np.array([0.20, 0.12, 0.06]))
        for knot in range(1, 9):
            axes = np.linalg.qr(random.standard_normal((3, 3)))[0]
            length = random.uniform(0.22, 0.34) * size_mm
            grid = np.empty((9, 3, 3))
            grid[..., 0] = length_steps[:, None]
            grid[..., 1] = width_steps * half_width[:, None]
            grid[..., 2] = 0.12 * np.abs(width_steps) * half_width[:, None] * 2.0 - 0.25 * length_steps[:, None] ** 2
            green = np.array([random.uniform(0.08, 0.35), random.uniform(0.30, 0.55), random.uniform(0.05, 0.15)])
            add(twig[knot] + (grid * length) @ axes.T, green)
    return Triangles(np.concatenate(points), np.concatenate(faces), np.concatenate(colours))
