"""Devices for the cameras of the library on every adapter: `python -m benchmarks.cameras FILE [--processes N]`.

Adds a line of JSON to FILE for each camera and adapter, as its device is built with all files and checked, and goes on
where an earlier run was cut off. `python -m benchmarks.cameras FILE --tables` prints the tables of docs/cad.md instead.
Slicers' checks and figures need one installed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from benchmarks.camera_cells import ADAPTERS, CAMERAS, Cell, Key, fill, read_cells
from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.camera_library import library

CLIP_HEAD = (
    "camera",
    "held by",
    "clip",
    "printing",
    "least force at a point",
    "strain of the leaves",
    "put back to",
    "picture moves",
    "gap of clip and light",
)
CHECKS = {
    "solids, meshes": (
        *("solids", "invalid_solids", "mesh_manifold", "mesh_pieces", "mesh_watertight", "meshes_broken"),
        *("pieces_amiss", "3mf_volume_error_mm3", "stl_volume_error_mm3", "lie_error_um"),
    ),
    "wall, floor": ("wall_mm", "floor_mm"),
    "overhang": ("overhang_mm2", "floating_mm2", "longest_bridge_mm"),
    "bed": ("above_bed_um", "off_bed_um", "print_width_mm", "print_length_mm", "print_height_mm"),
    "plates": ("part_gap_mm", "beyond_bed_mm"),
    "slicing": ("slices", "support_filament_mm"),
    "seats": (
        *("bond_error_um", "pocket_error_um", "seat_angle_deg", "seat_cover_lost", "seat_offset_um", "seats_missing"),
        *("seats_without_three_pads", "mirrors_off_their_seats"),
    ),
    "mirrors": (
        *("arrow_error_deg", "drop_clash_mm3", "feature_of_thickness", "files_not_in_mm", "line_gap_mm"),
        *("marks_missing", "marks_off_mirror", "names_twice", "outline_error_um", "outline_gap_mm"),
        *("outlines_missing", "outlines_off_sheet", "outlines_too_many", "room_clash_mm3", "stray_cuts"),
    ),
    "light": ("rays_blocked", "rays_cast", "rim_light_stopped", "mirrors_without_light", "light_gap_mm"),
    "stray light": ("stray_light", "shade_of_sheets"),
    "clashes": ("clash_mm3", "clearance_mm"),
    "dust cover": ("way_clash_mm3",),
    "ways in": ("insertion_clash_mm3",),
    "threads": ("fasteners_loose", "screws_without_thread", "threads_that_cannot_enter"),
    "pictures": ("base_pictures_hidden", "frames_pictures_hidden"),
    "tools": ("tool_clash_mm3",),
    "nest": ("contact_n", "leaf_strain"),
    "rest of a lens": ("rest_gap_mm",),
    "stiffness": ("tilt_deg",),
    "standing": ("tips_at_deg",),
    "tripod": ("tripod_turns",),
    "back": ("back_stress_mpa",),
}
"""Names of checks, without the part, by the rows of the table of checks; docs/cad.md tells how each is made."""
_ROW_OF = {name: row for row, names in CHECKS.items() for name in names}


def row_of(check: str) -> str:
    """The row of the table of checks for `part.check`; a check that is in none has a row of its own."""
    name = check.rpartition(".")[2]
    return _ROW_OF.get(name, name)


def matrix_table(cells: Mapping[Key, Cell]) -> Table:
    """Cameras by adapters: how many checks of how many passed."""

    def text(camera: str, adapter: str) -> str:
        cell = cells.get((camera, adapter))
        if cell is None:
            return ""
        if cell.error:
            return "**not built**"
        of = f"{len(cell.passed)} of {len(cell.passed) + len(cell.failed)}"
        return f"**{of}**" if cell.failed else of

    cameras, adapters = named(cells, 0, CAMERAS), named(cells, 1, ADAPTERS)
    rows = [(f"`{camera}`", *(text(camera, adapter) for adapter in adapters)) for camera in cameras]
    return table(("camera", *(f"`{adapter}`" for adapter in adapters)), rows)


def checks_table(cells: Mapping[Key, Cell]) -> Table:
    """Checks by adapters: for how many cameras, of those that have such a check, all of the kind passed."""
    adapters = named(cells, 1, ADAPTERS)
    checked: dict[tuple[str, str], dict[str, bool]] = {}
    for (camera, adapter), cell in cells.items():
        for names, passed in ((cell.passed, True), (tuple(cell.failed), False)):
            for row in map(row_of, names):
                of_row = checked.setdefault((row, adapter), {})
                of_row[camera] = of_row.get(camera, True) and passed

    def text(row: str, adapter: str) -> str:
        of_row = checked.get((row, adapter), {})
        of = f"{sum(of_row.values())} of {len(of_row)}" if of_row else ""
        return of if all(of_row.values()) else f"**{of}**"

    found = {row for row, _ in checked}
    rows = [*(row for row in CHECKS if row in found), *sorted(found - CHECKS.keys())]
    head = ("check", *(f"`{adapter}`" for adapter in adapters))
    return table(head, [(row, *(text(row, adapter) for adapter in adapters)) for row in rows])


def print_table(cells: Mapping[Key, Cell]) -> Table:
    """Cameras by adapters: mass as solid, and, where they were sliced, plastic and printing time of each device."""

    def text(camera: str, adapter: str) -> str:
        cell = cells.get((camera, adapter))
        if cell is None or cell.mass_g is None:
            return ""
        if cell.print_g is None or cell.print_minutes is None:
            return f"{cell.mass_g:.0f} g"
        hours, minutes = divmod(round(cell.print_minutes), 60)
        return f"{cell.mass_g:.0f} g, {cell.print_g:.0f} g, {hours}:{minutes:02d} h"

    adapters = named(cells, 1, ADAPTERS)
    rows = [(f"`{camera}`", *(text(camera, adapter) for adapter in adapters)) for camera in named(cells, 0, CAMERAS)]
    return table(("camera", *(f"`{adapter}`" for adapter in adapters)), rows)


def clip_table(cells: Mapping[Key, Cell]) -> Table:
    """Figures of the clip of each camera, of the device on the first adapter that it was built with."""
    first: dict[str, Cell] = {}
    for adapter in named(cells, 1, ADAPTERS):
        for camera in named(cells, 0, CAMERAS):
            if (camera, adapter) in cells and not cells[camera, adapter].error:
                first.setdefault(camera, cells[camera, adapter])
    return table(CLIP_HEAD, [clip_row(first[camera]) for camera in named(cells, 0, CAMERAS) if camera in first])


def clip_row(cell: Cell) -> tuple[str, ...]:
    """The cells of a camera's line in the table of clips; "" where a figure is not known."""

    def figure(key: str, text: str, times: float = 1.0) -> str:
        metric = cell.clip.get(f"camera_clip.{key}")
        return text.format(times * metric.value) if metric else ""

    return (
        f"`{cell.camera}`",
        {"lips": "six points", "board": "screws"}[library()[cell.camera].body.held_by.kind],
        figure("print_g", "{:.0f} g"),
        figure("print_minutes", "{:.0f} min"),
        figure("contact_n", "{:.2f} N"),
        figure("leaf_strain", "{:.2f} %", 100.0),
        figure("reclamped_mm", "{:.3f} mm, ") + figure("reclamped_deg", "{:.3f}°"),
        figure("reclamped_px", "{:.1f} px"),
        figure("light_gap_mm", "{:.1f} mm"),
    )


