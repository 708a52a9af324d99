"""Parts as 3MF for a slicer: in print orientation, with their numbers, licence, material and colours.

Print plates are 3MF projects with print settings: all parts of a device on as few beds as possible.
"""

from __future__ import annotations

import ctypes
import locale
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from uuid import NAMESPACE_URL, uuid5

import lib3mf
import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from mirrorcam.cad.mirrors.nesting import nest
from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import LICENCE, PartPlan
from mirrorcam.cad.write.slicer import PROFILE, embedded, orca_profile, prusa_profile
from mirrorcam.core.disk.files import atomic, write_text
from mirrorcam.core.values import FloatArray, Metric

DESIGNER = "MirrorCam"
# Relationship type of an attached configuration; slicers find the file by its path.
CONFIGURATION_TYPE = "http://mirrorcam/configuration"


@dataclass(frozen=True, eq=False)
class PrintBody:
    """A part's mesh on the bed, in the frame of the bed's lower left corner: points (n, 3), mm, and faces (m, 3)."""

    part: PartPlan
    points: FloatArray
    faces: NDArray[np.int64]

    def transformed(self, rotation: FloatArray, shift_mm: FloatArray) -> PrintBody:
        """The body after a rotation (2, 2) about the bed's normal and a shift (2,)."""
        in_plan = self.points[:, :2] @ rotation.T + shift_mm
        return replace(self, points=np.column_stack([in_plan, self.points[:, 2]]))


def body_on_bed(stl: Path, part: PartPlan, printer: Printer) -> PrintBody:
    """A part from its STL file (rig, mm) in its print orientation, at the centre of the bed."""
    mesh = trimesh.load_mesh(stl)
    centre = (printer.bed_mm[0] / 2.0, printer.bed_mm[1] / 2.0, 0.0)
    return PrintBody(part, on_bed(np.array(mesh.vertices), part, printer) + centre, np.array(mesh.faces))


def write_3mf(path: Path, stl: Path, part: PartPlan, printer: Printer) -> None:
    """Write the mesh of a part's STL file (rig, mm) in its print orientation, at the centre of the bed."""
    body = body_on_bed(stl, part, printer)
    size = np.ptp(body.points, axis=0)
    description = (
        f"{part.number} {part.title}, part identity {part.identity}. Print as it lies, without support: "
        f"{printer.plastic}, {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} mm, z up."
    )
    write_bodies(path, [body], part.title, description, printer)


