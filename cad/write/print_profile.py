"""Print settings as slicers read them: those that times and masses are measured with, and those in files to print."""

from __future__ import annotations

import json

from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Printer

PROFILE = "mirrorcam"
"""Name of the profile, and stem of its files."""

SETTINGS = {
    "layer_height": f"{PRINT_SETTINGS.layer_mm:g}",
    "first_layer_height": f"{PRINT_SETTINGS.layer_mm:g}",
    "perimeters": f"{PRINT_SETTINGS.perimeters}",
    # Half the time of the newer generator, and as good for walls of several lines.
    "perimeter_generator": "classic",
    "fill_density": f"{PRINT_SETTINGS.infill_percent}%",
    "perimeter_speed": "45",
    "external_perimeter_speed": "30",
    "small_perimeter_speed": "25",
    "infill_speed": "80",
    "solid_infill_speed": "60",
    "top_solid_infill_speed": "40",
    "gap_fill_speed": "30",
    "travel_speed": "150",
}
"""Settings of a print as PrusaSlicer names them: layers, walls and infill, and speeds of a common hobby printer."""

NOZZLE = {"nozzle_diameter": f"{PRINT_SETTINGS.nozzle_mm:g}", "filament_diameter": "1.75"}


def of_printer(printer: Printer) -> dict[str, str]:
    """The bed and the plastic of a printer, as PrusaSlicer names them."""
    width, length, height = (f"{side:g}" for side in printer.bed_mm)
    return {
        "bed_shape": f"0x0,{width}x0,{width}x{length},0x{length}",
        "max_print_height": height,
        "filament_density": f"{printer.plastic_g_per_cm3:g}",
    }


def prusa_profile(printer: Printer) -> str:
    """The profile as an INI file of PrusaSlicer and SuperSlicer: no support, since no part needs any."""
    settings = SETTINGS | {"support_material": "0"} | NOZZLE | of_printer(printer)
    settings |= {"print_settings_id": PROFILE}
    return "".join(f"{name} = {value}\n" for name, value in sorted(settings.items()))


def embedded(profile: str) -> str:
    """A profile as it stands in a 3MF project of PrusaSlicer, which skips its first line: every setting a comment."""
    return f"; {PROFILE}\n\n" + "".join(f"; {line}\n" for line in profile.splitlines())


def orca_profile() -> str:
    """The profile as a process of OrcaSlicer and Bambu Studio, by their names of settings; printers are their own.

    Both know a process by its `print_settings_id` alone, and take none without a version; every value is a string.
    """
    settings = {
        "type": "process",
        "name": PROFILE,
        "print_settings_id": PROFILE,
        "from": "User",
        "version": "1.6.0.0",
        "layer_height": SETTINGS["layer_height"],
        "initial_layer_print_height": SETTINGS["first_layer_height"],
        "wall_loops": SETTINGS["perimeters"],
        "wall_generator": SETTINGS["perimeter_generator"],
        "sparse_infill_density": SETTINGS["fill_density"],
        "enable_support": "0",
        "inner_wall_speed": SETTINGS["perimeter_speed"],
        "outer_wall_speed": SETTINGS["external_perimeter_speed"],
        "sparse_infill_speed": SETTINGS["infill_speed"],
        "internal_solid_infill_speed": SETTINGS["solid_infill_speed"],
        "top_surface_speed": SETTINGS["top_solid_infill_speed"],
        "gap_infill_speed": SETTINGS["gap_fill_speed"],
        "travel_speed": SETTINGS["travel_speed"],
    }
    return json.dumps(settings, indent=4) + "\n"
