"""Bought items as plain solids: camera and fasteners, for pictures, the assembly and clearances."""

from __future__ import annotations

from typing import Any

import numpy as np
from build123d import (
    Align,
    Box,
    BuildPart,
    BuildSketch,
    Cone,
    Cylinder,
    Hole,
    Locations,
    Mode,
    Part,
    Plane,
    RectangleRounded,
    RegularPolygon,
    SlotOverall,
    extrude,
)

from mirrorcam.cad.plan.fasteners import COUNTERSUNK, SUNK_HEAD, diameter_mm, thread_of
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody

ABOVE: Any = (Align.CENTER, Align.CENTER, Align.MIN)
BELOW: Any = (Align.CENTER, Align.CENTER, Align.MAX)
HINGE_MM = 7.8
CABLE_STUB_MM = 20.0
# Coils of a spring that is drawn as a sleeve, the dead ones among them.
SLEEVE_COILS = 5.5
# ISO 7089: outer diameter and hole of a washer, over the diameter of its thread.
WASHER, WASHER_HOLE = 7.0 / 3.0, 3.2 / 3.0


def camera_solid(camera: CameraBody) -> Part:
    """The camera in rig, its entrance pupil in the origin: body, lens ring, folded foot, hinge, cable."""
    front = camera.pupil_behind_front_mm
    middle = (-camera.lens_x_mm, -camera.lens_y_mm)
    with BuildPart() as body:
        if camera.end_radius_mm > 0.0:
            with BuildSketch(Plane((*middle, front))):
                _rounded(camera)
            extrude(amount=-camera.depth_mm)
        else:
            with Locations((*middle, front)):
                Box(camera.width_mm, camera.height_mm, camera.depth_mm, align=BELOW)
        if camera.lens_protrusion_mm > 0.0:
            with Locations((0.0, 0.0, front)):
                Cylinder(camera.lens_ring_mm / 2.0, camera.lens_protrusion_mm, align=ABOVE)
        if camera.hinge_mm > 0.0:
            low = front - camera.depth_mm + HINGE_MM / 2.0
            with Locations((middle[0], middle[1] + camera.height_mm / 2.0, low)):
                Cylinder(HINGE_MM / 2.0, camera.hinge_mm, rotation=(0.0, 90.0, 0.0))
        if camera.foot_mm is not None:
            wide, high, deep = camera.foot_mm
            with Locations((middle[0], middle[1] + (camera.height_mm + high) / 2.0, front - camera.depth_mm)):
                Box(wide, high, min(deep, camera.depth_mm), align=ABOVE)
        if camera.has_cable:
            with Locations((camera.cable_x_mm, middle[1] + camera.cable_y_mm, front - camera.depth_mm)):
                if camera.cable_thick_mm > 0.0:
                    Box(camera.cable_mm, camera.cable_thick_mm, CABLE_STUB_MM, align=BELOW)
                else:
                    Cylinder(camera.cable_mm / 2.0, CABLE_STUB_MM, align=BELOW)
        if isinstance(camera.held_by, BoardHoles):
            with Locations(*((*hole, front) for hole in camera.held_by.holes_mm)):
                Hole(camera.held_by.hole_mm / 2.0)
    return _solid(body)


def _rounded(camera: CameraBody) -> None:
    """Add the outline of a body with round ends to a sketch: a slot where nothing of its shorter sides is flat."""
    width, height, radius = camera.width_mm, camera.height_mm, camera.end_radius_mm
    if 2.0 * radius < min(width, height):
        RectangleRounded(width, height, radius)
    else:
        SlotOverall(max(width, height), min(width, height), rotation=0.0 if width > height else 90.0)


def item_solid(item: BoughtItem) -> Part:
    """A screw, insert, nut or pin in its own frame: origin under the head (at the mouth of the hole), z outwards."""
    if item.kind == "spring":
        return _sleeve(item)
    diameter = diameter_mm(item.size)
    with BuildPart() as body:
        if item.kind == "screw":
            Cylinder(diameter / 2.0, item.length_mm, align=BELOW)
            if item.size.endswith(COUNTERSUNK):
                Cone(diameter / 2.0, SUNK_HEAD * diameter / 2.0, (SUNK_HEAD - 1.0) * diameter / 2.0, align=BELOW)
            else:
                thread = thread_of(item.size)
                Cylinder(thread.head_mm / 2.0, thread.head_height_mm, align=ABOVE)
        elif item.kind == "washer":
            Cylinder(WASHER * diameter / 2.0, item.length_mm, align=ABOVE)
            Hole(WASHER_HOLE * diameter / 2.0)
        elif item.kind == "nut":
            with BuildSketch(Plane.XY.offset(-item.length_mm)):
                RegularPolygon(thread_of(item.size).nut_flats_mm / 2.0, 6, major_radius=False)
            extrude(amount=item.length_mm)
            Hole(diameter / 2.0)
        elif item.kind == "insert":
            # Outer diameter 4.6 for M3, pressed into a hole of 4.0: what is seen of it is the hole's size.
            Cylinder(4.0 / 3.0 * diameter / 2.0, item.length_mm, align=BELOW)
            Hole(diameter / 2.0)
        else:
            Cylinder(diameter / 2.0, item.length_mm, align=BELOW)
    return _solid(body)


def _sleeve(spring: BoughtItem) -> Part:
    """A spring as a sleeve of its mean diameter, as thick as the volume of its wire makes it (with two dead coils)."""
    wire, mean, _ = (float(number) for number in spring.size.split(" x "))
    thick = min(np.pi * wire**2 * SLEEVE_COILS / (4.0 * spring.length_mm), wire)
    with BuildPart() as body:
        Cylinder((mean + thick) / 2.0, spring.length_mm, align=BELOW)
        Cylinder((mean - thick) / 2.0, spring.length_mm, align=BELOW, mode=Mode.SUBTRACT)
    return _solid(body)


def _solid(body: BuildPart) -> Part:
    part = body.part
    if part is None or len(part.solids()) != 1:
        raise ValueError("expected one solid")
    return part