def write_bodies(
    path: Path,
    bodies: Sequence[PrintBody],
    title: str,
    description: str,
    printer: Printer,
    attachments: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write the bodies on one bed; `attachments` are text files, by their paths in the archive.

    The UUIDs are derived from the parts' identities, so that the same parts give the same bytes; lib3mf's defaults are
    random.
    """
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    texts = {"Title": title, "Designer": DESIGNER, "LicenseTerms": LICENCE, "Description": description}
    for name, text in texts.items():
        model.GetMetaDataGroup().AddMetaData("", name, text, "xs:string", True)
    colours = model.AddBaseMaterialGroup()
    for body in bodies:
        part = body.part
        # The origin of each object is its centre, about which a slicer rotates it.
        low, high = body.points.min(axis=0), body.points.max(axis=0)
        centre = np.array([*(low[:2] + high[:2]) / 2.0, 0.0])
        mesh = model.AddMeshObject()
        mesh.SetName(part.name)
        mesh.SetPartNumber(part.number)
        mesh.SetUUID(_uuid(part, "object"))
        mesh.SetGeometry(
            [lib3mf.Position((ctypes.c_float * 3)(*point)) for point in (body.points - centre).tolist()],
            [lib3mf.Triangle((ctypes.c_uint32 * 3)(*face)) for face in body.faces.tolist()],
        )
        colour = colours.AddMaterial(printer.plastic, wrapper.FloatRGBAToColor(*part.rgb, 1.0))
        mesh.SetObjectLevelProperty(colours.GetResourceID(), colour)
        item = model.AddBuildItem(mesh, wrapper.GetTranslationTransform(*centre))
        item.SetPartNumber(part.number)
        item.SetUUID(_uuid(part, "item"))
    model.SetBuildUUID(_uuid(bodies[0].part, "build" + "".join(body.part.identity for body in bodies[1:])))
    for name, text in attachments.items():
        data = text.encode()
        model.AddAttachment(name, CONFIGURATION_TYPE).ReadFromBuffer((ctypes.c_ubyte * len(data))(*data))
    with atomic(path) as temporary, _restored_locale():
        model.QueryWriter("3mf").WriteToFile(str(temporary))


def on_bed(points_in_rig: FloatArray, part: PartPlan, printer: Printer) -> FloatArray:
    """Points (n, 3) of a part in its print orientation, centred over the origin and the bed at z = 0.

    The part is rotated by a quarter turn if it fits only that way.
    """
    points = points_in_rig @ part.print_from_rig[:3, :3].T
    width, length = np.ptp(points[:, :2], axis=0)
    bed_width, bed_length = printer.bed_mm[:2]
    if (width > bed_width or length > bed_length) and width <= bed_length and length <= bed_width:
        points = points @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    return points - (*(low[:2] + high[:2]) / 2.0, low[2])


@contextmanager
def _restored_locale() -> Iterator[None]:
    """Restore the locale: lib3mf's writer sets that of the process to C, in which Python reads text as ASCII."""
    previous = locale.setlocale(locale.LC_ALL)
    try:
        yield
    finally:
        locale.setlocale(locale.LC_ALL, previous)


def _uuid(part: PartPlan, role: str) -> str:
    return str(uuid5(NAMESPACE_URL, f"mirrorcam:{part.number}:{part.name}:{part.identity}:{role}"))


FOLDER = "plates"
GAP_MM = 6.0
"""Minimum distance between parts: space for the nozzle, a brim and a skirt."""

CONFIG = "/Metadata/Slic3r_PE.config"
"""Path of the settings of PrusaSlicer and its relatives in a 3MF file."""

# Tolerance of checks for the rounding of the nesting.
NESTING_ROUNDING_MM = 1e-3


@dataclass(frozen=True)
class Plate:
    """The parts of one print, in their positions on the bed."""

    bodies: tuple[PrintBody, ...]


def plan_plates(parts: Sequence[PartPlan], folder: Path, printer: Printer) -> tuple[Plate, ...]:
    """Nest parts on beds by the convex hulls of their plan views; `folder` contains their STL files.

    Parts may reach to the edge of the bed.
    """
    bodies = [body_on_bed(folder / f"{part.name}.stl", part, printer) for part in parts]
    bed = printer.bed_mm[0], printer.bed_mm[1]
    # The gap is between parts only, not to the edge of the bed.
    enlarged = (bed[0] + 2.0 * GAP_MM, bed[1] + 2.0 * GAP_MM)
    positions = nest([_hull(body) for body in bodies], enlarged, GAP_MM)
    plates: dict[int, list[PrintBody]] = {}
    for body, position in zip(bodies, positions, strict=True):
        plates.setdefault(position.sheet, []).append(body.transformed(position.rotation, position.shift_mm - GAP_MM))
    return tuple(Plate(tuple(bodies)) for _, bodies in sorted(plates.items()))


def _hull(body: PrintBody) -> FloatArray:
    """The convex hull (n, 2) of a body's plan view, counter-clockwise."""
    hull = shapely.convex_hull(shapely.MultiPoint(body.points[:, :2]))
    return np.asarray(shapely.get_coordinates(shapely.geometry.polygon.orient(hull))[:-1])


def write_plates(
    out: Path, parts: Sequence[PartPlan], printer: Printer
) -> tuple[dict[str, tuple[str, ...]], dict[str, Metric]]:
    """Write `plates/plate_NUMBER.3mf` and the slicers' profiles into a device's folder, which contains `parts/`.

    Returns the names of the parts in each file, by its path in the folder, and the checks of the plates.
    """
    plates = plan_plates(parts, out / "parts", printer)
    profile = prusa_profile(printer)
    parts_by_path: dict[str, tuple[str, ...]] = {}
    for number, plate in enumerate(plates, start=1):
        title = f"Plate {number} of {len(plates)}"
        contents = ", ".join(f"{body.part.number} {body.part.title} ({body.part.identity})" for body in plate.bodies)
        path = f"{FOLDER}/plate_{number}.3mf"
        description = f"{contents}. Print without support."
        write_bodies(out / path, plate.bodies, title, description, printer, {CONFIG: embedded(profile)})
        parts_by_path[path] = tuple(body.part.name for body in plate.bodies)
    write_text(out / FOLDER / f"{PROFILE}.ini", profile)
    write_text(out / FOLDER / f"{PROFILE}_orca.json", orca_profile(printer))
    return parts_by_path, check_plates(plates, printer)


def check_plates(plates: Sequence[Plate], printer: Printer) -> dict[str, Metric]:
    """Check that parts are on the bed and clear of each other, by their outlines from above instead of their hulls."""
    gap, overrun = np.inf, 0.0
    bed = np.array(printer.bed_mm)
    for plate in plates:
        for body in plate.bodies:
            overrun = max(overrun, float((-body.points).max()), float((body.points - bed).max()))
        # Triangles are not united: those of steep faces overlap by rounding errors, of which a union fails.
        outlines = [shapely.polygons(body.points[body.faces][..., :2]) for body in plate.bodies]
        trees = [shapely.STRtree(triangles) for triangles in outlines]
        for (tree, _), (_, others) in combinations(zip(trees, outlines, strict=True), 2):
            _, distances = tree.query_nearest(others, return_distance=True, all_matches=False)
            gap = min(gap, float(distances.min()))
    checks = {
        "number": Metric(value=len(plates), unit=""),
        "beyond_bed_mm": Metric(value=round(max(overrun, 0.0), 3), unit="mm", limit=NESTING_ROUNDING_MM),
    }
    if np.isfinite(gap):
        min_gap = GAP_MM - NESTING_ROUNDING_MM
        checks["part_gap_mm"] = Metric(value=round(float(gap), 3), unit="mm", limit=min_gap, lower_is_better=False)
    return checks
