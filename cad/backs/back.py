"""An adapter under the rest of the device: its parts, joints, purchased items, support and load.

Adapters are planned in the stand frame, and `in_rig` takes them to the rig frame. The load is the mass and centre
of all that the adapter carries. It follows from the plans, before any part is made.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import Stack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import Connection, PurchasedItem, Rgb
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stand import aim_in_rig, design_depths_mm, rotated
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

# Colours of the part under the mount's foot, and of the part fastened to it.
RGB: Rgb = (0.35, 0.60, 0.42)
SECOND_RGB: Rgb = (0.55, 0.74, 0.52)
# Print orientations of an adapter's part: the rows are the bed's x, y and z axes in the stand frame.
UPRIGHT = np.eye(3)
FRONT_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
BACK_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
TOP_DOWN = np.diag([1.0, -1.0, -1.0])
SIDE_DOWN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
# Columns: x, y and z axes of the device's link on an arm in the stand frame.
LINK_AXES = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class PlannedPart(Protocol):
    """The plan of an adapter's printed part."""

    @property
    def corners(self) -> FloatArray:
        """Points (n, 3) whose hull contains the part and has its extent along each axis."""
        ...

    @property
    def hulls(self) -> tuple[Frustum, ...]:
        """Convex solids that contain the part; none if its planner has compared it with the light."""
        ...

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The dimensions for its drawing."""
        ...


@dataclass(frozen=True)
class RotatedPlan:
    """The plan of a part in the stand frame, and the rotation (3, 3) to the rig frame."""

    plan: PlannedPart
    rig_from_stand: FloatArray

    @property
    def corners(self) -> FloatArray:
        """Points (n, 3) in the rig frame whose hull contains the part and has its extent along the stand's axes."""
        return np.asarray(self.plan.corners @ self.rig_from_stand.T)

    @property
    def hulls(self) -> tuple[Frustum, ...]:
        """Convex solids in the rig frame that contain the part."""
        return tuple(rotated(hull, self.rig_from_stand) for hull in self.plan.hulls)

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The dimensions in the rig frame."""
        return tuple(dimension.rotated(self.rig_from_stand) for dimension in self.plan.dimensions)


@dataclass(frozen=True)
class BackPart:
    """A printed part of an adapter: its plan, orientation on the bed (3, 3), and displacement in an exploded view.

    The plan is a `PlannedPart` in the stand frame, or a `RotatedPlan` in the rig frame.
    """

    name: str
    title: str
    plan: Any
    bed_from_rig: FloatArray
    explode_mm: FloatArray
    rgb: Rgb


@dataclass(frozen=True)
class BackJoint:
    """Screws between two parts of an adapter, into inserts or nuts.

    Their heads are at points (n, 3), `out` (3,) points from the tips to the heads, and `stack` is their grip and
    thread. Nuts have a corner towards `corners` (3,) and leave their seats by the moves `nut_exits_mm` (n, k, 3).
    """

    heads: FloatArray
    out: FloatArray
    stack: Stack
    joins: tuple[str, str]
    nut_exits_mm: FloatArray
    corners: FloatArray


@dataclass(frozen=True)
class Support:
    """The adapter's support: convex solids, mm, for clearances and light; not part of the device."""

    name: str
    solids: tuple[Frustum, ...]


# Load of a device that is carried, knocked or moved by an arm, as a multiple of its weight.
LOAD_FACTOR = 3.0


