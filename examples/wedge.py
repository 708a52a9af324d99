"""A back of your own: a wedge, on which the device stands on a desk and looks 15 deg up.

Usage: mirrorcam cad layout.json --adapter wedge.py
"""

from math import cos, radians, sin, tan

from build123d import Axis, BuildLine, BuildPart, BuildSketch, Plane, Polyline, extrude, make_face

from mirrorcam import Adapter

UP_DEG, TIP_DEG = 15.0, 15.0  # angle of the views above the horizon; tilt at which it is to fall over
THIN_MM = 9.0  # height of the wedge at its rear end


def adapter(face):
    """Return the wedge for the face of a mount; lengths in mm, see mirrorcam.MountFace."""
    slope, _ = tan(radians(UP_DEG)), face.thread
    _, load_y, load_z = face.load_mm
    # The desk is inclined about x: it is lower at the front, so that the device leans back on it.
    up = (0.0, sin(radians(UP_DEG)), cos(radians(UP_DEG)))
    below_load = load_y - (load_z + 2.0 * THIN_MM) * slope
    margin = (load_z + 2.0 * THIN_MM) * tan(radians(TIP_DEG))
    back, front = min(face.low_mm[1], below_load - margin), max(face.high_mm[1], below_load + margin)
    half = max(face.high_mm[0], margin)
    with BuildPart() as wedge:
        with BuildSketch(Plane.YZ):
            with BuildLine():
                Polyline((back, 0.0), (front, 0.0), (front, -THIN_MM - (front - back) * slope), (back, -THIN_MM), close=True)
            make_face()
        extrude(amount=half, both=True)
    return Adapter(
        part=wedge.part,
        title="Wedge",
        print_up=(1.0, 0.0, 0.0),  # on its side: both inclined faces are then as exact as the printer's axes
        stands_on=Plane((0.0, back, -THIN_MM), z_dir=up),
    )
