"""One part from its plan to its files, once: what was made of the same numbers by the same code is taken over."""

from __future__ import annotations

import shutil
from pathlib import Path, PurePosixPath

from mirrorcam.cad.checks import check_part
from mirrorcam.cad.guide import write_drawing
from mirrorcam.cad.guide.drawing_sheet import UNDATED, issue_date
from mirrorcam.cad.parts.part_mark import engraved, plan_mark
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening, Printer
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan, plain
from mirrorcam.cad.write.part_export import mass_properties, write_step, write_stl
from mirrorcam.cad.write.slicer import slicer_version
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.disk.fingerprint import NOT_INSTALLED, Fingerprint, file_digest, source_digest, versions
from mirrorcam.core.disk.resumable import intact, read_record
from mirrorcam.core.values import Value

FOLDERS = ("parts", "drawings")
# Our code that a part's files depend on.
SOURCES = ("mirrorcam.cad", "mirrorcam.core", "mirrorcam.optics.geometry")


class _Record(Value):
    """Record beside the files of a part: what decided about them, their sha256 by path, and what was measured."""

    key: str
    files: dict[str, str]
    part: BuiltPart


def make_part(
    part: PartPlan, printer: Printer, out: Path, previous: Path | None, screw: Fastening = HARDWARE.screw
) -> BuiltPart:
    """Make and check the files of a part in `out`, or take them over from `previous`, an earlier folder.

    `out/parts` gets NAME.step, .stl and .3mf, `out/drawings` NAME.svg and .pdf. Raises InputError where the part cannot
    be made. `screw` decides which holes the drawing marks for inserts and nuts.
    """
    key = _key(part, printer, screw)
    if previous and (built := _take_over(part, key, out, previous)):
        return built
    bare = part.make(part.plan)
    bare.label = part.name
    mark = plan_mark(bare, mark_of(part), part.print_from_rig[2, :3], part.faces)
    solid = engraved(bare, mark) if mark else bare
    folder = out / "parts"
    step, stl, threemf = (folder / f"{part.name}{suffix}" for suffix in (".step", ".stl", ".3mf"))
    write_step(step, solid, part.faces)
    write_stl(stl, solid)
    write_3mf(threemf, stl, part, printer)
    drawings = write_drawing(out / "drawings", bare, part, printer, screw)
    mass = mass_properties(solid, printer.plastic_g_per_cm3)
    built = BuiltPart.of(part, folder, mass, check_part(part, folder, printer))
    files = {path.relative_to(out).as_posix(): file_digest(path) for path in (step, stl, threemf, *drawings)}
    record = _Record(key=key, files=files, part=built.replaced(folder=Path("parts")))
    write_text(_record_path(out, part), record.model_dump_json(indent=1) + "\n")
    return built


def mark_of(part: PartPlan) -> tuple[str, ...]:
    """Lines engraved into a part: its number, its revision, and the date of issue, if it has one."""
    date = issue_date()
    return (part.number, part.identity[:8], *(() if date == UNDATED else (date,)))


def _take_over(part: PartPlan, key: str, out: Path, previous: Path) -> BuiltPart | None:
    """The part as it lies in `previous`, copied, where it was made of the same and no file has changed since."""
    path = _record_path(previous, part)
    record = read_record(_Record, path)
    if (
        record is None
        or record.key != key
        or not all(_is_of(part, name) for name in record.files)
        or intact(previous, record.files) != record.files
    ):
        return None
    places = [previous / name for name in record.files]
    for place in (*places, path):
        copy = out / place.relative_to(previous)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(place, copy)
    return BuiltPart.of(part, out / "parts", record.part.mass, record.part.checks)


def _is_of(part: PartPlan, name: str) -> bool:
    """Whether a name in a record is of a file of the part: what else it lists is nothing to take over."""
    folder, _, file = name.partition("/")
    return folder in FOLDERS and "/" not in file and PurePosixPath(file).stem == part.name


def _record_path(out: Path, part: PartPlan) -> Path:
    return out / "parts" / f".{part.name}.json"


def _key(part: PartPlan, printer: Printer, screw: Fastening = HARDWARE.screw) -> str:
    """Return what decides about a part's files: its plan, place and name, printer, screws, date, code, libraries."""
    return Fingerprint(
        parameters={
            "part": plain(part),
            "printer": plain(printer),
            "screw": plain(screw),
            "date": issue_date(),
        },
        sources={module: source_digest(module) for module in SOURCES},
        versions=versions("cad") | {"slicer": slicer_version() or NOT_INSTALLED},
    ).digest
