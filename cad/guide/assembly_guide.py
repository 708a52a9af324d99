"""The assembly guide: numbered steps with pictures, and with figures from the plans of the device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import tomli_w
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from shapely import Polygon, maximum_inscribed_circle

from mirrorcam.cad.assembly.bill import Bom
from mirrorcam.cad.assembly.build_steps import STEPS, SeatOrder, also_needed, tools_of
from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import above_desk_mm
from mirrorcam.cad.guide.action_pictures import action_names, has_film
from mirrorcam.cad.guide.assembly_steps import Stages, counted, first_off, order_text
from mirrorcam.cad.guide.back_step import back_sentences, tripod_note
from mirrorcam.cad.guide.camera_measures import MEASUREMENTS
from mirrorcam.cad.guide.part_pages import page_link, part_pages, with_step_links
from mirrorcam.cad.guide.side_view import look_text
from mirrorcam.cad.holder.carriers import tilt_per_turn_deg, travel_turns
from mirrorcam.cad.holder.glue import bead_mm, glue_amount
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.mirrors.laser_settings import REFERENCE_MM, SOURCE, laser_settings
from mirrorcam.cad.mirrors.stock_sheets import SURFACES, facing_of
from mirrorcam.cad.parts.camera_box import CONTACT_TURNS
from mirrorcam.cad.parts.coupon import gauges_of, spacer_mm
from mirrorcam.cad.parts.reclamping import CONTACT_MM, repeatability
from mirrorcam.cad.plan.device_names import COUPON, COVER, TIE
from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Hardware, field_of_view
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.cad.plan.prices import BASIS, hours_text
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm, is_rectangular, is_sold_in_size
from mirrorcam.cad.plan.stand import design_depths_mm
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.cad.plan.tightening import tightenings
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.names import anchor_of, markdown_text
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import edges_mm
from mirrorcam.optics.geometry.mirror_stock import width_mm

WEB = Path(__file__).parents[1] / "web"
NO_ORDER = SeatOrder()


def write_guide(
    folder: Path,
    device: Device,
    parts: Sequence[BuiltPart],
    components: Sequence[Component],
    bill: Bom,
    undone_first: Mapping[str, Sequence[str]] = MappingProxyType({}),
    seats: SeatOrder = NO_ORDER,
) -> None:
    """Write guide.md, with links to the device's files, into `folder`, where mirrors/ must already be.

    `undone_first` has the steps to undo before a step can be, by the step's name, and `seats` the order of the mirrors.
    """
    environment = Environment(
        loader=FileSystemLoader(WEB), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    environment.filters["number"] = lambda value: f"{value:.2f}".rstrip("0").rstrip(".")
    environment.filters["counted"] = counted
    environment.filters["toml"] = camera_toml
    environment.filters["text"] = markdown_text
    environment.filters["anchor"] = anchor_of
    environment.filters["page"] = partial(page_link, bill)
    hardware, items = device.hardware, purchased_items(device)
    step_of = {step.name: number for number, step in enumerate(STEPS, start=1)}
    coupon = next((part for part in parts if part.name == COUPON), None)
    strip_mm = spacer_mm(device.layout, hardware)
    thickest_mm = max(mirror.thickness_mm for mirror in device.layout.mirrors)
    text = environment.get_template("guide.md").render(
        layout=device.layout,
        estimate=bill.estimate,
        pages=part_pages(bill, step_of),
        first_off=first_off(components, undone_first),
        order=order_text(seats, strip_mm, _narrowest_mm(device.layout)),
        strip_mm=strip_mm,
        film=has_film(device),
        tied=TIE in action_names(device),
        lasers=laser_settings(thickest_mm),
        laser_source=SOURCE,
        reference_mm=REFERENCE_MM,
        thickest_mm=thickest_mm,
        hardware=hardware,
        back=device.back,
        back_sentences=back_sentences(device),
        tripod_note=tripod_note(device.back),
        camera=hardware.camera,
        view=field_of_view(device.layout.camera),
        focus_mm=f"{focus_of(device.layout):.0f}",
        more_measurements=_more_measurements(hardware.camera),
        tools=[tool.name for tool in tools_of(device, items)],
        also=[tool.name for tool in also_needed(device, items)],
        gap_mm=hardware.fit.free_mm,
        cures=_cure_texts(device),
        test_mm=coupon_mirror_mm(device.layout),
        sold=is_sold_in_size(device.layout),
        rectangular=is_rectangular(device.layout),
        tray=device.clip.tray is not None,
        straps=len(device.clip.straps_mm),
        nest=_nest_texts(device),
        inserts=hardware.screw.kind == "insert",
        parts=parts,
        basis=BASIS,
        black=["the mirror holder", *(["the mirror carriers"] if device.mirror_carriers else [])],
        sliced=is_sliced(parts),
        masses=masses_of(parts),
        print_times={part.name: hours_text(part.checks["print_minutes"].value) for part in parts if is_sliced(parts)},
        glue=glue_amount(device.holder.glue_mm3),
        glue_of_one=glue_amount((max(device.holder.glue_mm3),)),
        bead_mm=bead_mm(hardware),
        taped=hardware.holder.mirrors == "tape",
        pads=len(device.holder.pads),
        carriers=_carrier_texts(device),
        coupon=coupon,
        coupon_minutes=round(minutes.value) if coupon and (minutes := coupon.checks.get("print_minutes")) else None,
        gauges=gauges_of(device.layout, hardware),
        stages=Stages(components),
        step_of=step_of,
        pictures_at={step.name: step.pictures for step in STEPS if step.pictures},
        sheets=sorted(
            {hardware.cutting.stock(mirror.surface, mirror.thickness_mm) for mirror in device.layout.mirrors}
        ),
        sheet_files=sorted(path.name for path in (folder / "mirrors").glob("mirrors*.*")),
        mirrors=_mirror_rows(device),
        surfaces=sorted({mirror.surface for mirror in device.layout.mirrors}),
        facings={surface: facing_of(surface, hardware.cutting.material) for surface in SURFACES},
        glass=hardware.cutting.material == "glass",
        settings=PRINT_SETTINGS,
        covered=next((part.number for part in parts if part.name == COVER), ""),
        tightening=_tightening_rows(components, hardware),
        look=_look_texts(device),
        first_row_is="highest" if _height_of_row(device, 0) > _height_of_row(device, -1) else "lowest",
    )
    write_text(folder / "guide.md", with_step_links(text))


def _narrowest_mm(layout: Layout) -> float:
    """Smallest width of any mirror."""
    return min(width_mm(mirror.outline_in_plane_mm) for mirror in layout.mirrors)


def focus_of(layout: Layout) -> float:
    """The focus distance in mm from the pupil along the axis: the best for the design's depths, if stated.

    It is measured along the light's path, whose length mirrors do not change.
    """
    best = layout.metrics.get("best_focus_mm")
    return best.value if best is not None and best.known else layout.camera.focus_mm


# Smallest and largest depth, mm, to which one-part silicone cures in a day in open air, from data sheets.
CURED_MM_PER_DAY = (2.0, 3.0)


def _cure_texts(device: Device) -> dict[str, str]:
    """The largest distance of the glue from a mirror's edge, and its range of curing times."""
    deepest = max(
        float(maximum_inscribed_circle(Polygon(mirror.outline_in_plane_mm)).length) for mirror in device.layout.mirrors
    )
    low, high = (math.ceil(deepest / speed) for speed in CURED_MM_PER_DAY[::-1])
    return {"deepest_mm": f"{deepest:.0f}", "days": f"{low} to {high}" if high > low else f"{low}"}


