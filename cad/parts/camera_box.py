"""A camera's body in rig, the six points that fix it in a clip, and the axes of the rig by the names that parts use.

Sprung screws press the body against all six points of a nest. Contacts are without friction, so that the six forces
follow from equilibrium alone: what friction adds only helps. A screw sits in a leaf of the clip, a cantilever that
bends as the screw is turned on after it touches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.fasteners import Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody

GRAVITY_N_PER_KG = 9.80665
# An M3 screw moves by this much with one turn (ISO 261), and this far it is turned on after it touches the body.
PITCH_MM = 0.5
TURNS = 0.75


@dataclass(frozen=True)
class Leaf:
    """A cantilever of rectangular section, `length_mm` from its root to the screw, that bends in one plane.

    The last `stiff_mm` of it, round the thread, do not bend. The screw presses at an angle whose cosine to the plane
    of bending is `cosine`.
    """

    length_mm: float
    stiff_mm: float
    width_mm: float
    thickness_mm: float
    cosine: float

    @property
    def bent_mm(self) -> float:
        """How far its end is bent when the screw has been turned on by `TURNS`.

        Only the leaf gives way: for the screw to move by s along its axis, it must bend by s / cosine.
        """
        return TURNS * PITCH_MM / self.cosine

    @property
    def _cubed_mm3(self) -> float:
        return self.length_mm**3 - self.stiff_mm**3

    def force_n(self, modulus_mpa: float) -> float:
        """The force along the screw: 3 E I d / (l^3 - s^3) across the leaf, of the beam equation with a stiff end.

        For s = 0 this is the end load of a cantilever, d = F l^3 / (3 E I) (Young, Roark's Formulas for Stress and
        Strain, table of beams, case 1a).
        """
        moment = self.width_mm * self.thickness_mm**3 / 12.0
        return 3.0 * modulus_mpa * moment * self.bent_mm / self._cubed_mm3 / self.cosine

    @property
    def strain(self) -> float:
        """The greatest strain, at the root: 3/2 t d l / (l^3 - s^3), of the moment F l there."""
        return 1.5 * self.thickness_mm * self.bent_mm * self.length_mm / self._cubed_mm3


def leaf_thickness_mm(force_n: float, leaf: Leaf, modulus_mpa: float) -> float:
    """The thickness at which a leaf presses with a force: `Leaf.force_n` solved for it."""
    return leaf.thickness_mm * float(np.cbrt(force_n / leaf.force_n(modulus_mpa)))


@dataclass(frozen=True)
class SprungScrew:
    """A screw in a leaf: its tip (3,) on the body, its axis (3,) from head to tip, in rig, mm.

    Its insert's mouth, or the face that the screw enters before its nut, is `mouth_mm` from the tip along the axis;
    from there on `thread_mm` deep begins the insert (0) or the nut. `nut_way_mm` (n, 3) are the moves by which a nut
    would leave its seat. The leaf's face towards the body goes through `leaf_at` (3,), its thickness is along
    `leaf_way` (3,).
    """

    tip: FloatArray
    axis: FloatArray
    mouth_mm: float
    thread_mm: float
    length_mm: float
    leaf: Leaf
    nut_way_mm: FloatArray
    leaf_at: FloatArray
    leaf_way: FloatArray

    @property
    def head(self) -> FloatArray:
        """Where the lower face of its head is (3,) when it touches the body."""
        return self.tip - self.length_mm * self.axis


@dataclass(frozen=True)
class Nest:
    """Six points (6, 3) in rig, mm, where a body rests, the unit vectors (6, 3) into it there, and what presses.

    The first three fix the body's front.
    """

    points: FloatArray
    normals: FloatArray
    screws: tuple[SprungScrew, ...]


def wrenches(points: FloatArray, forces: FloatArray) -> FloatArray:
    """Forces (n, 3) at points (n, 3) as columns (6, n): force, then moment about the origin, in N and N mm."""
    return np.vstack([forces.T, np.cross(points, forces).T])


def reactions(nest: Nest, points: FloatArray, forces: FloatArray) -> FloatArray:
    """Forces (6, n) of the six points, along their normals, that hold each of forces (n, 3) at points (n, 3)."""
    held_by = wrenches(nest.points, nest.normals)
    return np.asarray(np.linalg.solve(held_by, -wrenches(points, forces)), dtype=np.float64)


def least_forces_n(nest: Nest, middle: FloatArray, weight_n: float) -> FloatArray:
    """Force of each screw (m,) with which no point lets go while a weight at the middle (3,) pulls any way.

    Each screw takes the points on which it presses more than any other does. Infinite where one of them presses
    nowhere, or lifts the body off a point that no other screw presses.
    """
    pressed = reactions(nest, *_presses(nest))
    pulled = weight_n * np.linalg.norm(reactions(nest, np.tile(middle, (3, 1)), np.eye(3)), axis=1)
    strongest = pressed.argmax(axis=1)
    forces = np.zeros(len(nest.screws))
    for point, screw in enumerate(strongest):
        share = pressed[point, screw]
        forces[screw] = max(forces[screw], pulled[point] / share if share > 1e-9 else np.inf)
    return forces


def least_contact_n(nest: Nest, middle: FloatArray, weight_n: float, modulus_mpa: float) -> float:
    """The smallest force at any of the six points, the leaves bent as planned, while a weight pulls the worst way."""
    forces = np.array([screw.leaf.force_n(modulus_mpa) for screw in nest.screws])
    pulled = weight_n * np.linalg.norm(reactions(nest, np.tile(middle, (3, 1)), np.eye(3)), axis=1)
    return float((reactions(nest, *_presses(nest)) @ forces - pulled).min())


def _presses(nest: Nest) -> tuple[FloatArray, FloatArray]:
    """Tips (m, 3) of the screws, and unit vectors (m, 3) along which they press."""
    return np.array([screw.tip for screw in nest.screws]), np.array([screw.axis for screw in nest.screws])


def motion_of_errors(nest: Nest) -> FloatArray:
    """Jacobian (6, 6): how the body moves, in mm and rad in rig, by an error in mm of each point along its normal.

    At each point the body follows: n . (t + w x p) = e. The first three rows are the shift t of the pupil, which is the
    origin, the others the turn w.
    """
    return np.asarray(np.linalg.inv(wrenches(nest.points, nest.normals).T), dtype=np.float64)


UP = np.array([1.0, 0.0, 0.0])
SCENE = np.array([0.0, 1.0, 0.0])
ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class BodyBox:
    """A camera's body in rig, mm: a box from `low` (3,) to `high` (3,), its front at the right depth of the pupil."""

    low: FloatArray
    high: FloatArray

    @property
    def solid(self) -> Frustum:
        return box(tuple(self.low), tuple(self.high))

    @property
    def middle(self) -> FloatArray:
        """The middle (3,) of the box."""
        return (self.low + self.high) / 2.0


def body_box(camera: CameraBody) -> BodyBox:
    """The camera's body with its entrance pupil at the origin."""
    low, high = camera.box_mm
    return BodyBox(np.array(low), np.array(high))


def tie_height_mm(hardware: Hardware) -> float:
    """Height of the wall below a camera that the slots for its cable's tie need."""
    return hardware.mount.tie_mm[0] + 2.0 * (hardware.printer.wall_mm + hardware.fit.slide_mm)


@dataclass(frozen=True)
class Held:
    """How a camera is held, in rig, mm: pieces and cuts, and the wall that joins them.

    The wall's face towards the camera is at y = `inner_y_mm`; it spans `x_mm` (from, to) and `z_mm` (from, to).
    `board_screws` (n, 3) are where the heads of a board's own screws rest; a body has a nest.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    inner_y_mm: float
    x_mm: tuple[float, float]
    z_mm: tuple[float, float]
    board_screws: FloatArray
    nest: Nest | None = None
