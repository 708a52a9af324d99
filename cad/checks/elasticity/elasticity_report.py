"""Calibration errors due to gravity, temperature and creep: rotations of mirrors, shifts of images, and their files.

`elasticity.md` and `elasticity.json` report them for every plastic. A robot corrects its layout with
`robot/gravity.json`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.elasticity.device_motions import (
    PLASTICS,
    SUPPORT_CTE_PER_K,
    DeviceMotions,
    Plastic,
    device_motions,
    plastic_named,
)
from mirrorcam.cad.checks.elasticity.tetrahedra import NO_GMSH, gmsh_program
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import working_distance_mm
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import GravityTable, MirrorMotion, image_shifts_px

TEMPERATURE_RISE_K = 10.0
# Fraction of the error due to gravity that the table does not correct: the modulus of prints is uncertain by a fifth.
RESIDUAL_FRACTION = 0.2
# Factor on motions in the numerical derivatives of image points, which are linear in such small motions.
STEP = 0.1


@dataclass(frozen=True)
class Error:
    """Largest rotation in deg of a mirror relative to the camera, and largest shift in px of an image.

    `residual_px` is the largest residual shift after the common motion of all mirrors has been estimated from pictures.
    """

    deg: float
    px: float
    residual_px: float

    def times(self, factor: float) -> Error:
        return Error(self.deg * factor, self.px * factor, self.residual_px * factor)


@dataclass(frozen=True)
class Errors:
    """Errors of a device printed in one plastic that its calibration does not include.

    `gravity` is for a change from no gravity to 1 g in the worst direction; turning the device upside down doubles it.
    `corrected` remains after correction by the table. `heating` is for 10 K, `creep` for 1000 h in the worst direction.
    `mirrors_heating_deg` are the rotations of the mirrors for 10 K, by name.
    """

    plastic: Plastic
    gravity: Error
    corrected: Error
    heating: Error
    creep: Error
    mirrors_heating_deg: Mapping[str, float]


def errors_of(layout: Layout, motions: DeviceMotions, depth_mm: float, plastic: Plastic) -> Errors:
    """The errors of a device in one plastic, for scene points at a depth along the view axis."""
    sag = motions.under_gravity(plastic.modulus_mpa, plastic.density_g_per_cm3)
    gravity = Error(_worst_rotation_deg(sag), *_worst_shifts_px(layout, sag, depth_mm))
    expansion = motions.under_strain(
        plastic.cte_per_k * TEMPERATURE_RISE_K,
        SUPPORT_CTE_PER_K * TEMPERATURE_RISE_K,
        motions.mirror_cte_per_k * TEMPERATURE_RISE_K,
    )
    heating = {name: motion[:, None] for name, motion in expansion.items()}
    return Errors(
        plastic=plastic,
        gravity=gravity,
        corrected=gravity.times(RESIDUAL_FRACTION),
        heating=Error(_worst_rotation_deg(heating), *_worst_shifts_px(layout, heating, depth_mm)),
        creep=gravity.times(plastic.creep),
        mirrors_heating_deg={name: float(np.degrees(np.linalg.norm(motion[3:]))) for name, motion in expansion.items()},
    )


def all_errors(layout: Layout, motions: DeviceMotions, depth_mm: float) -> tuple[Errors, ...]:
    """The errors with each plastic of the table."""
    return tuple(errors_of(layout, motions, depth_mm, plastic) for plastic in PLASTICS)


def gravity_table(layout: Layout, motions: DeviceMotions, plastic: Plastic) -> GravityTable:
    """The table by which a robot corrects the layout for a pose."""
    mirrors = {}
    sag = motions.under_gravity(plastic.modulus_mpa, plastic.density_g_per_cm3)
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        motion = sag[name]
        normal, centre, distance = mirror.normal_in_rig, mirror.rig_from_plane[:3, 3], mirror.distance_mm
        # The plane is n.x = -d, its virtual centre -2 d n.
        d_normal = np.cross(motion[3:], normal, axisa=0).T
        d_distance = -(normal @ motion[:3] + centre @ d_normal)
        plane = -2.0 * (np.outer(normal, d_distance) + distance * d_normal)
        mirrors[name] = MirrorMotion(shift_mm=motion[:3], turn_rad=motion[3:], plane_mm=plane)
    return GravityTable(mirrors=mirrors, plastic=plastic.name, modulus_mpa=plastic.modulus_mpa)


def _worst_rotation_deg(motions: Mapping[str, FloatArray]) -> float:
    return float(np.degrees(max(np.linalg.norm(motion[3:], ord=2) for motion in motions.values())))


def _worst_shifts_px(layout: Layout, motions: Mapping[str, FloatArray], depth_mm: float) -> tuple[float, float]:
    """Largest image shift for a unit vector of k loads, from motions (6, k) of each mirror per unit load.

    The second value is the residual after the common motion of all mirrors has been estimated from pictures, as in
    `drift`.
    """
    shifts = _shifts_px(layout, motions, depth_mm)
    units = {}
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        rotation = np.cross(np.eye(3), mirror.rig_from_plane[:3, 3]).T
        units[name] = np.block([[np.eye(3), rotation], [np.zeros((3, 3)), np.eye(3)]]) * [*[1.0] * 3, *[1e-2] * 3]
    common = _shifts_px(layout, units, depth_mm)
    residual = shifts - common @ np.linalg.lstsq(common, shifts, rcond=None)[0]
    total, residual_px = (
        float(np.linalg.norm(pixels.reshape(-1, 2, pixels.shape[1]), ord=2, axis=(1, 2)).max())
        for pixels in (shifts, residual)
    )
    return total, residual_px


def _shifts_px(layout: Layout, motions: Mapping[str, FloatArray], depth_mm: float) -> FloatArray:
    """Image shifts (2 n, k) in px per unit of each load: x and y of every point."""
    columns = []
    for load in range(next(iter(motions.values())).shape[1]):
        mirrors = tuple(
            mirror.moved(
                Rotation.from_rotvec(STEP * motions[name][3:, load]).as_matrix(), STEP * motions[name][:3, load]
            )
            for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)
        )
        as_moved = layout.replaced(kind="as-built", mirrors=mirrors, metrics={}, verdict={})
        columns.append(np.vstack(image_shifts_px(layout, as_moved, depth_mm)).ravel() / STEP)
    return np.stack(columns, axis=-1)


# Size of the elements; finer ones change the result by up to 5 % (docs/elasticity.md).
SIZE_MM = 6.0
# Limits of the residual shifts of images in px: for gravity and creep the scatter of a calibration's corners, and for
# temperature .1 px per K.
GRAVITY_PX, CREEP_PX, HEATING_PX = 0.1, 0.1, 1.0
# Limit of the rotation of mirrors relative to the camera in deg, equal to the limit for the mount alone.
ROTATION_DEG = 0.05
SCHEMA = "mirrorcam.elasticity/1"
TEXT = """# Gravity, temperature and creep