# Main measurements of a camera, in the guide's first table.
MAIN = {"width_mm", "height_mm", "depth_mm", "lens_ring_mm", "lens_protrusion_mm", "pupil_behind_front_mm", "mass_g"}


def _more_measurements(camera: CameraBody) -> list[tuple[str, str, str, str]]:
    """Rows of the remaining measurements in the camera's file: description, field, value and method."""
    return [
        (measurement.description, measurement.field, f"{getattr(camera, measurement.field):g}", measurement.method)
        for measurement in MEASUREMENTS
        if measurement.field not in MAIN and not (measurement.field.startswith("cable") and not camera.has_cable)
    ]


def _nest_texts(device: Device) -> dict[str, Any]:
    """Figures of the camera's step: its contacts and repeatability, as in the checks."""
    clip, hardware = device.clip, device.hardware
    repeats = repeatability(clip, device.layout, hardware)
    held_by = hardware.camera.held_by
    texts = {
        "contact_um": f"{1000.0 * CONTACT_MM:.0f}",
        "play_mm": f"{held_by.play_mm:.2f}" if isinstance(held_by, BoardHoles) else "",
        "shift_um": f"{1000.0 * repeats.shift_mm:.0f}",
        "turn_deg": f"{repeats.rotation_deg:.2f}",
        "image_px": f"{repeats.image_px:.1f}",
        "views_px": f"{repeats.between_views_px:.1f}",
    }
    if clip.tray is None:
        return texts
    back, end = (screw.leaf.force_n(hardware.printer.plastic_mpa) for screw in clip.tray.screws)
    contacts = {"v": bool(abs(clip.tray.normals[4, 0]) > 0.1), "back_n": f"{back:.0f}", "end_n": f"{end:.0f}"}
    contacts["turns"] = f"{CONTACT_TURNS:g}"
    for position, screw in zip(("back", "end"), clip.tray.screws, strict=True):
        contacts[f"{position}_screw"] = f"{device.hardware.screw.thread} x {screw.length_mm:g} screw"
    return texts | contacts


