"""Print settings for slicers; print time, mass of plastic and need for support by PrusaSlicer, if installed.

Parts are sliced with `prusa_profile` and the slicer's defaults, but with automatic support except under bridges. If the
slicer generates no support, time and grams exclude support.

One default is changed: the detection of overhanging perimeters is off. It splits perimeters at points that depend on
rounding, and the slicer recognises lines over a gap as a bridge only if they are unbroken. For a ceiling 8 mm wide over
a slot in a wall of 1.6 mm, rotated on the bed in 13 steps from 0 to 80 deg, there is no support without this detection;
with it, there is support at 35 and 65 deg only.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Printer, Speeds
from mirrorcam.core.processes.child_program import run_program
from mirrorcam.core.values import Metric

PROFILE = "mirrorcam"
"""Name of the profile and of its files."""

LAYERS = {
    "layer_height": f"{PRINT_SETTINGS.layer_mm:g}",
    "first_layer_height": f"{PRINT_SETTINGS.layer_mm:g}",
    "perimeters": f"{PRINT_SETTINGS.perimeters}",
    # Equivalent to Arachne for walls of several lines, in half the time.
    "perimeter_generator": "classic",
    "fill_density": f"{PRINT_SETTINGS.infill_percent}%",
    # Sparser far from walls: 4 g less in the default device than the default, `stars`.
    "fill_pattern": "adaptivecubic",
    # The default of 70 mm2 fills most bosses and thick walls.
    "solid_infill_below_area": "10",
}
"""Layers, walls and infill of a print under PrusaSlicer's names."""

SPEEDS: dict[Speeds, dict[str, str]] = {
    "ordinary": {
        "perimeter_speed": "150",
        "external_perimeter_speed": "120",
        "small_perimeter_speed": "75",
        "infill_speed": "180",
        "solid_infill_speed": "180",
        "top_solid_infill_speed": "100",
        "gap_fill_speed": "50",
        "travel_speed": "200",
        "default_acceleration": "2500",
    },
    "careful": {
        "perimeter_speed": "45",
        "external_perimeter_speed": "30",
        "small_perimeter_speed": "25",
        "infill_speed": "80",
        "solid_infill_speed": "60",
        "top_solid_infill_speed": "40",
        "gap_fill_speed": "30",
        "travel_speed": "150",
        "default_acceleration": "1500",
    },
}
"""Speeds (mm/s) and acceleration (mm/s2) under PrusaSlicer's names.

The ordinary ones are between the profiles of four printers in OrcaSlicer (layers of 0.2 mm, of the A1 0.24; outer wall,
inner wall, infill, acceleration): Creality Ender-3 V3 SE 60, 90, 180, 2500; Prusa MK4S 170, 170, 200, 4000; Bambu
Lab A1 200, 230, 230, 6000; Creality Ender-3 V3 KE 200, 300, 300, 5000. Gap fill, infill and acceleration are those of
the slowest.
"""

NOZZLE = {
    "nozzle_diameter": f"{PRINT_SETTINGS.nozzle_mm:g}",
    "filament_diameter": "1.75",
    # In mm3/s; OrcaSlicer has 18 for PLA on the Ender-3 V3 SE.
    "filament_max_volumetric_speed": "12",
}


def settings_of(printer: Printer) -> dict[str, str]:
    """The settings of a print with a printer's speeds, under PrusaSlicer's names."""
    return LAYERS | SPEEDS[printer.speeds]


def printer_settings(printer: Printer) -> dict[str, str]:
    """The bed and the plastic of a printer, under PrusaSlicer's names."""
    width, length, height = (f"{side:g}" for side in printer.bed_mm)
    return {
        "bed_shape": f"0x0,{width}x0,{width}x{length},0x{length}",
        "max_print_height": height,
        "filament_density": f"{printer.plastic_g_per_cm3:g}",
    }


def prusa_profile(printer: Printer) -> str:
    """The profile as an INI file for PrusaSlicer and SuperSlicer, without support, since no part needs any."""
    settings = settings_of(printer) | {"support_material": "0"} | NOZZLE | printer_settings(printer)
    settings |= {"print_settings_id": PROFILE}
    return "".join(f"{name} = {value}\n" for name, value in sorted(settings.items()))


def embedded(profile: str) -> str:
    """A profile for a 3MF project of PrusaSlicer: settings as comments, after a first line that the slicer skips."""
    return f"; {PROFILE}\n\n" + "".join(f"; {line}\n" for line in profile.splitlines())


def orca_profile(printer: Printer) -> str:
    """The profile as a process for OrcaSlicer and Bambu Studio, with their setting names, without a printer.

    Both identify a process by its `print_settings_id`, and reject one without a version; every value is a string.
    """
    common = settings_of(printer)
    settings = {
        "type": "process",
        "name": PROFILE,
        "print_settings_id": PROFILE,
        "from": "User",
        "version": "1.6.0.0",
        "layer_height": common["layer_height"],
        "initial_layer_print_height": common["first_layer_height"],
        "wall_loops": common["perimeters"],
        "wall_generator": common["perimeter_generator"],
        "sparse_infill_density": common["fill_density"],
        "sparse_infill_pattern": common["fill_pattern"],
        "minimum_sparse_infill_area": common["solid_infill_below_area"],
        "enable_support": "0",
        "inner_wall_speed": common["perimeter_speed"],
        "outer_wall_speed": common["external_perimeter_speed"],
        "sparse_infill_speed": common["infill_speed"],
        "internal_solid_infill_speed": common["solid_infill_speed"],
        "top_surface_speed": common["top_solid_infill_speed"],
        "gap_infill_speed": common["gap_fill_speed"],
        "travel_speed": common["travel_speed"],
        "default_acceleration": common["default_acceleration"],
    }
    return json.dumps(settings, indent=4) + "\n"