def named(cells: Iterable[Key], place: int, order: Sequence[str]) -> tuple[str, ...]:
    """The cameras (`place` 0) or adapters (1) that there are cells of, in an order."""
    found = {key[place] for key in cells}
    return (*(name for name in order if name in found), *sorted(found.difference(order)))


def failures(cells: Mapping[Key, Cell]) -> list[str]:
    """A line for each check that did not pass, and each device that was not built."""
    lines = []
    for cell in cells.values():
        where = f"{cell.camera} on {cell.adapter}"
        lines += [f"{where}: {cell.error}"] if cell.error else []
        lines += [
            f"{where}: {name} is {metric.value:g} {metric.unit}, limit {metric.limit:g}"
            for name, metric in cell.failed.items()
        ]
    return lines


TABLES: tuple[tuple[str, str, Callable[[Mapping[Key, Cell]], Table]], ...] = (
    ("cameras_matrix", "Checks passed", matrix_table),
    ("cameras_checks", "Cameras whose checks of a kind all passed", checks_table),
    ("cameras_printing", "Mass as solid, plastic, printing time", print_table),
    ("cameras_clips", "Clips", clip_table),
)
"""Records, titles and makers of the tables."""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="lines of JSON, new or of a run that was cut off")
    parser.add_argument("--cameras", nargs="+", default=CAMERAS, choices=CAMERAS, metavar="NAME", help="(all)")
    parser.add_argument("--adapters", nargs="+", default=ADAPTERS, choices=ADAPTERS, metavar="KIND", help="(all)")
    parser.add_argument("--processes", type=int, default=cores(), help="devices built at once (one for each core)")
    parser.add_argument(
        "--designs", type=Path, default=Path("output/camera_designs"), help="folder that keeps a layout for each camera"
    )
    parser.add_argument("--again", action="store_true", help="build again what did not pass")
    parser.add_argument("--tables", action="store_true", help="build nothing, print the tables")
    add_json_option(parser)
    options = parser.parse_args(arguments)
    try:
        if options.tables:
            cells = read_cells(options.file)
            for key, title, made in TABLES:
                found = made(cells)
                print(f"{title}:\n\n{found.markdown()}\n")
                write_record(options.json, key, table=found)
        else:
            cells = fill(
                *(options.file, options.cameras, options.adapters, options.designs, options.processes),
                again=options.again,
                done=_say,
            )
    except InputError as error:
        parser.error(str(error))
    failed = failures(cells)
    print("\n".join(failed), file=sys.stderr)
    return 1 if failed else 0


def _say(cell: Cell) -> None:
    of = len(cell.passed) + len(cell.failed)
    told = cell.error or f"{len(cell.passed)} of {of} checks passed"
    print(f"{cell.camera} on {cell.adapter}: {told}, {cell.seconds:.0f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
