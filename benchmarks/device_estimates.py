"""Errors of `estimate_device` against devices as built: `python -m benchmarks.device_estimates [--build [DEVICE ...]]`.

Designs the recorded devices again, estimates them, and prints the errors of those that the fit has not seen, and the
coefficients that the others give. `--build` makes and slices the parts of devices, which takes a minute for each and
requires PrusaSlicer, and writes their figures to `device_estimates.json`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.cad.plan.estimates import DeviceMeasures, estimate_device
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera_library import named_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import stock_fields

RECORD = Path(__file__).with_suffix(".json")
LASER = {"shape": "free", **stock_fields("first-acrylic-1")}
DEVICES: dict[str, dict[str, Any]] = {
    "3x3 80": {},
    "3x3 80 free acrylic": LASER,
    "2x2 80": {"rows": 2, "cols": 2},
    "3x3 110": {"scale_mm": 110.0, "depths_mm": (400.0, 700.0)},
    "1x2 60": {"rows": 1, "cols": 2, "scale_mm": 60.0},
    "4x4 100 free acrylic": {"rows": 4, "cols": 4, "scale_mm": 100.0} | LASER,
    "3x3 50 free acrylic": {"scale_mm": 50.0} | LASER,
    "2x3 90 fold 105": {"rows": 2, "cols": 3, "scale_mm": 90.0, "fold_deg": 105.0},
    "3x3 80 fold 135": {"fold_deg": 135.0},
    "brio 4x4 90": {"camera": "brio", "rows": 4, "cols": 4, "scale_mm": 90.0},
    "2x2 130": {"rows": 2, "cols": 2, "scale_mm": 130.0, "depths_mm": (500.0, 900.0)},
    "pi_camera_3 2x2 90 acrylic": {"camera": "pi_camera_3", "rows": 2, "cols": 2, "scale_mm": 90.0}
    | stock_fields("first-acrylic-1"),
    "brio 3x3 70": {"camera": "brio", "scale_mm": 70.0},
    "pi_camera_3 3x3 60": {"camera": "pi_camera_3", "scale_mm": 60.0},
    "2x4 70 second glass": {"rows": 2, "cols": 4, "scale_mm": 70.0} | stock_fields("second-glass-2"),
    "1x3 100 free acrylic": {"rows": 1, "cols": 3, "scale_mm": 100.0} | LASER,
    "3x3 65 second glass": {"scale_mm": 65.0} | stock_fields("second-glass-2"),
    "3x4 75 fold 110 free": {"rows": 3, "cols": 4, "scale_mm": 75.0, "fold_deg": 110.0} | LASER,
    "elp_4k 2x4 80": {"camera": "elp_4k", "rows": 2, "cols": 4},
    "oak_d 2x2 70 acrylic": {"camera": "oak_d", "rows": 2, "cols": 2, "scale_mm": 70.0} | LASER,
    "c922 3x3 95 fold 126": {"camera": "c922", "scale_mm": 95.0, "fold_deg": 126.0},
}
"""Fields of the designs that differ from the default."""
TESTED = tuple(DEVICES)[-9:]
"""Devices that the fit does not see."""
FIGURES = ("height", "depth", "width", "mass", "plastic", "printing", "price")


class BuiltDevice(Value):
    """The figures of a device as built and sliced, and grams and minutes of its parts; `layout` is its identity."""

    layout: str
    size_mm: tuple[float, float, float]
    mass_g: float
    plastic_g: float
    print_h: float
    price_eur: float
    parts: dict[str, tuple[float, float]]

    @property
    def figures(self) -> FloatArray:
        """The `FIGURES`."""
        width, height, depth = self.size_mm
        return np.array([height, depth, width, self.mass_g, self.plastic_g, self.print_h, self.price_eur])

    def grams(self, *names: str) -> float:
        """Plastic of the parts whose names start so."""
        return sum(grams for part, (grams, _) in self.parts.items() if part.startswith(names))


def layout_of(name: str) -> Layout:
    """The design of a device."""
    fields = DEVICES[name]
    return design(
        DesignSpec().replaced(**fields | ({"camera": named_camera(fields["camera"])} if "camera" in fields else {}))
    )


def built(name: str, out: Path) -> BuiltDevice:
    """Make and slice the parts of a device."""
    from mirrorcam.cad.assembly.bill import bill_of
    from mirrorcam.cad.assembly.catalogue import parts_of
    from mirrorcam.cad.assembly.components import components_of
    from mirrorcam.cad.assembly.device_plan import plan_device
    from mirrorcam.cad.mirrors.sheet_files import write_sheets
    from mirrorcam.cad.part_files import make_part

    layout = layout_of(name)
    hardware = HARDWARE.for_layout(layout)
    device = plan_device(layout, hardware)
    parts = [make_part(plan, hardware.printer, out, None, hardware.screw) for plan in parts_of(device)]
    bill = bill_of(device, parts, write_sheets(out / "mirrors", layout, hardware.cutting))
    if bill.print_minutes is None:
        raise SystemExit("PrusaSlicer is not installed")
    components = components_of(device, parts)
    points = np.vstack([component.mesh.vertices for component in components]) @ device.back.rig_from_stand
    right, forward, up = np.ptp(points, axis=0).round(1).tolist()
    printed_g = {part.name: part.checks["print_g"].value for part in parts}
    return BuiltDevice(
        layout=layout.identity,
        size_mm=(right, up, forward),
        mass_g=round(sum(printed_g.get(each.name, each.mass.mass_g) for each in components), 1),
        plastic_g=bill.plastic_g,
        print_h=round(bill.print_minutes / 60.0, 2),
        price_eur=bill.price,
        parts={part.name: (printed_g[part.name], part.checks["print_minutes"].value) for part in parts},
    )


def estimated(layout: Layout) -> FloatArray:
    """The `FIGURES` as estimated."""
    found = estimate_device(layout)
    width, height, depth = found.size_mm
    return np.array([height, depth, width, found.mass_g, found.plastic_g, found.print_h, found.price_eur])


@dataclass(frozen=True)
class Fit:
    """Coefficients of the estimates: the terms that they multiply, what was measured, and what is known of it."""

    terms: Callable[[DeviceMeasures, BuiltDevice], Sequence[float] | FloatArray]
    measured: Callable[[BuiltDevice], float]
    known: Callable[[DeviceMeasures], float] = lambda _: 0.0


FITS = {
    "HEIGHT": Fit(
        lambda m, _: (1.0 / np.cos(np.deg2rad(m.lean_deg)), m.mirrors_reach_mm[0]),
        lambda b: b.size_mm[1],
        lambda m: m.camera_reach_mm[0],
    ),
    "DEPTH": Fit(lambda m, _: (1.0, m.mirrors_reach_mm[1]), lambda b: b.size_mm[2], lambda m: m.camera_reach_mm[1]),
    "HOLDER_G": Fit(lambda m, _: m.holder, lambda b: b.grams("mirror_holder")),
    "MOUNT_G": Fit(lambda m, _: m.mount, lambda b: b.grams("mount", "adapter")),
    "CLIP_G": Fit(lambda m, _: (1.0, m.camera_cm2), lambda b: b.grams("camera_clip")),
    "COUPON_G": Fit(lambda m, _: (1.0,), lambda b: b.grams("fit_coupon")),
    "PRINT_H": Fit(lambda m, b: (b.plastic_g, len(m.layout.mirrors), 1.0), lambda b: b.print_h),
}


def fitted(measures: Mapping[str, DeviceMeasures], devices: Mapping[str, BuiltDevice]) -> dict[str, FloatArray]:
    """The coefficients with the smallest sum of squared relative errors, over the devices that are not tested."""
    names = [name for name in devices if name not in TESTED]
    found = {}
    for coefficients, fit in FITS.items():
        wanted = np.array([fit.measured(devices[name]) for name in names])
        rows = np.array([fit.terms(measures[name], devices[name]) for name in names]) / wanted[:, None]
        known = np.array([fit.known(measures[name]) for name in names]) / wanted
        found[coefficients] = np.linalg.lstsq(rows, 1.0 - known, rcond=None)[0]
    return found


def read_devices() -> dict[str, BuiltDevice]:
    """The recorded devices."""
    recorded = json.loads(RECORD.read_text(encoding="utf-8"))
    return {name: BuiltDevice.model_validate_json(json.dumps(fields)) for name, fields in recorded.items()}


def main() -> None:
    """Print the table, and write its record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", nargs="*", metavar="DEVICE", help=", ".join(DEVICES))
    add_json_option(parser)
    arguments = parser.parse_args()
    devices = read_devices()
    if arguments.build is not None:
        for name in arguments.build or DEVICES:
            with tempfile.TemporaryDirectory() as folder:
                devices[name] = built(name, Path(folder))
            lines = (f"{json.dumps(each)}: {devices[each].model_dump_json()}" for each in DEVICES if each in devices)
            RECORD.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    layouts = {name: layout_of(name) for name in devices}
    rows = Rows("device", *FIGURES)
    errors = {}
    for name, device in devices.items():
        if layouts[name].identity != device.layout:
            parser.error(f"{name} was built from another layout: run with --build")
        errors[name] = estimated(layouts[name]) / device.figures - 1.0
        rows.add(name + " (tested)" * (name in TESTED), *(f"{100.0 * error:+.1f} %" for error in errors[name]))
    for title, names in (("fitted", devices.keys() - set(TESTED)), ("tested", set(TESTED) & devices.keys())):
        rms = np.sqrt(np.mean([errors[name] ** 2 for name in names], axis=0))
        rows.add(f"RMS, {len(names)} {title}", *(f"{100.0 * error:.1f} %" for error in rms))
    measures = {name: DeviceMeasures(layout, HARDWARE.for_layout(layout)) for name, layout in layouts.items()}
    for name, values in fitted(measures, devices).items():
        print(name, *(f"{value:.3g}" for value in values))
    write_record(arguments.json, "device_estimates", {}, rows.table)


if __name__ == "__main__":
    main()
