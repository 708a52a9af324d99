"""Write all files of a device: parts and mirrors, then the assembly, then the documents."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.cad.assembly.bill import bill_of
from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.components import components_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks import check_device
from mirrorcam.cad.checks.elasticity.elasticity_report import write_elasticity
from mirrorcam.cad.checks.mirror_play import seat_order
from mirrorcam.cad.checks.taking_apart import check_taking_apart
from mirrorcam.cad.guide.action_pictures import action_names
from mirrorcam.cad.guide.assembly_drawing import write_assembly_drawing
from mirrorcam.cad.guide.assembly_guide import write_guide
from mirrorcam.cad.guide.device_page import write_page
from mirrorcam.cad.guide.device_pictures import pictures_of
from mirrorcam.cad.guide.live_view import write_live_view
from mirrorcam.cad.guide.picture_views import write_picture
from mirrorcam.cad.guide.side_view import write_side_view
from mirrorcam.cad.mirrors.sheet_files import write_sheets
from mirrorcam.cad.mirrors.stock_sheets import sheet_metrics
from mirrorcam.cad.part_files import make_part
from mirrorcam.cad.plan.device_names import COUPON, PICTURES
from mirrorcam.cad.write.assembly_files import write_assembly, write_glb
from mirrorcam.cad.write.bill_of_materials import bom_metrics, write_bom
from mirrorcam.cad.write.licence import write_source
from mirrorcam.cad.write.robot_link import write_robot
from mirrorcam.cad.write.threemf import write_plates
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.disk.results import Results
from mirrorcam.core.processes.calls import Call
from mirrorcam.core.processes.worker_pool import call_all
from mirrorcam.core.progress import Progress
from mirrorcam.core.values import Metric


def write_files(
    device: Device, out: Path, results: Results | None, workers: int, progress: Progress, *, elastic: bool = False
) -> dict[str, Metric]:
    """Write all files into `out`, and store each part in `results`; with `elastic`, report elastic deformation too.

    Returns the figures, each named after its object: `mount.wall_mm`, `device.rays_blocked`.
    """
    plans = parts_of(device)
    part_calls: list[Call] = [
        (make_part, (plan, device.hardware.printer, out, results, device.hardware.screw)) for plan in plans
    ]
    # Besides parts and pictures: sheets, checks, taking apart, mirrors' order, plates, assembly, live view, assembly
    # drawing, side view.
    done, total = 0, len(part_calls) + 9 + len(PICTURES) + len(action_names(device)) + elastic

    progress(done, total)

    def step() -> None:
        nonlocal done
        done += 1
        progress(done, total)

    *parts, sheets = call_all(
        [*part_calls, (write_sheets, (out / "mirrors", device.layout, device.hardware.cutting))],
        workers,
        step,
        preload=(__name__,),
    )
    components = components_of(device, parts)
    write_glb(out / "assembly.glb", components, device.back.rig_from_stand)
    pictures = pictures_of(device, parts, components)
    picture_calls: list[Call] = [(write_picture, (out, picture)) for picture in pictures]
    revision = value_digest([device.layout.identity, *(plan.identity for plan in plans)])[:12]
    elastic_calls: list[Call] = [(write_elasticity, (out, device))] if elastic else []
    # The coupon is printed alone, before the other parts.
    device_parts = [plan for plan in plans if plan.name != COUPON]
    checks, (undone_first, undo_checks), seats, (plates, plate_checks), *others = call_all(
        [
            (check_device, (device, parts, out)),
            (check_taking_apart, (device, components)),
            (seat_order, (device, components)),
            (write_plates, (out, device_parts, device.hardware.printer)),
            (write_assembly, (out / "assembly.step", device, parts)),
            (write_live_view, (out, device.layout, components)),
            (write_side_view, (out / "drawings", device, components)),
            (write_assembly_drawing, (out / "drawings", device.level_from_rig, components, revision)),
            *picture_calls,
            *elastic_calls,
        ],
        workers,
        step,
        preload=(__name__,),
    )
    checks |= undo_checks
    for part in parts:
        checks |= {f"{part.name}.{name}": check for name, check in part.checks.items()}
    checks |= {f"mirrors.{name}": check for name, check in sheet_metrics(sheets).items()}
    checks |= {f"plates.{name}": check for name, check in plate_checks.items()}
    if elastic:
        checks |= others[-1]
    write_robot(out / "robot", device, components)
    bill = bill_of(device, parts, sheets)
    checks |= bom_metrics(bill)
    write_metrics(out / "checks.json", checks)
    write_bom(out, bill)
    write_source(out, device.layout, device.hardware)
    write_guide(out, device, parts, components, bill, undone_first, seats)
    write_page(out, device, parts, plates, pictures, checks)
    return checks
