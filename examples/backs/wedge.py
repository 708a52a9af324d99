"""A back of your own: a wedge, on which the device stands on a desk and looks 15 deg up.

Usage: mirrorcam cad layout.json --adapter wedge.py
Lengths in mm; x to the right, y to the scene, z up; origin between the mount's four screws.
"""

from math import cos, radians, sin, tan

from build123d import BuildLine, BuildPart, BuildSketch, Plane, Polyline, extrude, make_face

from mirrorcam import Adapter, MountFace

UP = radians(15.0)  # angle of the views above the horizon
TIP = tan(radians(15.0))  # slope at which the device falls over
THIN = 9.0  # height of the rear end
WALL = 2.0  # between the holes of the screws and the front


def adapter(face: MountFace) -> Adapter:
    # The base surrounds the point of the desk under the centre of mass.
    _, load_y, load_z = face.load_mm
    height = load_z + 2.0 * THIN
    middle, margin = load_y - height * tan(UP), height * TIP
    back = min(face.low_mm[1], middle - margin)
    front = max(face.high_mm[1] + WALL, middle + margin)
    half_width = max(face.high_mm[0], margin)
    low = -THIN - (front - back) * tan(UP)

    with BuildPart() as wedge:
        with BuildSketch(Plane.YZ):
            with BuildLine():
                Polyline((back, 0.0), (front, 0.0), (front, low), (back, -THIN), close=True)
            make_face()
        extrude(amount=half_width, both=True)

    return Adapter(
        part=wedge.part,
        title="Wedge",
        print_up=(1.0, 0.0, 0.0),  # on its side, where both inclined faces print exactly
        stands_on=Plane((0.0, back, -THIN), z_dir=(0.0, sin(UP), cos(UP))),
        lengths=(((half_width, back, 0.0), (half_width, back, -THIN)),),
        steps=("Stick four rubber feet under the corners of the wedge: a desk is smooth.",),
    )