By finite elements of holder, mount and clip in {plastic} ({modulus:g} MPa), for points {depth:g} mm away. Errors are
the largest rotation of a mirror relative to the camera, the largest shift of an image and, in brackets, the residual
shift after the common motion of all mirrors has been estimated from pictures, as `mirrorcam drift` does.
`robot/gravity.json` has the motions due to gravity, with which `layout_in_pose` corrects a layout.

| plastic | gravity, 1 g | corrected by the table | 10 K | creep, 1000 h |
|---|---|---|---|---|
{rows}

Limits: rotations {rotation:g}°; residual shifts {gravity:g} px (gravity), {heating:g} px (10 K), {creep:g} px (creep).

Recommended: {recommended}, whose errors are the smallest relative to their limits, among plastics that swell less in
room humidity than they expand over 10 K.
"""


def require_solvable(hardware: Hardware) -> None:
    """Raise InputError if gmsh is missing or the plastic is not in the table."""
    if gmsh_program() is None:
        raise InputError(NO_GMSH)
    plastic_named(hardware.printer.plastic, hardware.printer.plastic_mpa, hardware.printer.plastic_g_per_cm3)


def write_elasticity(out: Path, device: Device) -> dict[str, Metric]:
    """Write `elasticity.md`, `elasticity.json` and `robot/gravity.json` of a device; return its figures.

    Raises InputError if gmsh is missing or cannot mesh a part, or if the plastic is not in the table.
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
        rows="\n".join(_row(entry) for entry in errors),
        rotation=ROTATION_DEG,
        gravity=GRAVITY_PX,
        heating=HEATING_PX,
        creep=CREEP_PX,
        recommended=recommended(errors),
    )
    write_text(out / "elasticity.md", text)
    device_errors = errors_of(layout, motions, depth, plastic)
    write_text(out / "elasticity.json", json.dumps(table_of(errors, device_errors, depth), indent=1) + "\n")
    gravity_table(layout, motions, plastic).save(out / "robot" / "gravity.json")
    return figures(device_errors)


