"""The stated tilt of mounts against finite elements of their solids, and these against CalculiX, where it is installed.

    python -m benchmarks.mount_stiffness [SIZE_MM]

Needs the extra `fe`. Of the default design, of one cut in two for the bed, and of mirrors tangent to a parabola.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.records import TIMES, Rows, add_json_option, write_record
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.checks.elasticity.condensed_solid import POISSON, Carried, Solid, rigid_motions
from mirrorcam.cad.checks.elasticity.device_motions import G, discs
from mirrorcam.cad.checks.elasticity.tetrahedra import Tetrahedra, tetrahedra_of
from mirrorcam.cad.parts.part_solids import make_mount
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.transforms import transform
from tests.cad.parabolas import parabola

DESIGNS = ((1, 2, 60.0), (2, 2, 60.0), (2, 2, 110.0), (3, 3, 100.0), (4, 4, 90.0), (5, 5, 70.0), (5, 5, 110.0))
# Middles of the edges of a tetrahedron, in the order of CalculiX's element C3D10.
MIDDLES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))


def meshed_mount(device: Device, size_mm: float) -> tuple[Tetrahedra, FloatArray, FloatArray]:
    """The mesh, the screws (n, 3) of foot and head, and their axes."""
    mount = device.mount
    head = transform(mount.rig_from_head, np.column_stack([mount.holes_in_head_mm, np.zeros(4)]))
    axes = np.array([*[(0.0, 0.0, 1.0)] * len(mount.foot), *[mount.rig_from_head[:3, 2]] * 4])
    with TemporaryDirectory() as folder:
        write_step(Path(folder, "mount.step"), make_mount(mount))
        return tetrahedra_of(Path(folder, "mount.step"), size_mm), np.vstack([mount.foot, head]), axes


def tilt_deg(device: Device, size_mm: float) -> float:
    """Tilt of a rigid holder in the worst direction of gravity, by finite elements of the mount."""
    mesh, at, axes = meshed_mount(device, size_mm)
    solid = Solid(mesh)
    condensed = solid.condensed(discs(solid.nodes, at, axes), at, {})
    feet = 6 * len(device.mount.foot)
    body = np.vstack([np.vstack([rigid_motions((p - device.mount.load_at)[None]), np.eye(6)[3:]]) for p in at[-4:]])
    held = condensed.stiffness[feet:, feet:] * device.hardware.printer.plastic_mpa
    turned = np.linalg.inv(body.T @ held @ body)[3:, :3]
    return float(np.degrees(np.linalg.norm(turned, ord=2))) * device.mount.load_g / 1000.0 * G


def sag_by_both_mm(device: Device, size_mm: float) -> tuple[float, float]:
    """How far the middle of the head sinks under the mount's own weight along y: by scikit-fem, and by CalculiX."""
    mesh, at, axes = meshed_mount(device, size_mm)
    solid = Solid(mesh)
    found = discs(solid.nodes, at, axes)
    feet, head = len(device.mount.foot), np.concatenate(found[-4:])
    carried = {"head": Carried(head, solid.nodes[head].mean(axis=0), 0.0, np.zeros(3))}
    # A weight of 1e-5 N/mm3, about that of PLA.
    ours = solid.condensed(found[:feet], at[:feet], carried).by_loads["head"][1, 1] * 1e-5
    theirs = ccx_sag_mm(mesh, solid.nodes, np.concatenate(found[:feet]), head)
    return ours / device.hardware.printer.plastic_mpa, theirs / device.hardware.printer.plastic_mpa


def ccx_sag_mm(mesh: Tetrahedra, nodes: FloatArray, fixed: NDArray[np.int64], told: NDArray[np.int64]) -> float:
    """Mean displacement along y of some nodes, by CalculiX with elements C3D10 and a modulus of 1 MPa."""
    number = {tuple(np.round(node, 6)): place + 1 for place, node in enumerate(nodes)}
    middle = [(mesh.points[mesh.corners[:, i]] + mesh.points[mesh.corners[:, j]]) / 2.0 for i, j in MIDDLES]
    corners = [mesh.points[mesh.corners[:, i]] for i in range(4)]
    elements = np.stack([*corners, *middle], axis=1)
    lines = ["*NODE"]
    lines += [f"{place + 1},{x:.9g},{y:.9g},{z:.9g}" for place, (x, y, z) in enumerate(nodes)]
    lines += ["*ELEMENT,TYPE=C3D10,ELSET=ALL"]
    for place, ten in enumerate(elements):
        lines.append(",".join(map(str, [place + 1, *(number[tuple(np.round(node, 6))] for node in ten)])))
    lines += ["*NSET,NSET=FIXED", *(f"{node + 1}," for node in fixed), "*NSET,NSET=TOLD", *(f"{n + 1}," for n in told)]
    lines += [
        "*MATERIAL,NAME=P",
        "*ELASTIC",
        f"1.0,{POISSON}",
        "*DENSITY",
        "1e-5",
        "*SOLID SECTION,ELSET=ALL,MATERIAL=P",
    ]
    lines += ["*STEP", "*STATIC", "*BOUNDARY", "FIXED,1,3", "*DLOAD", "ALL,GRAV,1.0,0,1,0"]
    lines += ["*NODE PRINT,NSET=TOLD", "U", "*END STEP", ""]
    with TemporaryDirectory() as folder:
        Path(folder, "part.inp").write_text("\n".join(lines), encoding="utf-8")
        subprocess.run(["ccx", "part"], cwd=folder, check=True, capture_output=True)
        rows = [line.split() for line in Path(folder, "part.dat").read_text(encoding="utf-8").splitlines()]
    return float(np.mean([float(row[2]) for row in rows if len(row) == 4 and row[0].isdigit()]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("size_mm", nargs="?", type=float, default=6.0, metavar="MM", help="size of the elements")
    add_json_option(parser)
    options = parser.parse_args()
    size_mm: float = options.size_mm
    rows = Rows("mirrors, scale", "section, mm", "finite elements", "stated")
    designed = {" (default)": DesignSpec(), ", fold 90°": DesignSpec(scale_mm=140.0, fold_deg=90.0)}
    layouts = {f"3 {TIMES} 3, {spec.scale_mm:g}{name}": design(spec) for name, spec in designed.items()}
    for count, cols, scale_mm in DESIGNS:
        layouts[f"{count} {TIMES} {cols}, {scale_mm:g}"] = parabola(count, cols, scale_mm=scale_mm, gap_mm=2.0)
    above = []
    for name, layout in layouts.items():
        device = plan_device(layout, HARDWARE)
        section, stated, found = device.mount.section, device.mount.tilt_deg, tilt_deg(device, size_mm)
        above.append(100.0 * (stated / found - 1.0))
        size = f"{section.depth_mm:g} {TIMES} {section.width_mm:.0f}"
        rows.add(name, size, f"{found:.4f}°", f"{stated:.4f}° ({above[-1]:+.0f} %)")
    figures = {
        "above_least_percent": min(above),
        "above_most_percent": max(above),
        "above_mean_percent": float(np.mean(above)),
    }
    write_record(options.json, "mount_stiffness", figures, rows.table)
    if shutil.which("ccx") is None:
        print("CalculiX is not installed (apt-get install calculix-ccx)")
        return
    device = plan_device(parabola(3, 3, gap_mm=2.0), HARDWARE)
    for elements_mm in (12.0, size_mm):
        ours, theirs = sag_by_both_mm(device, elements_mm)
        print(f"sag of the head, {elements_mm:g} mm: scikit-fem {1e3 * ours:.5f} um, CalculiX {1e3 * theirs:.5f} um")


if __name__ == "__main__":
    main()