@dataclass(frozen=True)
class CriticalSection:
    """A weak section that bears the load: a rectangle about `centre` (3,), with a unit `normal` (3,).

    `sides_mm` are its lengths along `axis` (3,), in its plane, and normal to that axis. With `arm_mm`, the section only
    bends about `axis`, under forces at that lever arm, such as a force on the edge of a foot.
    """

    name: str
    centre: FloatArray
    normal: FloatArray
    axis: FloatArray
    sides_mm: tuple[float, float]
    arm_mm: float | None = None

    def stress_mpa(self, force_n: float, point: FloatArray) -> float:
        """The largest stress due to a force at a point (3,) in any direction, as the sum of its components.

        Tension F / A, bending M / W about both sides, W = b h^2 / 6, and torsion T / (k a b^2) with sides a >= b and
        k = 1/5, a lower bound for all rectangles (Timoshenko, Theory of Elasticity, 109).
        """
        a, b = self.sides_mm
        if self.arm_mm is not None:
            return force_n * (1.0 / (a * b) + self.arm_mm / (a * b**2 / 6.0))
        lever = point - self.centre
        axes = (self.axis, np.cross(self.normal, self.axis), self.normal)
        first_arm, second_arm, normal_arm = (float(np.linalg.norm(lever - (lever @ axis) * axis)) for axis in axes)
        bending = first_arm / (a * b**2 / 6.0) + second_arm / (b * a**2 / 6.0)
        torsion = normal_arm / (max(a, b) * min(a, b) ** 2 / 5.0)
        return force_n * (1.0 / (a * b) + bending + torsion)


@dataclass(frozen=True)
class RobotLink:
    """The device's attachment to an arm: the parent link, and the pose of the device's link in it.

    The device's link has x level towards the scene as the device stands on the arm, y left and z up (REP 103); its pose
    is `rig_from_link` (4, 4), mm. In the parent's frame it is at `xyz_mm`, with `rpy` in rad about the fixed axes.
    `arms` names the arms that fit, and `attached` states in the guide where on its link the device is.
    """

    parent: str
    xyz_mm: tuple[float, float, float]
    rpy: tuple[float, float, float]
    rig_from_link: FloatArray
    arms: str
    attached: str


def link_at(origin: FloatArray) -> FloatArray:
    """The pose (4, 4) of the device's link in the stand frame, with its origin at a point (3,)."""
    return rigid(LINK_AXES, origin)


@dataclass(frozen=True)
class Stand:
    """The base of a free-standing device: a convex polygon (n, 2; x and y) in the stand frame, at height `z_mm`.

    Tilted by `tip_deg` in any direction, the device must not fall over.
    """

    corners: FloatArray
    z_mm: float
    tip_deg: float


@dataclass(frozen=True)
class Back:
    """An adapter of any kind, mm; its first part is screwed to the mount's foot.

    It is planned in the stand frame, and `in_rig` takes all of it but `stand` to the rig frame. The foot's screws, of
    the form `foot_form` ("" or `COUNTERSUNK`), have their heads at `foot_heads` (4, 3) and the stack `foot`. `joints`
    are further screws with their threads, `items` other purchased items, and `connections` the joints between its
    parts. `table` is the hardware's table from which it was planned. In the guide, `heading` is the heading of its
    step, `fits` states what it is for, and `steps` follow the sentence that screws it to the mount. On a wedge a device
    stands differently: `planned_from_stand` (3, 3) is the rotation from the frame in which it stands to the one in
    which the mount's foot is level. `rig_from_stand` (3, 3) is the rotation to the rig frame.
    """

    table: Any
    parts: tuple[BackPart, ...]
    foot: Stack
    foot_heads: FloatArray
    heading: str
    foot_form: str = ""
    joints: tuple[BackJoint, ...] = ()
    items: tuple[PurchasedItem, ...] = ()
    connections: tuple[Connection, ...] = ()
    supports: tuple[Support, ...] = ()
    critical_sections: tuple[CriticalSection, ...] = ()
    robot: RobotLink | None = None
    stand: Stand | None = None
    fits: str = ""
    steps: tuple[str, ...] = ()
    planned_from_stand: FloatArray = field(default_factory=lambda: np.eye(3))
    rig_from_stand: FloatArray = field(default_factory=lambda: np.eye(3))

    @property
    def kind(self) -> str:
        """The kind, by its name in hardware files and commands."""
        return str(self.table.kind)

    @property
    def look_deg(self) -> float:
        """The angle of the views above the horizon as the device stands, or above the axis of an arm's flange."""
        look = np.radians(self.table.look_deg)
        up = self.planned_from_stand[:, 2]
        return float(np.degrees(np.arcsin(up @ [0.0, np.cos(look), np.sin(look)])))


