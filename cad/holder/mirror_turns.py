"""What turning the screws of a carrier does to its mirror, and which turns bring a mirror to a wanted plane.

A carrier turns as a rigid body about axes in its back, with the point between its screws staying on the screws' mean
direction: three displacements along the screws are all of its freedom. A turn clockwise, as seen from behind the
device, draws that corner to the holder by the pitch of the thread.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.cad.holder.adjuster import SCREW, Adjuster
from mirrorcam.cad.holder.carriers import CarrierPlan
from mirrorcam.cad.holder.pads import least_height_mm
from mirrorcam.cad.plan.fasteners import thread_of
from mirrorcam.core.values import FloatArray

PITCH_MM = thread_of(SCREW).pitch_mm


def rig_from_carrier(carrier: CarrierPlan, turns: FloatArray) -> FloatArray:
    """The motion (4, 4) in rig of a carrier whose screws are turned by (3,), clockwise as seen from behind."""
    frame = carrier.rig_from_back
    # The plane of the back through the screws: z = height + slope . (x, y).
    design = np.column_stack([np.ones(3), carrier.screws_mm])
    height, *slope = np.linalg.solve(design, PITCH_MM * np.asarray(turns, dtype=np.float64))
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    turned = np.eye(4)
    turned[:3, :3], turned[2, 3] = _least_rotation(np.array([0.0, 0.0, 1.0]), normal), height
    return np.asarray(frame @ turned @ np.linalg.inv(frame))


def centre_after(virtual_centre: FloatArray, carrier: CarrierPlan, turns: FloatArray) -> FloatArray:
    """The virtual centre (3,) in rig, mm, of a mirror at another (3,) when the screws are turned by (3,)."""
    motion = rig_from_carrier(carrier, turns)
    normal = motion[:3, :3] @ virtual_centre
    point = motion[:3, :3] @ (virtual_centre / 2.0) + motion[:3, 3]
    unit = normal / np.linalg.norm(normal)
    return np.asarray(2.0 * (unit @ point) * unit)


def turns_to(virtual_centre: FloatArray, wanted: FloatArray, carrier: CarrierPlan) -> FloatArray:
    """The turns (3,) of the screws, clockwise as seen from behind, that bring a mirror to a wanted plane.

    Parameters
    ----------
    virtual_centre, wanted : (3,)
        Virtual centres of the mirror as it is and as it shall be, in rig, mm.
    carrier : CarrierPlan
        Its screws.

    Returns
    -------
    (3,)
        Turns in the order of the carrier's screws; exact for any tilt of which such a carrier is capable.
    """
    frame = carrier.rig_from_back
    is_normal, to_normal = (_unit(-centre) @ frame[:3, :3] for centre in (virtual_centre, wanted))
    turn = _turn_about_level_axis(is_normal, to_normal)
    point = (virtual_centre / 2.0 - frame[:3, 3]) @ frame[:3, :3]
    goal = (wanted / 2.0 - frame[:3, 3]) @ frame[:3, :3]
    height = float(to_normal @ (goal - turn @ point)) / float(to_normal[2])
    normal = turn[:, 2]
    return np.asarray((height - carrier.screws_mm @ normal[:2] / normal[2]) / PITCH_MM)


def turn_deg(carrier: CarrierPlan) -> float:
    """The largest tilt in deg by one turn of a carrier's screw: the pitch over the least height between them."""
    height = float(least_height_mm(carrier.screws_mm[None])[0])
    return float(np.degrees(np.arctan(PITCH_MM / height)))


def rotation_about(axis: FloatArray, angle_rad: float) -> FloatArray:
    """The rotation (3, 3) by an angle about a unit vector (3,)."""
    return np.asarray(Rotation.from_rotvec(angle_rad * axis).as_matrix())


def travel_turns(screw: Adjuster) -> float:
    """How far a screw may be turned either way."""
    return screw.travel_mm / PITCH_MM


def tilt_and_shift(virtual_centre: FloatArray, wanted: FloatArray) -> tuple[float, float]:
    """How far a mirror is from a wanted plane: the angle in deg, and along the normal, from the pupil, in mm."""
    first, second = _unit(virtual_centre), _unit(wanted)
    angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
    return float(np.degrees(angle)), float(np.linalg.norm(virtual_centre) - np.linalg.norm(wanted)) / 2.0


def _turn_about_level_axis(start: FloatArray, end: FloatArray) -> FloatArray:
    """The rotation (3, 3) about an axis across z that takes a unit vector to another."""
    axis = np.cross([0.0, 0.0, 1.0], end - start)
    length = float(np.linalg.norm(axis))
    if length < 1e-15:
        return np.eye(3)
    axis = axis / length
    first, second = (vector - (vector @ axis) * axis for vector in (start, end))
    return rotation_about(axis, float(np.arctan2(axis @ np.cross(first, second), first @ second)))


def _least_rotation(start: FloatArray, end: FloatArray) -> FloatArray:
    """The rotation (3, 3) by the least angle that takes a unit vector to another."""
    axis = np.cross(start, end)
    length = float(np.linalg.norm(axis))
    return rotation_about(axis / length, float(np.arctan2(length, start @ end))) if length > 1e-15 else np.eye(3)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
