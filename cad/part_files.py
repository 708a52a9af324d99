"""Make the files of one part from its plan, or read them from the store if the plan and the program are the same."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.cad.checks import check_part
from mirrorcam.cad.checks.exported_mesh import is_manifold, read_3mf, solid_of
from mirrorcam.cad.guide import write_drawing
from mirrorcam.cad.guide.drawing_sheet import UNDATED, issue_date
from mirrorcam.cad.parts.part_mark import engraved, plan_mark
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening, Printer
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan, plain
from mirrorcam.cad.printed_volume import printed_mm3
from mirrorcam.cad.write.part_export import mass_properties, write_step, write_stl
from mirrorcam.cad.write.slicer import slicer_version
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.core.disk.files import write_files
from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.disk.program import NOT_INSTALLED, program_of
from mirrorcam.core.disk.results import Results

CODE = ("mirrorcam.cad.part_files", "mirrorcam.cad.assembly.catalogue")
"""Modules whose code, with all that they import, decides the files of a part."""
ENDINGS = {"parts": (".step", ".stl", ".3mf"), "drawings": (".svg", ".pdf")}
_BUILT = "part.json"


def make_part(
    part: PartPlan, printer: Printer, out: Path, results: Results | None, screw: Fastening = HARDWARE.screw
) -> BuiltPart:
    """Make and check the files of a part in `out`, or copy them from `results` if the same part is stored there.

    Writes NAME.step, .stl and .3mf to `out/parts`, and NAME.svg and .pdf to `out/drawings`. `screw` decides which
    holes the drawing marks for inserts and nuts. Raises InputError if the part cannot be made.
    """
    if results is None:
        return _make(part, printer, out, screw)
    inputs, key = _inputs(part, printer, screw), f"part-{part.name}"
    names = [f"{folder}/{part.name}{ending}" for folder, endings in ENDINGS.items() for ending in endings]
    contents = results.get(key, inputs)
    if contents is not None and contents.keys() == {_BUILT, *names}:
        write_files(out, {name: contents[name] for name in names})
        built = BuiltPart.model_validate_json(contents[_BUILT])
        return BuiltPart.of(part, out / "parts", built.mass, built.checks)
    built = _make(part, printer, out, screw)
    record = built.replaced(folder=Path("parts")).model_dump_json().encode()
    results.put(key, inputs, {_BUILT: record} | {name: (out / name).read_bytes() for name in names})
    return built


def _make(part: PartPlan, printer: Printer, out: Path, screw: Fastening) -> BuiltPart:
    bare = part.make(part.plan)
    bare.label = part.name
    mark = plan_mark(bare, mark_of(part), part.print_from_rig[2, :3], part.faces)
    solid = engraved(bare, mark) if mark else bare
    folder = out / "parts"
    step, stl, threemf = (folder / f"{part.name}{ending}" for ending in ENDINGS["parts"])
    write_step(step, solid, part.faces)
    write_stl(stl, solid)
    write_3mf(threemf, stl, part, printer)
    write_drawing(out / "drawings", bare, part, printer, screw)
    printed = solid_of(read_3mf(threemf))
    filled = printed_mm3(printed, printer.wall_mm) / printed.volume() if is_manifold(printed) else 1.0
    mass = mass_properties(solid, filled * printer.plastic_g_per_cm3)
    return BuiltPart.of(part, folder, mass, check_part(part, folder, printer))


def mark_of(part: PartPlan) -> tuple[str, ...]:
    """Lines engraved into a part: number, revision and, if known, date of issue."""
    date = issue_date()
    return (part.number, part.identity[:8], *(() if date == UNDATED else (date,)))


def _inputs(part: PartPlan, printer: Printer, screw: Fastening) -> dict[str, str]:
    """Digests and versions of a part's inputs: plan, printer, screws, date, slicer, code and libraries."""
    parameters = {"part": plain(part), "printer": plain(printer), "screw": plain(screw)}
    versions = {"date": issue_date(), "slicer": slicer_version() or NOT_INSTALLED}
    return {"parameters": value_digest(parameters)} | versions | program_of(*CODE)
