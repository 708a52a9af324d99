"""A camera's body in the rig frame, the six points that locate it in a clip, and the axes of the rig.

Sprung screws press the body against all six points of a nest. Contacts are modelled without friction, so the six
forces follow from equilibrium alone; friction only adds to the hold. A screw sits in a leaf of the clip, a cantilever
that bends when the screw is turned further after contact.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mirrorcam.cad.plan.dimension import GENERAL_MM
from mirrorcam.cad.plan.fasteners import Bore, Countersink, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody

GRAVITY_N_PER_KG = 9.80665
# Turns of a screw after it touches the body, and the error of a turn by hand.
CONTACT_TURNS, TURN_ERROR = 0.5, 0.125
# Tolerance of a leaf's thickness as printed, which its drawing states.
LEAF_TOLERANCE_MM = 0.1
# Rotation of the edge of a half-plane per bending moment on its edge, times E' t^2 per width (O'Donnell 1960, The
# additional deflection of a cantilever due to the elasticity of the support, J. Appl. Mech. 27).
ROOT_ROTATION = 16.67 / np.pi
POISSON = 0.35


@dataclass(frozen=True)
class Leaf:
    """A cantilever of rectangular section, `length_mm` from its root to the screw, that bends in one plane.

    The last `stiff_mm`, round the thread, are rigid. The wall at its root yields as an elastic half-plane, `root` times
    as far: 1 in the middle of a wall, more at its end. `cosine` belongs to the angle between the screw's axis and
    the direction of deflection; `pitch_mm` is the screw's pitch.
    """

    length_mm: float
    stiff_mm: float
    width_mm: float
    thickness_mm: float
    cosine: float
    pitch_mm: float
    root: float = 1.0

    @property
    def weakest(self) -> Leaf:
        """The leaf at its limits: thinner by `LEAF_TOLERANCE_MM`, longer and narrower by `GENERAL_MM`."""
        return replace(
            self,
            thickness_mm=self.thickness_mm - LEAF_TOLERANCE_MM,
            length_mm=self.length_mm + GENERAL_MM,
            width_mm=self.width_mm - GENERAL_MM,
        )

    @property
    def _terms(self) -> tuple[float, float]:
        """Deflection per force, times the modulus: the factors of 1 / t^3 and of 1 / t^2.

        The first is 4 (l^3 - s^3) / w, as of a cantilever with a rigid end (Young, Roark's Formulas for Stress and
        Strain, table of beams, case 1a), the second the rotation of the root times its lever arm l.
        """
        bending = 4.0 * (self.length_mm**3 - self.stiff_mm**3) / self.width_mm
        return bending, self.root * ROOT_ROTATION * (1.0 - POISSON**2) * self.length_mm**2 / self.width_mm

    def force_n(self, modulus_mpa: float, turns: float = CONTACT_TURNS) -> float:
        """The force along the screw after turns of it beyond contact.

        Only leaf and root deform: the screw's displacement along its axis is the deflection times the cosine.
        """
        bending, root = self._terms
        compliance = (bending / self.thickness_mm**3 + root / self.thickness_mm**2) / modulus_mpa
        return turns * self.pitch_mm / (compliance * self.cosine**2)

    def least_force_n(self, modulus_mpa: float, creep: float) -> float:
        """The smallest force along the screw that is certain after 1000 h.

        The leaf is the `weakest` within its tolerances, the screw turned too little by `TURN_ERROR`, and the plastic
        has crept by `creep` times its elastic strain.
        """
        return self.weakest.force_n(modulus_mpa, CONTACT_TURNS - TURN_ERROR) / (1.0 + creep)

    def strain(self, modulus_mpa: float) -> float:
        """The largest strain, at the root: 6 F l / (E w t^2), from the moment F l there."""
        normal_n = self.force_n(modulus_mpa) * self.cosine
        return 6.0 * normal_n * self.length_mm / (modulus_mpa * self.width_mm * self.thickness_mm**2)

    def with_least_force(self, force_n: float, modulus_mpa: float, creep: float) -> Leaf:
        """The leaf whose `least_force_n` is a given force."""
        bending, root = self.weakest._terms
        advance = (CONTACT_TURNS - TURN_ERROR) * self.pitch_mm
        load = force_n * (1.0 + creep) * self.cosine**2 / (modulus_mpa * advance)
        # load (bending / t^3 + root / t^2) = 1 has one positive root.
        roots = np.roots([1.0, 0.0, -load * root, -load * bending])
        thickness = float(roots[np.isreal(roots)].real.max())
        return replace(self, thickness_mm=thickness + LEAF_TOLERANCE_MM)


@dataclass(frozen=True)
class SprungScrew:
    """A screw in a leaf: its tip (3,) on the body, its axis (3,) from head to tip, in the rig frame, mm.

    The face that the screw enters is `mouth_mm` from the tip along the axis. The insert (0) or the nut starts
    `thread_mm` below that face. `nut_way_mm` (n, 3) are the successive moves by which a nut leaves its seat. The leaf's
    face towards the body contains the point `leaf_at` (3,), and its thickness is along the direction `leaf_way` (3,).
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
        """The centre (3,) of its head's lower face when the screw touches the body."""
        return self.tip - self.length_mm * self.axis


