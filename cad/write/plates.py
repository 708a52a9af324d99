"""Print plates: all parts of a device on as few beds as hold them, as 3MF projects with their print settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import shapely

from mirrorcam.cad.mirrors.nesting import nest
from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.print_profile import PROFILE, embedded, orca_profile, prusa_profile
from mirrorcam.cad.write.threemf import PrintBody, body_on_bed, write_bodies
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.values import FloatArray, Metric

FOLDER = "plates"
GAP_MM = 6.0
"""Least distance of parts from each other: a print head's nozzle, a brim and a skirt pass between."""

CONFIG = "/Metadata/Slic3r_PE.config"
"""Where PrusaSlicer and its relatives look for settings in a 3MF file."""

# Nesting leaves rounding.
ROUNDING_MM = 1e-3


@dataclass(frozen=True)
class Plate:
    """The parts of one print, as they lie on the bed."""

    bodies: tuple[PrintBody, ...]


def plan_plates(parts: Sequence[PartPlan], folder: Path, printer: Printer) -> tuple[Plate, ...]:
    """Lay parts on beds, by the hulls of their plans; `folder` holds their STL files.

    A part that fills the bed alone lies there as in its own file.
    """
    bodies = [body_on_bed(folder / f"{part.name}.stl", part, printer) for part in parts]
    bed = printer.bed_mm[0], printer.bed_mm[1]
    # The gap is between parts only: they may reach to the edge of the bed.
    roomy = (bed[0] + 2.0 * GAP_MM, bed[1] + 2.0 * GAP_MM)
    places = nest([_hull(body) for body in bodies], roomy, GAP_MM)
    plates: dict[int, list[PrintBody]] = {}
    for body, place in zip(bodies, places, strict=True):
        plates.setdefault(place.sheet, []).append(body.placed(place.turn, place.shift_mm - GAP_MM))
    return tuple(Plate(tuple(bodies)) for _, bodies in sorted(plates.items()))


def _hull(body: PrintBody) -> FloatArray:
    """The convex hull (n, 2) of a body's plan, counter-clockwise."""
    hull = shapely.convex_hull(shapely.MultiPoint(body.points[:, :2]))
    return np.asarray(shapely.get_coordinates(shapely.geometry.polygon.orient(hull))[:-1])


def write_plates(
    out: Path, parts: Sequence[PartPlan], printer: Printer
) -> tuple[dict[str, tuple[str, ...]], dict[str, Metric]]:
    """Write `plates/plate_NUMBER.3mf` and the profiles of slicers into a device's folder, which holds `parts/`.

    Returns the names of the parts in each file, by its path in the folder, and the checks of the plates.
    """
    plates = plan_plates(parts, out / "parts", printer)
    profile = prusa_profile(printer)
    held: dict[str, tuple[str, ...]] = {}
    for number, plate in enumerate(plates, start=1):
        title = f"Plate {number} of {len(plates)}"
        named = ", ".join(f"{body.part.number} {body.part.title} ({body.part.identity})" for body in plate.bodies)
        path = f"{FOLDER}/plate_{number}.3mf"
        told = f"{named}. Print without support."
        write_bodies(out / path, plate.bodies, title, told, printer, {CONFIG: embedded(profile)})
        held[path] = tuple(body.part.name for body in plate.bodies)
    write_text(out / FOLDER / f"{PROFILE}.ini", profile)
    write_text(out / FOLDER / f"{PROFILE}_orca.json", orca_profile())
    return held, check_plates(plates, printer)


def check_plates(plates: Sequence[Plate], printer: Printer) -> dict[str, Metric]:
    """Check that parts lie on the bed and apart: by their own outlines from above, not by their hulls."""
    gap, beyond = np.inf, 0.0
    bed = np.array(printer.bed_mm)
    for plate in plates:
        for body in plate.bodies:
            beyond = max(beyond, float((-body.points).max()), float((body.points - bed).max()))
        plans = [shapely.union_all(shapely.polygons(body.points[body.faces][..., :2])) for body in plate.bodies]
        gap = min([gap, *(one.distance(other) for one, other in combinations(plans, 2))])
    checks = {
        "number": Metric(value=len(plates), unit=""),
        "beyond_bed_mm": Metric(value=round(max(beyond, 0.0), 3), unit="mm", limit=ROUNDING_MM),
    }
    if np.isfinite(gap):
        least = GAP_MM - ROUNDING_MM
        checks["part_gap_mm"] = Metric(value=round(float(gap), 3), unit="mm", limit=least, lower_is_better=False)
    return checks
