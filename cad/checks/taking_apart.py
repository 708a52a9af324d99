"""Taking an assembled device apart: the steps to undo first, so that tools and the camera have free paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import manifold3d

from mirrorcam.cad.assembly.build_steps import STEPS, Step, joining_step, pieces_joined
from mirrorcam.cad.assembly.components import Component, camera_exit_mm
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.clashes import FASTENERS, overlap_mm3
from mirrorcam.cad.checks.exported_mesh import is_manifold, solid_of
from mirrorcam.cad.checks.reach import best_tool_clash_mm3, swept
from mirrorcam.cad.plan.device_names import CAMERA, CLIP
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.core.values import FloatArray, Metric

Undone = dict[str, tuple[str, ...]]
Solids = Mapping[str, manifold3d.Manifold]


def check_taking_apart(device: Device, components: Sequence[Component]) -> tuple[Undone, dict[str, Metric]]:
    """The steps to undo before each step with screws can be undone, and the check that this is possible.

    Parameters
    ----------
    device : Device
        The plans of its parts.
    components : sequence of Component
        All components of the assembled device.

    Returns
    -------
    dict of str to tuple of str
        Names of the steps to undo first, in this order, by the name of the step; steps that cannot be undone are left
        out.
    dict of str to Metric
        The number of steps that cannot be undone.
    """
    solids = {c.name: solid_of(c.mesh) for c in components if not c.name.startswith(FASTENERS)}
    solids = {name: solid for name, solid in solids.items() if is_manifold(solid)}
    screws = [c.item for c in components if c.item is not None and c.item.kind == "screw"]
    exit_mm = camera_exit_mm(device.hardware.camera)
    steps = [step for step in STEPS if _screws_of(step, screws)]
    found = {step.name: undone_first(step, screws, solids, exit_mm) for step in steps}
    undone = {name: tuple(step.name for step in first) for name, first in found.items() if first is not None}
    stuck = Metric(value=len(found) - len(undone), unit="", limit=0)
    return undone, {"device.steps_not_undone": stuck}


def undone_first(
    step: Step, screws: Sequence[PurchasedItem], solids: Solids, camera_exit_mm: FloatArray
) -> tuple[Step, ...] | None:
    """The fewest later steps that must be undone, in this order, before a step can be; None if none suffice.

    A step can be undone if a tool reaches each of its screws, and the camera leaves by `camera_exit_mm` (3,) if the
    step puts it in, past all pieces that are still connected to them. `screws` and `solids` are of the assembled
    device, in the rig frame, mm.
    """
    later = [other for other in STEPS[: STEPS.index(step) : -1] if other.joins]

    def free(each: Step, undone: tuple[Step, ...]) -> bool:
        done = [other for other in STEPS if other not in undone]
        return _is_free(each, done, screws, solids, camera_exit_mm)

    for count in range(len(later) + 1):
        for first in combinations(later, count):
            order = (*first, step)
            if all(free(each, order[:position]) for position, each in enumerate(order)):
                return first
    return None


def _screws_of(step: Step, screws: Sequence[PurchasedItem]) -> list[PurchasedItem]:
    return [screw for screw in screws if joining_step(screw.joins) is step]


def _is_free(
    step: Step, done: Sequence[Step], screws: Sequence[PurchasedItem], solids: Solids, camera_exit_mm: FloatArray
) -> bool:
    """Return whether a step can be undone while the steps `done` are in effect."""
    for screw in _screws_of(step, screws):
        present = sorted(pieces_joined(screw.joins, solids, done))
        if best_tool_clash_mm3(screw, [solids[name] for name in present]) > 0.0:
            return False
    if not any(CAMERA in pair for pair in step.joins) or CAMERA not in solids:
        return True
    others = sorted(name for name in pieces_joined((CAMERA,), solids, done) if not name.startswith((CAMERA, CLIP)))
    path = swept(solids[CAMERA], camera_exit_mm[None])
    return overlap_mm3(manifold3d.Manifold.compose([solids[name] for name in others]), path) == 0.0