def in_sentence(title: str) -> str:
    """A title within a sentence: its first letter is small unless it begins an abbreviation."""
    return f"{title[0].lower()}{title[1:]}" if title[1:2].islower() else title


def in_rig(back: Back, rig_from_stand: FloatArray) -> Back:
    """An adapter planned in the stand frame, in the rig frame; `rig_from_stand` (3, 3) is the foot's rotation."""
    frame = rigid(rig_from_stand, np.zeros(3))

    def turned(vectors: FloatArray) -> FloatArray:
        return np.asarray(vectors @ rig_from_stand.T)

    return replace(
        back,
        parts=tuple(
            replace(
                part,
                plan=RotatedPlan(part.plan, rig_from_stand),
                bed_from_rig=part.bed_from_rig @ rig_from_stand.T,
                explode_mm=turned(part.explode_mm),
            )
            for part in back.parts
        ),
        foot_heads=turned(back.foot_heads),
        joints=tuple(
            replace(
                joint,
                heads=turned(joint.heads),
                out=turned(joint.out),
                nut_exits_mm=turned(joint.nut_exits_mm),
                corners=turned(joint.corners),
            )
            for joint in back.joints
        ),
        items=tuple(
            replace(
                item,
                rig_from_item=frame @ item.rig_from_item,
                explode_mm=turned(item.explode_mm),
                exit_moves_mm=turned(item.exit_moves_mm),
            )
            for item in back.items
        ),
        connections=tuple(
            replace(
                joint,
                rig_from_parent_joint=frame @ joint.rig_from_parent_joint,
                rig_from_child_joint=frame @ joint.rig_from_child_joint,
            )
            for joint in back.connections
        ),
        supports=tuple(
            replace(support, solids=tuple(rotated(solid, rig_from_stand) for solid in support.solids))
            for support in back.supports
        ),
        critical_sections=tuple(
            replace(section, centre=turned(section.centre), normal=turned(section.normal), axis=turned(section.axis))
            for section in back.critical_sections
        ),
        robot=back.robot and replace(back.robot, rig_from_link=frame @ back.robot.rig_from_link),
        rig_from_stand=rig_from_stand @ back.planned_from_stand,
    )


def above_desk_mm(back: Back, layout: Layout, hardware: Hardware) -> float | None:
    """The smallest height of the middle ray above the desk at the depths of the design; None without a desk."""
    if back.stand is None:
        return None
    up = back.rig_from_stand[:, 2]
    return min(float(aim_in_rig(layout, depth) @ up) for depth in design_depths_mm(layout, hardware)) - back.stand.z_mm


@dataclass(frozen=True)
class Load:
    """A mass in g, and its centre (3,) in the stand frame, mm."""

    mass_g: float
    centre: FloatArray


def carried_load(mount: MountPlan, clip: ClipPlan, hardware: Hardware) -> Load:
    """Mass and centre of all but the adapter: the holder as printed, the mirrors, the mount, the clip and the camera.

    Mount and clip count as solid, and their overlapping pieces in full, so this is an upper bound, for the design of
    adapters. Checks use the masses of the parts as printed.
    """
    body = body_box(hardware.camera)
    masses = [
        (mount.load_g, mount.load_at),
        _mass_of(mount.pieces, hardware),
        _mass_of(clip.pieces, hardware),
        (hardware.camera.mass_g, (body.low + body.high) / 2.0),
    ]
    mass = sum(grams for grams, _ in masses)
    return Load(mass, np.asarray(sum(grams * centre for grams, centre in masses) / mass) @ mount.foot.rig_from_stand)


def _mass_of(pieces: tuple[Frustum, ...], hardware: Hardware) -> tuple[float, FloatArray]:
    """Mass in g, and centre (3,), of pieces of plastic."""
    volumes = np.array([abs(volume_mm3(piece)) for piece in pieces])
    centres = np.array([np.vstack([piece.base, piece.top]).mean(axis=0) for piece in pieces])
    mass_g = float(volumes.sum()) * hardware.printer.plastic_g_per_cm3 / 1000.0
    return mass_g, np.asarray(volumes @ centres / volumes.sum())
