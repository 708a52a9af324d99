"""Whole devices, built and checked: `python -m benchmarks.devices [DEVICE ...] [--out FOLDER] [--json FILE]`.

For each device: the design, and all files as `mirrorcam cad` writes them, with their checks, which include slicing
without support by PrusaSlicer where it is installed. FreeCAD reads every STEP file where it is installed, otherwise
build123d does, the program that wrote them.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from build123d import import_step

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import Metric
from mirrorcam.device.hardware_choice import HardwareChoice
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_body import CameraBody
from mirrorcam.optics.geometry.camera_library import CameraProfile, named_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import stock_fields
from tests.cad.write.freecad import LISTED, find_freecad, run_in_freecad

CUBE_29 = CameraBody.model_validate(
    {
        "name": "29 mm machine-vision camera",
        "width_mm": 29.0,
        "height_mm": 29.0,
        "depth_mm": 30.0,
        "pupil_behind_front_mm": -15.0,
        "lens_ring_mm": 28.0,
        "lens_protrusion_mm": 25.0,
        "cable_mm": 6.0,
        "mass_g": 80.0,
        "held_by": {
            "kind": "threads",
            "thread": "M3",
            "thread_depth_mm": 3.0,
            "threads_mm": ((-10.0, 8.0), (10.0, 8.0)),
        },
    }
)
BODY_700 = CameraBody.model_validate(
    {
        "name": "body of 700 g with a tripod thread",
        "width_mm": 130.0,
        "height_mm": 100.0,
        "depth_mm": 75.0,
        "pupil_behind_front_mm": -30.0,
        "lens_ring_mm": 65.0,
        "lens_protrusion_mm": 60.0,
        "cable_mm": 5.0,
        "mass_g": 700.0,
        "held_by": {
            "kind": "threads",
            "thread": "1/4-20 UNC",
            "thread_depth_mm": 6.0,
            "threads_mm": ((0.0, 30.0),),
        },
    }
)
# The lens of the default camera in the large body.
CAMERA_700 = CameraProfile(name=BODY_700.name, optics=Camera.c920().replaced(body_mm=None), body=BODY_700)


@dataclass(frozen=True)
class Variant:
    """Fields of the design that differ from the default, the choice of hardware, and a body of a camera."""

    spec: dict[str, Any] = field(default_factory=dict)
    choice: dict[str, Any] = field(default_factory=dict)
    body: CameraBody | None = None

    def hardware(self, layout: Layout) -> Hardware:
        """The hardware for a layout."""
        hardware = HardwareChoice(**self.choice).read(layout)
        return hardware if self.body is None else hardware.replaced(camera=self.body)


DEVICES = {
    "3x3, rectangles": Variant(),
    "1x2": Variant({"rows": 1, "cols": 2}),
    "4x4": Variant({"rows": 4, "cols": 4}),
    "hex7": Variant({"pattern": Pattern.hexagonal(1)}),
    "stock 25x15, 30x20": Variant({"shape": "stock:25x15,30x20"}),
    "second-glass-3": Variant(stock_fields("second-glass-3")),
    "tape": Variant(choice={"mounting": "tape"}),
    "brio, tripod": Variant({"camera": named_camera("brio")}, {"adapter": "tripod"}),
    "pi_camera_3, vesa": Variant({"camera": named_camera("pi_camera_3")}, {"adapter": "vesa"}),
    "gen3": Variant(choice={"adapter": "gen3"}),
    "29 mm cube": Variant(body=CUBE_29),
    "700 g body": Variant({"camera": CAMERA_700.camera}, body=BODY_700),
}


def build(variant: Variant, out: Path) -> tuple[float, dict[str, Metric]]:
    """Build a device; returns the wall time in s without the design, and all figures."""
    layout = design(DesignSpec().replaced(**variant.spec))
    start = time.perf_counter()
    checks = build_parts(layout, out, variant.hardware(layout), workers=cores())
    return time.perf_counter() - start, checks


def invalid_steps(paths: Iterable[Path]) -> int:
    """Number of STEP files that FreeCAD, or else build123d, does not read as valid, closed solids."""
    names = [str(path.resolve()) for path in paths]
    if find_freecad() is None:
        shapes = [import_step(name) for name in names]
        return sum(not (shape.solids() and all(solid.is_valid for solid in shape.solids())) for shape in shapes)
    script = f"""{LISTED}
found = []
for name in {names!r}:
    document = FreeCAD.newDocument()
    things = [thing for thing in listed(name, document) if thing["kind"] != "Group"]
    solid = any(thing["solids"] for thing in things)
    found.append(solid and all(thing["valid"] and all(thing["closed"]) for thing in things))
    FreeCAD.closeDocument(document.Name)
"""
    with tempfile.TemporaryDirectory() as folder:
        return run_in_freecad(script, Path(folder)).count(False)


def main() -> None:
    """Print the table, and write its record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("devices", nargs="*", metavar="DEVICE", help=", ".join(DEVICES))
    parser.add_argument("--out", type=Path, default=Path("output/devices"), help="folder of the devices' files")
    add_json_option(parser)
    arguments = parser.parse_args()
    if unknown := set(arguments.devices) - DEVICES.keys():
        parser.error(f"unknown device {min(unknown)}, expected {', '.join(DEVICES)}")
    reader = "FreeCAD" if find_freecad() else "build123d"
    rows = Rows("device", "build", "mass", "plastic", "printing", "price", "checks", f"invalid STEP ({reader})")
    for name in arguments.devices or DEVICES:
        out = arguments.out / name.replace(",", "").replace(" ", "-")
        try:
            seconds, checks = build(DEVICES[name], out)
        except InputError as error:
            rows.add(name, f"refused: {error}", *("",) * 6)
            continue
        limited = [check for check in checks.values() if check.limit is not None]
        plastic_g = sum(check.value for key, check in checks.items() if key.endswith(".print_g"))
        sliced = "device.print_minutes" in checks
        rows.add(
            name,
            f"{seconds:.0f} s",
            f"{checks['device.mass_g'].value:.0f} g",
            f"{plastic_g:.0f} g" if sliced else "not sliced",
            f"{checks['device.print_minutes'].value / 60.0:.1f} h" if sliced else "not sliced",
            f"{checks['device.price'].value:.0f} {checks['device.price'].unit}",
            f"{sum(check.passed for check in limited)} of {len(limited)}",
            str(invalid_steps([out / "assembly.step", *sorted((out / "parts").glob("*.step"))])),
        )
    write_record(arguments.json, "devices", {}, rows.table)


if __name__ == "__main__":
    main()
