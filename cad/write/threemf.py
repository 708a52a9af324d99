"""A part as 3MF for a slicer: lying on the bed as it prints, with its number, licence, material and colour."""

from __future__ import annotations

import ctypes
import locale
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

import lib3mf
import numpy as np
import trimesh

from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.optics.base.files import atomic
from mirrorcam.optics.base.values import FloatArray

DESIGNER = "MirrorCam"
LICENCE = "Apache-2.0"


def write_3mf(path: Path, stl: Path, part: PartPlan, printer: Printer) -> None:
    """Write the mesh of a part's STL file (rig, mm) as it prints, in the middle of the bed.

    lib3mf gives random UUIDs to what has none; these are made of the part's identity, so that the same part gives the
    same bytes.
    """
    mesh = trimesh.load_mesh(stl)
    points = lying(np.array(mesh.vertices), part, printer)
    size = np.ptp(points, axis=0)
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    described = (
        f"{part.number} {part.title}, part identity {part.identity}. Print as it lies, without support: "
        f"{printer.plastic}, {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} mm, z up."
    )
    texts = {"Title": part.title, "Designer": DESIGNER, "LicenseTerms": LICENCE, "Description": described}
    for name, text in texts.items():
        model.GetMetaDataGroup().AddMetaData("", name, text, "xs:string", True)
    body = model.AddMeshObject()
    body.SetName(part.name)
    body.SetPartNumber(part.number)
    body.SetUUID(_uuid(part, "object"))
    body.SetGeometry(
        [lib3mf.Position((ctypes.c_float * 3)(*point)) for point in points.tolist()],
        [lib3mf.Triangle((ctypes.c_uint32 * 3)(*face)) for face in mesh.faces.tolist()],
    )
    colours = model.AddBaseMaterialGroup()
    colour = colours.AddMaterial(printer.plastic, wrapper.FloatRGBAToColor(*part.rgb, 1.0))
    body.SetObjectLevelProperty(colours.GetResourceID(), colour)
    to_middle = wrapper.GetTranslationTransform(printer.bed_mm[0] / 2.0, printer.bed_mm[1] / 2.0, 0.0)
    item = model.AddBuildItem(body, to_middle)
    item.SetPartNumber(part.number)
    item.SetUUID(_uuid(part, "item"))
    model.SetBuildUUID(_uuid(part, "build"))
    with atomic(path) as temporary, _same_locale():
        model.QueryWriter("3mf").WriteToFile(str(temporary))


def lying(points_in_rig: FloatArray, part: PartPlan, printer: Printer) -> FloatArray:
    """Points (n, 3) of a part as it prints: its middle over the origin, z = 0 the bed.

    Where the part only fits turned by a quarter, it is turned.
    """
    points = points_in_rig @ part.print_from_rig[:3, :3].T
    width, length = np.ptp(points[:, :2], axis=0)
    bed_width, bed_length = printer.bed_mm[:2]
    if (width > bed_width or length > bed_length) and width <= bed_length and length <= bed_width:
        points = points @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    return points - (*(low[:2] + high[:2]) / 2.0, low[2])


@contextmanager
def _same_locale() -> Iterator[None]:
    """Undo what lib3mf's writer does to the process: it sets the locale C, in which Python reads text as ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        yield
    finally:
        locale.setlocale(locale.LC_ALL, before)


def _uuid(part: PartPlan, what: str) -> str:
    return str(uuid5(NAMESPACE_URL, f"mirrorcam:{part.number}:{part.name}:{part.identity}:{what}"))