def table_of(errors: Sequence[Errors], device_errors: Errors, depth_mm: float) -> dict[str, Any]:
    """The content of `elasticity.json`: errors and verdicts of all plastics and the device, and mirror rotations.

    Lengths are in mm, angles in deg; `apart_px` is the residual shift after estimation of the mirrors' common motion.
    """
    return {
        "schema": SCHEMA,
        "depth_mm": depth_mm,
        "elements_mm": SIZE_MM,
        "limits": {"deg": ROTATION_DEG, "apart_px": {"gravity": GRAVITY_PX, "10_k": HEATING_PX, "creep": CREEP_PX}},
        "plastics": {entry.plastic.name: _rounded(entry) for entry in errors},
        "recommended": recommended(errors),
        "device": {
            "plastic": device_errors.plastic.name,
            "modulus_mpa": device_errors.plastic.modulus_mpa,
            **_rounded(device_errors),
        },
        "mirrors_10_k_deg": {name: round(deg, 5) for name, deg in device_errors.mirrors_heating_deg.items()},
    }


def _rounded(errors: Errors) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, error in (("gravity", errors.gravity), ("10_k", errors.heating), ("creep", errors.creep)):
        values[name] = {"deg": round(error.deg, 4), "px": round(error.px, 3), "apart_px": round(error.residual_px, 3)}
    values["corrected"] = {"deg": round(errors.corrected.deg, 4), "px": round(errors.corrected.px, 3)}
    return values | {"passed": all(figure.passed for figure in figures(errors).values())}


def figures(errors: Errors) -> dict[str, Metric]:
    """The figures of a device in its plastic, and their limits."""
    errors_and_limits = {
        "gravity": (errors.gravity, GRAVITY_PX),
        "10_k": (errors.heating, HEATING_PX),
        "creep": (errors.creep, CREEP_PX),
    }
    metrics = {}
    for name, (error, limit) in errors_and_limits.items():
        metrics[f"elastic.{name}_deg"] = Metric(value=round(error.deg, 4), unit="deg", limit=ROTATION_DEG)
        metrics[f"elastic.{name}_px"] = Metric(value=round(error.px, 3), unit="px")
        metrics[f"elastic.{name}_apart_px"] = Metric(value=round(error.residual_px, 3), unit="px", limit=limit)
    return metrics | {"elastic.corrected_px": Metric(value=round(errors.corrected.px, 3), unit="px")}


def largest_ratio_to_limit(errors: Errors) -> float:
    """The largest ratio of an error to its limit."""
    deg = max(error.deg for error in (errors.gravity, errors.heating, errors.creep)) / ROTATION_DEG
    return max(
        deg,
        errors.gravity.residual_px / GRAVITY_PX,
        errors.heating.residual_px / HEATING_PX,
        errors.creep.residual_px / CREEP_PX,
    )


def recommended(errors: Sequence[Errors]) -> str:
    """The plastic with the smallest errors relative to limits, of those that swell less than they expand over 10 K."""
    stable = [candidate for candidate in errors if candidate.plastic.swelling < 10.0 * candidate.plastic.cte_per_k]
    return min(stable, key=largest_ratio_to_limit).plastic.name


def _row(errors: Errors) -> str:
    cells = (_cell(error) for error in (errors.gravity, errors.corrected, errors.heating, errors.creep))
    return f"| {errors.plastic.name} | {' | '.join(cells)} |"


def _cell(error: Error) -> str:
    return f"{error.deg:.3f}°, {error.px:.2f} px ({error.residual_px:.3f})"
