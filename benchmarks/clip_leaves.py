"""Sprung leaves of the camera clips of the library: their bending by finite elements, and by the plan's formula.

The clip is meshed with second-order tetrahedra, held at its face on the mount, and loaded along each sprung screw at
the walls of its thread. Run `python -m benchmarks.clip_leaves [CAMERA ...]`; needs the extras `cad` and `fe`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from mirrorcam.cad.checks.elasticity.condensed_solid import Carried, Solid
from mirrorcam.cad.checks.elasticity.tetrahedra import tetrahedra_of
from mirrorcam.cad.parts.camera_box import CONTACT_TURNS, SprungScrew
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.part_solids import make_clip
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_library import camera_names, read_body

ELEMENT_MM = 2.0
ON_FACE_MM = 1e-3


@dataclass(frozen=True)
class LeafBending:
    """Displacement in mm along a screw for 1 N along it: by finite elements, and by the plan; and the planned leaf."""

    name: str
    by_elements_mm: float
    by_plan_mm: float

    @property
    def ratio(self) -> float:
        """Ratio of the plan's compliance to the compliance by finite elements."""
        return self.by_plan_mm / self.by_elements_mm


def leaf_bendings(plan: ClipPlan, hardware: Hardware, size_mm: float = ELEMENT_MM) -> tuple[LeafBending, ...]:
    """Bend both leaves of a clip, with elements of a given size in mm."""
    with TemporaryDirectory() as folder:
        step = Path(folder, "clip.step")
        write_step(step, make_clip(plan))
        solid = Solid(tetrahedra_of(step, size_mm))
    on_mount = np.flatnonzero(np.abs(solid.nodes[:, 1] - plan.slide_y_mm) < ON_FACE_MM)
    modulus = hardware.printer.plastic_mpa
    bendings = []
    for name, screw in zip(("back", "far"), plan.nest.screws if plan.nest else (), strict=True):
        nodes = thread_nodes(solid.nodes, screw, hardware)
        centre = solid.nodes[nodes].mean(axis=0)
        condensed = solid.condensed([on_mount], np.zeros((1, 3)), {name: Carried(nodes, centre, 1.0, centre)})
        compliance = condensed.per_load[name][:3, 3:6]
        along = float(screw.axis @ compliance @ screw.axis) / modulus
        bendings.append(LeafBending(name, along, CONTACT_TURNS * screw.leaf.pitch_mm / screw.leaf.force_n(modulus)))
    return tuple(bendings)


def thread_nodes(nodes: FloatArray, screw: SprungScrew, hardware: Hardware) -> np.ndarray:
    """Indices of the nodes (n, 3) on the wall of a sprung screw's insert hole."""
    table = hardware.screw
    mouth = screw.tip - screw.mouth_mm * screw.axis
    along = (nodes - mouth) @ screw.axis
    radius = np.linalg.norm(np.cross(nodes - mouth, screw.axis), axis=1)
    hole = table.insert_hole_mm / 2.0
    return np.flatnonzero((np.abs(radius - hole) < 0.05 * hole) & (along > -0.1) & (along < table.insert_mm + 0.1))


def main(names: list[str]) -> None:
    """Print a row for each leaf."""
    print(f"{'camera':12} {'leaf':5} {'elements um/N':>14} {'plan um/N':>10} {'plan / elements':>16}")
    for name in names or [name for name in camera_names() if read_body(name).held_by.kind == "lips"]:
        hardware = HARDWARE.replaced(camera=read_body(name))
        plan = plan_clip(hardware)
        for bending in leaf_bendings(plan, hardware) if plan.nest and plan.nest.screws else ():
            by_elements, by_plan = 1000.0 * bending.by_elements_mm, 1000.0 * bending.by_plan_mm
            print(f"{name:12} {bending.name:5} {by_elements:14.2f} {by_plan:10.2f} {bending.ratio:16.3f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
