"""Files and figures of a device's elasticity: `elasticity.md`, and the table that a robot corrects its layout by."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.elasticity.device_motions import device_motions
from mirrorcam.cad.checks.elasticity.errors import Error, Errors, all_errors, errors_of, gravity_table
from mirrorcam.cad.checks.elasticity.plastics import plastic_named
from mirrorcam.cad.checks.elasticity.tetrahedra import NO_GMSH, gmsh_program
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import working_distance_mm
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.values import InputError, Metric

# Finer elements differ by up to 5 % (docs/elasticity.md).
SIZE_MM = 6.0
# What images may move against each other, in px: as much as a calibration's corners scatter, for gravity and for creep;
# .1 px per K for warmth.
GRAVITY_PX, CREEP_PX, WARMTH_PX = 0.1, 0.1, 1.0
# What mirrors may turn against the camera, in deg: as much as the mount alone may bend.
TURN_DEG = 0.05
SCHEMA = "mirrorcam.elasticity/1"
TEXT = """# Gravity, warmth and creep

By finite elements of holder, mount and clip in {plastic} ({modulus:g} MPa), for points {depth:g} mm away. An error is
the turn of the mirror that turns most against the camera; the shift of the image that moves most; and, in brackets,
what is left of that where the motion of all mirrors as one body is estimated from pictures, as `mirrorcam drift` does.
`robot/gravity.json` has the motions per gravity, by which `layout_in_pose` corrects a layout.

| plastic | gravity, 1 g | corrected by the table | 10 K | creep, 1000 h |
|---|---|---|---|---|
{rows}

Limits: {turn:g}° each; of what is in brackets, gravity {gravity:g} px, 10 K {warmth:g} px, creep {creep:g} px.

Recommended: {recommended}, whose largest part of a limit is the smallest, of plastics that swell less in the air of a
room than they expand in 10 K.
"""


def require_solvable(hardware: Hardware) -> None:
    """Raise InputError where gmsh is missing, or the plastic is not in the table."""
    if gmsh_program() is None:
        raise InputError(NO_GMSH)
    plastic_named(hardware.printer.plastic, hardware.printer.plastic_mpa, hardware.printer.plastic_g_per_cm3)


def write_elasticity(out: Path, device: Device) -> dict[str, Metric]:
    """Write `elasticity.md`, `elasticity.json` and `robot/gravity.json` of a device; return its figures.

    Raises InputError where gmsh is missing, cannot mesh a part, or the plastic is not in the table.
    """
    printer, layout = device.hardware.printer, device.layout
    plastic = plastic_named(printer.plastic, printer.plastic_mpa, printer.plastic_g_per_cm3)
    depth = working_distance_mm(layout, device.hardware)
    motions = device_motions(device, SIZE_MM)
    errors = all_errors(layout, motions, depth)
    text = TEXT.format(
        plastic=plastic.name,
        modulus=plastic.modulus_mpa,
        depth=depth,
        rows="\n".join(_row(each) for each in errors),
        turn=TURN_DEG,
        gravity=GRAVITY_PX,
        warmth=WARMTH_PX,
        creep=CREEP_PX,
        recommended=recommended(errors),
    )
    write_text(out / "elasticity.md", text)
    own = errors_of(layout, motions, depth, plastic)
    write_text(out / "elasticity.json", json.dumps(table_of(errors, own, depth), indent=1) + "\n")
    gravity_table(layout, motions, plastic).save(out / "robot" / "gravity.json")
    return figures(own)


def table_of(errors: Sequence[Errors], own: Errors, depth_mm: float) -> dict[str, Any]:
    """The content of `elasticity.json`: each plastic's errors with whether they pass, and of `own` each mirror's turn.

    Lengths are in mm, angles in deg; `apart_px` is what is left where the motion of all mirrors as one is known.
    """
    return {
        "schema": SCHEMA,
        "depth_mm": depth_mm,
        "elements_mm": SIZE_MM,
        "limits": {"deg": TURN_DEG, "apart_px": {"gravity": GRAVITY_PX, "10_k": WARMTH_PX, "creep": CREEP_PX}},
        "plastics": {each.plastic.name: _rounded(each) for each in errors},
        "recommended": recommended(errors),
        "device": {"plastic": own.plastic.name, "modulus_mpa": own.plastic.modulus_mpa, **_rounded(own)},
        "mirrors_10_k_deg": {name: round(deg, 5) for name, deg in own.mirrors_warmth_deg.items()},
    }


def _rounded(errors: Errors) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, error in (("gravity", errors.gravity), ("10_k", errors.warmth), ("creep", errors.creep)):
        found[name] = {"deg": round(error.deg, 4), "px": round(error.px, 3), "apart_px": round(error.apart_px, 3)}
    found["corrected"] = {"deg": round(errors.corrected.deg, 4), "px": round(errors.corrected.px, 3)}
    return found | {"passed": all(figure.passed for figure in figures(errors).values())}


def figures(errors: Errors) -> dict[str, Metric]:
    """The figures of a device in its plastic, and their limits."""
    named = {
        "gravity": (errors.gravity, GRAVITY_PX),
        "10_k": (errors.warmth, WARMTH_PX),
        "creep": (errors.creep, CREEP_PX),
    }
    found = {}
    for name, (error, limit) in named.items():
        found[f"elastic.{name}_deg"] = Metric(value=round(error.deg, 4), unit="deg", limit=TURN_DEG)
        found[f"elastic.{name}_px"] = Metric(value=round(error.px, 3), unit="px")
        found[f"elastic.{name}_apart_px"] = Metric(value=round(error.apart_px, 3), unit="px", limit=limit)
    return found | {"elastic.corrected_px": Metric(value=round(errors.corrected.px, 3), unit="px")}


def part_of_limits(errors: Errors) -> float:
    """The largest part of its limit that an error is."""
    turn = max(error.deg for error in (errors.gravity, errors.warmth, errors.creep)) / TURN_DEG
    return max(
        turn, errors.gravity.apart_px / GRAVITY_PX, errors.warmth.apart_px / WARMTH_PX, errors.creep.apart_px / CREEP_PX
    )


def recommended(errors: Sequence[Errors]) -> str:
    """The plastic whose errors are the smallest part of their limits, of those that swell less than in 10 K."""
    steady = [each for each in errors if each.plastic.swelling < 10.0 * each.plastic.strain_per_k]
    return min(steady, key=part_of_limits).plastic.name


def _row(errors: Errors) -> str:
    cells = (_cell(each) for each in (errors.gravity, errors.corrected, errors.warmth, errors.creep))
    return f"| {errors.plastic.name} | {' | '.join(cells)} |"


def _cell(error: Error) -> str:
    return f"{error.deg:.3f}°, {error.px:.2f} px ({error.apart_px:.3f})"