PROGRAMS = ("prusa-slicer", "prusa-slicer-console", "PrusaSlicer")
OPTIONS = {
    "gcode-flavor": "marlin2",
    # PrusaSlicer requires this reset at every layer for relative extrusion.
    "layer-gcode": "G92 E0",
}
SWITCHES = (
    "--export-gcode",
    "--dont-arrange",
    "--use-relative-e-distances",
    "--support-material",
    "--support-material-auto",
    "--dont-support-bridges",
    "--no-overhangs",
)
# Reduction of the threshold, so that faces at the overhang limit get no support: a degree for rounding, and one that
# the slicer adds.
THRESHOLD_MARGIN_DEG = 2.0
TIMEOUT_S = 900.0


@dataclass(frozen=True)
class Sliced:
    """The slicer's figures for a part: printing time, mass of plastic including infill, and filament for support."""

    minutes: float
    grams: float
    support_mm: float


@cache
def find_slicer() -> str | None:
    """The slicer's path; None if it is not installed."""
    return next((path for program in PROGRAMS if (path := shutil.which(program))), None)


@cache
def slicer_version() -> str | None:
    """Name and version of the slicer, such as "PrusaSlicer-2.5.0"; None if it is not installed."""
    program = find_slicer()
    if program is None:
        return None
    run = run_program([program, "--help"], timeout_s=TIMEOUT_S)
    run.check_returncode()
    version = re.search(r"PrusaSlicer-[\d.]+", run.stdout.decode("utf-8", "replace"))
    return version.group() if version else program


def slice_3mf(path: Path, printer: Printer) -> Sliced | None:
    """Slice a 3MF file in its orientation; None if the slicer rejects it.

    Raises FileNotFoundError if no slicer is installed.
    """
    program = find_slicer()
    if program is None:
        raise FileNotFoundError("PrusaSlicer is not installed")
    settings = settings_of(printer) | NOZZLE | printer_settings(printer)
    acceleration = settings["default_acceleration"]
    options = OPTIONS | {
        **{name.replace("_", "-"): value for name, value in settings.items()},
        # The time is estimated with the machine's limits.
        "machine-max-acceleration-extruding": acceleration,
        "machine-max-acceleration-travel": acceleration,
        "support-material-threshold": f"{90.0 - printer.overhang_deg - THRESHOLD_MARGIN_DEG:.0f}",
    }
    with TemporaryDirectory() as folder:
        gcode = Path(folder) / "part.gcode"
        arguments = [word for name, value in options.items() for word in (f"--{name}", value)]
        command = [program, *SWITCHES, *arguments, "--datadir", folder, "--output", str(gcode), str(path.resolve())]
        run = run_program(command, timeout_s=TIMEOUT_S)
        if run.returncode != 0 or not gcode.exists():
            return None
        return read_gcode(gcode.read_text(encoding="utf-8", errors="replace"))


def read_gcode(text: str) -> Sliced | None:
    """Time, grams and support from a G-code file with relative extrusion; None if it prints nothing."""
    summary = text[text.rfind("\n; filament used [mm]") :]
    time = re.search(r"^; estimated printing time \(normal mode\) = (.+)$", summary, re.MULTILINE)
    grams = re.search(r"^; filament used \[g\] = ([\d.]+)", summary, re.MULTILINE)
    if time is None or grams is None or float(grams.group(1)) == 0.0:
        return None
    counts = dict(reversed(pair) for pair in re.findall(r"(\d+)([dhms])", time.group(1)))
    seconds = sum(
        int(counts.get(unit, 0)) * unit_seconds for unit, unit_seconds in zip("dhms", (86400, 3600, 60, 1), strict=True)
    )
    support = 0.0
    for section in text.split(";TYPE:")[1:]:
        if section.startswith("Support material"):
            moves = re.findall(r"^G1 .*X.* E([\d.]+)", section, re.MULTILINE)
            support += sum(map(float, moves))
    return Sliced(seconds / 60.0, float(grams.group(1)), support)


def check_slicing(path: Path, printer: Printer) -> dict[str, Metric]:
    """Check that a 3MF file slices without support, and report time and plastic; {} without a slicer."""
    if find_slicer() is None:
        return {}
    sliced = slice_3mf(path, printer)
    checks = {"slices": Metric(value=sliced is not None, unit="", limit=1, lower_is_better=False)}
    if sliced:
        checks |= {
            "print_minutes": Metric(value=round(sliced.minutes, 1), unit="min"),
            "print_g": Metric(value=sliced.grams, unit="g"),
            "support_filament_mm": Metric(value=round(sliced.support_mm, 2), unit="mm", limit=0.0),
        }
    return checks