@dataclass(frozen=True)
class Nest:
    """Six points (6, 3) in the rig frame, mm, that locate a body, and the screws that press the body against them.

    `normals` (6, 3) are unit normals at the points, into the body. The first three points locate the body's front.
    """

    points: FloatArray
    normals: FloatArray
    screws: tuple[SprungScrew, ...]


def wrenches(points: FloatArray, forces: FloatArray) -> FloatArray:
    """Forces (n, 3) at points (n, 3) as columns (6, n): force, then moment about the origin, in N and N mm."""
    return np.vstack([forces.T, np.cross(points, forces).T])


def reactions(nest: Nest, points: FloatArray, forces: FloatArray) -> FloatArray:
    """Forces (6, n) of the six points along their normals, in equilibrium with each force (n, 3) at a point (n, 3)."""
    contacts = wrenches(nest.points, nest.normals)
    return np.asarray(np.linalg.solve(contacts, -wrenches(points, forces)), dtype=np.float64)


def required_forces_n(nest: Nest, centre: FloatArray, weight_n: float) -> FloatArray:
    """Force of each screw (m,) that keeps all points in contact under a weight at a centre (3,) in any direction.

    Each point is assigned to the screw that presses hardest on it. Forces are infinite if none presses on a point.
    """
    preload = reactions(nest, *_screw_lines(nest))
    load = weight_n * np.linalg.norm(reactions(nest, np.tile(centre, (3, 1)), np.eye(3)), axis=1)
    best_screw = preload.argmax(axis=1)
    forces = np.zeros(len(nest.screws))
    for point, screw in enumerate(best_screw):
        gain = preload[point, screw]
        forces[screw] = max(forces[screw], load[point] / gain if gain > 1e-9 else np.inf)
    return forces


def min_contact_n(nest: Nest, centre: FloatArray, weight_n: float, modulus_mpa: float, creep: float) -> float:
    """The smallest force at the six points, with the least forces of the leaves and a weight in the worst direction."""
    forces = np.array([screw.leaf.least_force_n(modulus_mpa, creep) for screw in nest.screws])
    load = weight_n * np.linalg.norm(reactions(nest, np.tile(centre, (3, 1)), np.eye(3)), axis=1)
    return float((reactions(nest, *_screw_lines(nest)) @ forces - load).min())


def _screw_lines(nest: Nest) -> tuple[FloatArray, FloatArray]:
    """Tips (m, 3) of the screws, and their unit axes (m, 3)."""
    return np.array([screw.tip for screw in nest.screws]), np.array([screw.axis for screw in nest.screws])


def error_jacobian(nest: Nest) -> FloatArray:
    """Jacobian (6, 6) of the body's motion, mm and rad in the rig frame, with respect to an error in mm of each point.

    The body follows an error e along the point's normal: n . (t + w x p) = e. The first three rows are the shift t of
    the pupil, which is the origin, and the others the rotation w.
    """
    return np.asarray(np.linalg.inv(wrenches(nest.points, nest.normals).T), dtype=np.float64)


# Axes of the rig: upwards while the mount prints, towards the scene, and along the optical axis, upwards in the device.
UP = np.array([1.0, 0.0, 0.0])
SCENE = np.array([0.0, 1.0, 0.0])
ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class BodyBox:
    """The bounding box of a camera's body, from `low` (3,) to `high` (3,) in the rig frame, mm; the pupil is at 0."""

    low: FloatArray
    high: FloatArray

    @property
    def solid(self) -> Frustum:
        return box(tuple(self.low), tuple(self.high))

    @property
    def centre(self) -> FloatArray:
        """The centre (3,) of the box."""
        return (self.low + self.high) / 2.0


def body_box(camera: CameraBody) -> BodyBox:
    """The box of a camera's body with its entrance pupil at the origin."""
    low, high = camera.box_mm
    return BodyBox(np.array(low), np.array(high))


def tie_height_mm(hardware: Hardware) -> float:
    """Height of the wall below a camera for the slots of its cable's tie."""
    return hardware.mount.tie_mm[0] + 2.0 * (hardware.printer.wall_mm + hardware.fit.slide_mm)


@dataclass(frozen=True)
class CameraScrew:
    """A screw of a camera: the centre (3,) of its head's rim, the direction (3,) out of its head, size and length.

    It engages `engaged_mm` of a thread in the camera; 0 for a screw that forms its thread in the clip.
    """

    head: FloatArray
    out: FloatArray
    size: str
    length_mm: float
    engaged_mm: float = 0.0


@dataclass(frozen=True)
class Cradle:
    """The part of a clip that holds a camera, in the rig frame, mm: pieces, cuts, and the extent of the joining wall.

    The wall's face towards the camera is at y = `inner_y_mm`; it spans `x_mm` (from, to) and `z_mm` (from, to).
    `screws` hold a board, or are in a body's own threads. A body rests on the six points of a `nest`; without
    sprung screws, `straps_mm` (n, 3) are the x coordinates of both slots of each tie round the body, and their z.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Countersink | Hexagon, ...]
    inner_y_mm: float
    x_mm: tuple[float, float]
    z_mm: tuple[float, float]
    screws: tuple[CameraScrew, ...] = ()
    nest: Nest | None = None
    straps_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