def _look_texts(device: Device) -> dict[str, Any]:
    """Where the device looks as it stands."""
    back, layout = device.back, device.layout
    texts = {
        "text": look_text(back.look_deg),
        "depth_mm": f"{design_depths_mm(layout, device.hardware)[-1]:g}",
    }
    above = above_desk_mm(back, layout, device.hardware)
    return texts if above is None else texts | {"above_mm": above}


def _carrier_texts(device: Device) -> dict[str, Any]:
    """Figures of the mirrors' carriers for the guide; {} if mirrors are glued to the holder."""
    holder = device.holder
    if not isinstance(holder, ScrewedHolderPlan):
        return {}
    dimensions = device.hardware.holder
    tilts = [tilt_per_turn_deg(carrier) for carrier in holder.carriers]
    return {
        "gap_mm": f"{holder.adjuster.gap_mm:.1f}",
        "spring_n": f"{holder.adjuster.force_n:.0f}",
        "inset_mm": f"{dimensions.carrier_inset_mm:g}",
        "adjust_deg": f"{dimensions.adjust_deg:g}",
        "travel_turns": f"{travel_turns(holder.adjuster):.1f}",
        "min_tilt_deg": f"{min(tilts):.1f}",
        "max_tilt_deg": f"{max(tilts):.1f}",
        "pitch_mm": f"{thread_of(holder.adjuster.thread).pitch_mm:g}",
    }


def is_sliced(parts: Sequence[BuiltPart]) -> bool:
    """Return whether every part was sliced."""
    return all("print_g" in part.checks for part in parts)


def masses_of(parts: Sequence[BuiltPart]) -> dict[str, str]:
    """Mass of every part by name, in grams: as sliced if every part was, else estimated."""
    sliced = is_sliced(parts)
    return {part.name: f"{part.checks['print_g'].value if sliced else part.mass.mass_g:.0f}" for part in parts}


def camera_toml(camera: CameraBody) -> str:
    """A camera's body as the text of a TOML file for `read_body`."""
    return tomli_w.dumps(camera.model_dump(mode="json", exclude_none=True)).rstrip()


def _mirror_rows(device: Device) -> list[tuple[str, str, str, int]]:
    """Name, width and height (mm, across and along the arrow), and number of corners of every mirror.

    Of a rectangle, which may be turned a little to the arrow, they are its sides.
    """
    rows = []
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        width, height = np.ptp(mirror.outline_in_plane_mm, axis=0)
        if is_rectangular(device.layout):
            width, height = edges_mm(mirror)[:2]
        rows.append((name, f"{width:.1f}", f"{height:.1f}", len(mirror.outline_in_plane_mm)))
    return rows


def _tightening_rows(components: Sequence[Component], hardware: Hardware) -> list[tuple[str, str, str]]:
    """Rows: screws with their count, the parts that they join, and their largest torque."""
    fastened = [(component, component.item) for component in components if component.item is not None]
    titles = {component.name: component.title.lower() for component in components if component.kind == "part"}
    groups: dict[tuple[tuple[str, ...], str], list[Component]] = {}
    for (component, item), tightening in zip(
        fastened, tightenings([item for _, item in fastened], hardware), strict=True
    ):
        if tightening is not None:
            groups.setdefault((item.joins, tightening.text), []).append(component)
    return [
        (counted(screws), " to ".join(titles.get(name, name.replace("_", " ")) for name in joins), text)
        for (joins, text), screws in groups.items()
    ]


def _height_of_row(device: Device, row: int) -> float:
    """Mean height of a row's mirrors in the upright device, mm."""
    layout = device.layout
    centres = np.array([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors])
    heights = -(centres @ layout.view_from_rig[1])
    return float(heights.reshape(layout.rows, layout.cols)[row].mean())
