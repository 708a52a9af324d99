"""Checks of the exported files, each read back and measured against the layout; a failure is a metric, not an error."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cad.checks.cuts import check_dxf
from cad.checks.light import light_rays, shade_of_sheets
from cad.checks.mesh import check_mesh, hits, is_manifold, read_stl, solid_of
from cad.checks.seats import check_step
from cad.checks.walls import thinnest_wall_mm
from cad.hardware import Hardware
from optics.layout import Layout
from optics.values import Metric


def check_files(folder: Path, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """All checks of `mirror_holder.step`, `mirror_holder.stl` and `mirrors.dxf` in a folder."""
    return {
        **check_step(folder / "mirror_holder.step", layout),
        **check_stl(folder / "mirror_holder.stl", layout, hardware),
        **check_dxf(folder / "mirrors.dxf", layout),
    }


def check_stl(path: Path, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """Tight, in one piece, free of the light, and its thinnest wall.

    At a mesh that is not manifold no ray proves anything: all count as blocked, and the wall as nothing.
    """
    mesh = read_stl(path)
    body = solid_of(mesh)
    manifold = is_manifold(body)
    rays = np.concatenate(
        [light_rays(layout, index, hardware).reshape(-1, 2, 3) for index in range(len(layout.mirrors))]
    )
    blocked = hits(body, rays) if manifold else len(rays)
    return {
        **check_mesh(mesh, body),
        "rays_blocked": Metric(value=blocked, unit="", limit=0),
        "rays_cast": Metric(value=len(rays), unit=""),
        "shade_of_sheets": Metric(value=shade_of_sheets(layout, hardware), unit=""),
        "wall_mm": Metric(
            value=round(thinnest_wall_mm(mesh, body), 3) if manifold else 0.0,
            unit="mm",
            limit=hardware.printer.wall_mm,
            lower_is_better=False,
        ),
    }
