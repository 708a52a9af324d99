"""The desk foot of the default device in build123d alone: open it, change it, run it; it does not need MirrorCam.

Usage: python examples/desk_foot.py [OUT]      writes OUT/desk_foot.step and .stl (OUT: output/examples/desk_foot)
Lengths in mm, x to the right, y to the front, z up; the origin is on the upper face, on the axis of the nut.
Upper face and screws are the interface to the mount of every device: keep them.
"""

import sys
from math import radians, tan
from pathlib import Path

import build123d as bd

THICKNESS = 6.36
RIGHT, FRONT, BACK, CORNER = 27.8, 55.71, -10.0, 8.0  # extents of the plate, and legs of its chamfered corners
SCREWS = [(x, y) for x in (-17.0, 17.0) for y in (0.0, 9.5)]
GRIP = 5.5  # from the top of a screw's head to the mount
SCREW_HOLE, HEAD = 3.4, 6.82  # M3, ISO 273; head of ISO 10642 and 0.1 mm
HALF_ANGLE_DEG, FLARE = 44.0, 0.31  # of a head's cone, printable without support; clearance around the head
NUT_FLATS, NUT_FLOOR, TRIPOD_HOLE = 11.31, 0.6, 6.6  # 1/4-20 UNC, ASME B18.2.2, and 0.2 mm of play


def desk_foot() -> bd.Part:
    sink, radius = THICKNESS - GRIP, HEAD / 2 + FLARE
    cone = (radius - SCREW_HOLE / 2) / tan(radians(HALF_ANGLE_DEG))
    with bd.BuildPart() as part:
        with bd.BuildSketch():
            with bd.Locations((0, (FRONT + BACK) / 2)):
                plate = bd.Rectangle(2 * RIGHT, FRONT - BACK)
            bd.chamfer(plate.vertices(), CORNER)
        bd.extrude(amount=-THICKNESS)
        with bd.Locations(*((x, y, 0) for x, y in SCREWS)):
            bd.Hole(SCREW_HOLE / 2)
        with bd.Locations(*((x, y, -THICKNESS) for x, y in SCREWS)):
            bottom = (bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN)
            bd.Cylinder(radius, sink - FLARE, align=bottom, mode=bd.Mode.SUBTRACT)
        with bd.Locations(*((x, y, -GRIP - FLARE) for x, y in SCREWS)):
            bd.Cone(radius, SCREW_HOLE / 2, cone, align=bottom, mode=bd.Mode.SUBTRACT)
        bd.Hole(TRIPOD_HOLE / 2)
        with bd.BuildSketch():
            bd.RegularPolygon(NUT_FLATS / 2, 6, major_radius=False)
        bd.extrude(amount=-(THICKNESS - NUT_FLOOR), mode=bd.Mode.SUBTRACT)
    solid = bd.Part(part.part)
    solid.label = "desk_foot"
    return solid


if __name__ == "__main__":
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/desk_foot")
    out.mkdir(parents=True, exist_ok=True)
    bd.export_step(desk_foot(), out / "desk_foot.step")
    bd.export_stl(desk_foot(), out / "desk_foot.stl")
    print(f"{desk_foot().volume / 1000:.2f} cm3, {out}/desk_foot.step and .stl")
