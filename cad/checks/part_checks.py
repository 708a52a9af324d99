"""Checks of a printed part: its STEP, STL and 3MF files, against each other and against the printer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from build123d import GeomType, import_step

from mirrorcam.cad.checks.exported_mesh import check_mesh, is_manifold, read_3mf, read_stl, solid_of
from mirrorcam.cad.checks.overhangs import check_overhangs
from mirrorcam.cad.checks.wall_thickness import thinnest_floor_mm, thinnest_wall_mm
from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM
from mirrorcam.cad.write.slicer import check_slicing
from mirrorcam.core.values import Metric

# A 3MF file has its numbers as decimals, an STL file as 32-bit numbers.
SAME_MESH_UM = 5.0
SAME_VOLUME = 1e-6
# Corners in files are rounded, at 100 mm by up to 4e-6 mm: faces move by about this.
ROUNDED_MM = 1e-6


def check_part(part: PartPlan, folder: Path, printer: Printer) -> dict[str, Metric]:
    """Check the files of a part.

    Parameters
    ----------
    part : PartPlan
        The plan that the part was made of.
    folder : Path
        Holds NAME.step, NAME.stl (both in rig, mm) and NAME.3mf (as printed).
    printer : Printer
        What the printer can print.

    Returns
    -------
    dict of str to Metric
        Checks (with a limit) and figures by name. A mesh that is not manifold counts as having no wall and as needing
        support everywhere, since nothing measured on it proves anything. Without a slicer there are no checks of
        slicing.
    """
    shape = import_step(folder / f"{part.name}.step")
    solids = shape.solids()
    volume = sum(solid.volume for solid in solids)
    # A mesh cuts off round shapes, by its tolerance at most; flat ones it meets.
    curved = sum(face.area for face in shape.faces() if face.geom_type != GeomType.PLANE)
    volume_limit = STL_TOLERANCE_MM * curved + SAME_VOLUME * volume + ROUNDED_MM * shape.area
    mesh, printed = read_stl(folder / f"{part.name}.stl"), read_3mf(folder / f"{part.name}.3mf")
    body, lying = solid_of(mesh), solid_of(printed)
    up, sound = part.print_from_rig[2, :3], is_manifold(body)
    wall, floor = (thinnest_wall_mm(mesh, body, up), thinnest_floor_mm(mesh, body, up)) if sound else (0.0, 0.0)
    return {
        "solids": Metric(value=len(solids), unit="", limit=1),
        "invalid_solids": Metric(value=sum(not solid.is_valid for solid in solids) if solids else 1, unit="", limit=0),
        "volume_cm3": Metric(value=round(volume / 1000.0, 4), unit="cm3"),
        **check_mesh(mesh, body),
        "stl_volume_error_mm3": Metric(value=round(abs(mesh.volume - volume), 3), unit="mm3", limit=volume_limit),
        "3mf_volume_error_mm3": Metric(value=round(abs(printed.volume - volume), 3), unit="mm3", limit=volume_limit),
        "wall_mm": Metric(value=round(wall, 3), unit="mm", limit=printer.wall_mm, lower_is_better=False),
        "floor_mm": Metric(value=round(floor, 3), unit="mm", limit=printer.floor_mm, lower_is_better=False),
        **check_bed(mesh, printed, part, printer),
        **(
            check_overhangs(printed, lying, printer)
            if is_manifold(lying)
            else {"overhang_mm2": Metric(value=float(printed.area), unit="mm2", limit=0.0)}
        ),
        **check_slicing(folder / f"{part.name}.3mf", printer),
    }


def check_bed(mesh: trimesh.Trimesh, printed: trimesh.Trimesh, part: PartPlan, printer: Printer) -> dict[str, Metric]:
    """Check the part in the 3MF file: on the bed, no larger than it, and up as planned.

    `lie_error_um` is the largest difference of the heights of its corners from those of the STL file, laid as planned.
    """
    low, high = printed.bounds
    beyond = np.maximum(np.maximum(-low, high - np.array(printer.bed_mm)), 0.0).max()
    bed = (*sorted(printer.bed_mm[:2], reverse=True), printer.bed_mm[2])
    size = (*sorted((high - low)[:2], reverse=True), (high - low)[2])
    planned = np.sort(np.array(mesh.vertices) @ part.print_from_rig[2, :3] + part.print_from_rig[2, 3])
    lies = np.sort(np.array(printed.vertices)[:, 2])
    wrong = np.abs(lies - planned).max() if len(lies) == len(planned) else float(np.ptp(planned))
    return {
        **{
            f"print_{name}_mm": Metric(value=round(float(length), 3), unit="mm", limit=limit)
            for name, length, limit in zip(("length", "width", "height"), size, bed, strict=True)
        },
        "off_bed_um": Metric(value=round(float(beyond) * 1000.0, 2), unit="um", limit=SAME_MESH_UM),
        "above_bed_um": Metric(value=round(max(float(low[2]), 0.0) * 1000.0, 2), unit="um", limit=SAME_MESH_UM),
        "lie_error_um": Metric(value=round(float(wrong) * 1000.0, 2), unit="um", limit=SAME_MESH_UM),
    }
