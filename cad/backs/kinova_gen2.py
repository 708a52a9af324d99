"""Kinova's second generation: a split clamp round the arm's last shell, its upper half (saddle) under the mount's foot.

The wrist runs along y of the stand frame below the camera, parallel to level views. Both halves are profiles in the x-z
plane, extruded along y; they print with the clamp's face on the bed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mirrorcam.cad.backs.back import (
    FRONT_DOWN,
    RGB,
    SECOND_RGB,
    Back,
    BackJoint,
    BackPart,
    CriticalSection,
    Load,
    RobotLink,
    Support,
    link_at,
)
from mirrorcam.cad.backs.blocks import ALONG_X
from mirrorcam.cad.parts.camera_box import ABOVE, SCENE
from mirrorcam.cad.parts.truss import FOOT_DEPTH_MM, FOOT_X_MM, Foot, foot_stack
from mirrorcam.cad.plan.back_table import CAP_EAR_MM, Gen2Back
from mirrorcam.cad.plan.dimension import Hole, Length, holes, length
from mirrorcam.cad.plan.fasteners import (
    NUT_FIT_MM,
    OUTSIDE_MM,
    Bore,
    Hexagon,
    Stack,
    exit_move,
    head_space_mm,
    stack,
    thread,
)
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import Connection
from mirrorcam.cad.plan.prisms import box, corners_of
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import markdown_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

SADDLE, CAP = Gen2Back.parts
UP = np.array([0.0, -1.0, 0.0])
EAR_OFFSET_MM = 0.3

ARMS = "MICO and JACO with two fingers: m1n4s200, m1n6s200, j2n6s200, j2s6s200 of kinova-ros"
# SHELL_MM: distance from the link's origin towards the fingers, smallest and largest radius of the last shell with two
# fingers. JOINT_RING_MM: radius of the joint's ring, and its extent to both sides of the origin. Measured in sections
# of `hand_2finger.STL` and `ring_small.STL`, kinova-ros, kinova_description/meshes, commit 924781d3 (Kinova Robotics,
# BSD-3-Clause). The shell with three fingers, `hand_3finger.STL`, does not fit: its radius is 31.5 to 31.8 mm at 12 mm
# and up to 34.0 mm at 18 mm, where the clamp needs a round shell.
SHELL_MM = np.array(
    [
        *((0.0, 31.47, 31.51), (4.0, 31.43, 31.51), (8.0, 31.41, 31.51), (10.0, 31.41, 31.51), (12.0, 31.43, 31.51)),
        *((14.0, 31.47, 31.50), (16.0, 31.49, 31.53), (17.0, 31.46, 31.59), (18.0, 31.41, 31.64), (19.0, 31.34, 31.72)),
        *((20.0, 31.25, 31.82), (22.0, 31.04, 32.10), (24.0, 30.76, 32.53), (27.0, 30.09, 33.47), (30.0, 28.99, 34.71)),
        *((35.0, 26.52, 37.00), (40.0, 23.81, 39.25), (45.0, 21.26, 41.65)),
    ]
)
SHELL_DIAMETER_MM = 63.0
JOINT_RING_MM = (34.05, 9.75)
# Distance up to which the shell is round to 0.12 mm.
ROUND_TO_MM = 18.0
# Sagitta of the facets of round solids, with corners on the circle.
SAGITTA_MM = 0.02


@dataclass(frozen=True)
class RingPlan:
    """Half of the clamp in the stand frame, mm: half a ring about x = 0, z = `axis_z_mm`, with its pieces.

    `above` is true for the upper half. The ring spans `band_mm` (2,) along y and has the inner radius `radius_mm`.
    `ears` (2, 3) are the points where the clamp's screws pass through its face towards the other half.
    """

    name: str
    above: bool
    radius_mm: float
    ring_mm: float
    axis_z_mm: float
    gap_mm: float
    band_mm: FloatArray
    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    ears: FloatArray

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The bore, the clamp's band, the ear, and the holes."""
        centre = np.array([0.0, self.band_mm[1], self.axis_z_mm])
        radius, band = np.array([self.radius_mm, 0.0, 0.0]), np.array([0.0, np.ptp(self.band_mm), 0.0])
        ear = np.array([self.ears[:, 0].min(), self.band_mm[1], self.ears[0, 2]])
        outer = self.radius_mm + self.ring_mm
        thickness = float(np.ptp(corners_of(self.pieces[-1:])[:, 2]))
        return (
            length(centre - radius, centre + radius, f"bore, ring Ø{2.0 * outer:g}", before="Ø"),
            length(ear - band, ear, "band"),
            length(ear, ear + (1.0 if self.above else -1.0) * thickness * ABOVE, "ear"),
            *holes(self.cuts),
        )

    @property
    def corners(self) -> FloatArray:
        """The corners (8, 3) of its bounding box."""
        return corners_of(self.hulls)

    @property
    def hulls(self) -> tuple[Frustum, ...]:
        """Its bounding box."""
        return (self.bounds,)

    @property
    def bounds(self) -> Frustum:
        """Its bounding box."""
        outer = self.radius_mm + self.ring_mm
        level = self.axis_z_mm + (self.gap_mm if self.above else -self.gap_mm) / 2.0
        end = self.axis_z_mm + (outer if self.above else -outer)
        solids = (
            box((-outer, self.band_mm[0], min(level, end)), (outer, self.band_mm[1], max(level, end))),
            *self.pieces,
        )
        corners = corners_of(solids)
        return box(tuple(corners.min(axis=0)), tuple(corners.max(axis=0)))


@dataclass(frozen=True)
class ClampPlan:
    """Both halves, the `Stack` of the clamp's and of the foot's screws, and the positions (n, 3) of their heads."""

    saddle: RingPlan
    cap: RingPlan
    clamp: Stack
    foot: Stack
    foot_heads: FloatArray
    clamp_heads: FloatArray


def plan_gen2(wrist: Gen2Back, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out the clamp as an adapter: the device is over the wrist and looks along it."""
    plan = plan_clamp(wrist, foot, hardware)
    saddle, cap = plan.saddle, plan.cap
    joins = (CAP, SADDLE)
    corners = saddle.corners
    seats = plan.clamp_heads + (plan.clamp.grip_mm + plan.clamp.begins_mm) * ABOVE
    centre_y = float(saddle.band_mm.mean())
    downwards = np.diag([1.0, -1.0, -1.0])
    split = rigid(downwards, saddle.ears.mean(axis=0))
    cap_split = rigid(downwards, cap.ears.mean(axis=0) + cap.gap_mm * ABOVE)
    ring_top = saddle.axis_z_mm + saddle.radius_mm + saddle.ring_mm
    saddle_half = FOOT_X_MM + _boss_radius_mm(hardware) + 1.0
    return Back(
        table=wrist,
        parts=(
            BackPart(SADDLE, "Adapter saddle", saddle, FRONT_DOWN, np.array([0.0, -60.0, -45.0]), RGB),
            BackPart(CAP, "Adapter cap", cap, FRONT_DOWN, np.array([0.0, -60.0, -95.0]), SECOND_RGB),
        ),
        foot=plan.foot,
        foot_heads=plan.foot_heads,
        # The channel for these nuts runs along y, with two of their flats on its sides.
        joints=(
            BackJoint(
                plan.clamp_heads,
                -ABOVE,
                plan.clamp,
                joins,
                np.array([[exit_move(corners, seat, -SCENE)] for seat in seats]),
                SCENE,
            ),
        ),
        connections=(Connection("clamp", SADDLE, CAP, split, cap_split),),
        supports=(Support("wrist", _wrist(wrist, centre_y, saddle.axis_z_mm)),),
        heading="clamp the device to the arm",
        fits=f"This clamp is for {markdown_text(wrist.name)} ({ARMS}). It does not fit the hand with three fingers, "
        "which widens where the clamp needs a round shell.",
        steps=(
            f"Wipe the last shell of the wrist (Ø{wrist.diameter_mm:g} mm) clean. The clamp goes on the band of "
            f"{wrist.band_mm:g} mm between the ring of the last joint and the hand.",
            f"Place the saddle on that band, close the cap, and tighten its screws alternately: the gap of "
            f"{wrist.gap_mm:g} mm must stay equal on both sides. The clamp must not rotate when you push the holder by "
            "hand.",
        ),
        critical_sections=(
            CriticalSection(
                "saddle over the ring",
                np.array([0.0, centre_y, ring_top]),
                ABOVE,
                ALONG_X,
                (2.0 * saddle_half, float(np.ptp(saddle.band_mm))),
            ),
        ),
        # Kinova's last link has its z along the wrist and its fingers towards -z.
        robot=RobotLink(
            parent=wrist.link,
            xyz_mm=(0.0, 0.0, -wrist.along_mm),
            rpy=(0.0, np.pi / 2.0, 0.0),
            rig_from_link=link_at(np.array([0.0, centre_y, saddle.axis_z_mm])),
            arms=ARMS,
            attached=f"{wrist.along_mm:g} mm from its origin towards the fingers",
        ),
    )


def _wrist(wrist: Gen2Back, centre_y_mm: float, axis_z_mm: float) -> tuple[Frustum, ...]:
    """The joint's ring and the last shell as measured, with the clamp's centre at the table's distance along the shell.

    A different diameter scales the same shape. The shell has its mean radius in the clamp, and its largest outside.
    """
    scale, origin = wrist.diameter_mm / SHELL_DIAMETER_MM, centre_y_mm - wrist.along_mm
    distances, smallest, largest = SHELL_MM.T
    radii = scale * np.where(distances <= ROUND_TO_MM, (smallest + largest) / 2.0, largest)
    ring, half_length = scale * JOINT_RING_MM[0], JOINT_RING_MM[1]
    solids = [_round_solid((ring, ring), (origin - half_length, origin + half_length), axis_z_mm)]
    for (start, first), (end, last) in pairwise(zip(distances, radii, strict=True)):
        solids.append(_round_solid((first, last), (origin + start, origin + end), axis_z_mm))
    return tuple(solids)


def _round_solid(radii_mm: tuple[float, float], y_mm: tuple[float, float], axis_z_mm: float) -> Frustum:
    """A faceted cone or cylinder along y, by its two radii and ends."""
    count = int(np.ceil(np.pi / np.arccos(1.0 - SAGITTA_MM / max(radii_mm))))
    angles = 2.0 * np.pi / count * np.arange(count)
    ends = [
        np.column_stack([radius * np.cos(angles), np.full(count, y), axis_z_mm + radius * np.sin(angles)])
        for radius, y in zip(radii_mm, y_mm, strict=True)
    ]
    return Frustum(*ends)


def plan_clamp(wrist: Gen2Back, foot: Foot, hardware: Hardware) -> ClampPlan:
    """Lay out the clamp below the mount's foot; it is the same for all layouts."""
    screwed, clamp = foot_stack(hardware), stack(CAP_EAR_MM + wrist.gap_mm, hardware)
    position = _clamp_position(wrist, foot, hardware)
    spans, ears = _ears(wrist, position, hardware)
    heads = foot.screws - wrist.grip_mm * ABOVE
    clamp_heads = ears - (CAP_EAR_MM + wrist.gap_mm) * ABOVE
    (back, front), face, half = position.band_mm, wrist.gap_mm / 2.0, FOOT_X_MM + position.boss_radius_mm + 1.0
    saddle_z, cap_z = position.axis_z_mm + face, position.axis_z_mm - face
    saddle_pieces = (
        box((-half, back, position.axis_z_mm + 0.6 * position.radius_mm), (half, front, position.foot_z_mm)),
        box((-half, foot.front_y_mm - FOOT_DEPTH_MM, position.plate_z_mm), (half, front, position.foot_z_mm)),
        *(box((low, back, saddle_z), (high, front, saddle_z + clamp.wall_mm)) for low, high in spans),
    )
    cap_pieces = tuple(box((low, back, cap_z - CAP_EAR_MM), (high, front, cap_z)) for low, high in spans)
    clearance = hardware.screw.clearance_hole_mm / 2.0
    cap_cuts = tuple(Bore(head - ABOVE, ABOVE, clearance, CAP_EAR_MM + 2.0, UP) for head in clamp_heads)
    saddle_cuts = (*_foot_cuts(heads, wrist.grip_mm, hardware), *_ear_cuts(ears, position.band_mm, clamp, hardware))
    common = (position.radius_mm, wrist.ring_mm, position.axis_z_mm, wrist.gap_mm, position.band_mm)
    return ClampPlan(
        saddle=RingPlan(SADDLE, True, *common, saddle_pieces, saddle_cuts, ears),
        cap=RingPlan(CAP, False, *common, cap_pieces, cap_cuts, ears - wrist.gap_mm * ABOVE),
        clamp=clamp,
        foot=screwed,
        foot_heads=heads,
        clamp_heads=clamp_heads,
    )


@dataclass(frozen=True)
class _ClampPosition:
    """The clamp's position in the stand frame, mm: the wrist's radius and axis, and the clamp's band (2,) along y.

    Its plate is between z = `plate_z_mm` and the mount's foot; `boss_radius_mm` is the outer radius round a screw.
    """

    radius_mm: float
    axis_z_mm: float
    band_mm: FloatArray
    plate_z_mm: float
    foot_z_mm: float
    boss_radius_mm: float


def _boss_radius_mm(hardware: Hardware) -> float:
    """Radius of the wall round a screw."""
    return hardware.screw.insert_hole_mm / 2.0 + hardware.screw.insert_wall_mm


def _clamp_position(wrist: Gen2Back, foot: Foot, hardware: Hardware) -> _ClampPosition:
    """The clamp's position; raises InputError if its plate would be too thin for its screws."""
    screw = hardware.screw
    foot_z = foot.z_mm
    radius = wrist.diameter_mm / 2.0
    axis_z = foot_z - wrist.riser_mm - radius
    plate_z = axis_z + radius + wrist.joint_mm
    needed = wrist.grip_mm + screw.head_height_mm + hardware.printer.wall_mm
    if (thickness := foot_z - plate_z) < needed:
        raise InputError(
            f"adapter's plate is {thickness:.1f} mm thick, expected {needed:.1f} mm for its screws: raise riser_mm"
        )
    band = foot.front_y_mm + np.array([0.0, wrist.band_mm])
    return _ClampPosition(radius, axis_z, band, plate_z, foot_z, _boss_radius_mm(hardware))


def _ears(
    wrist: Gen2Back, position: _ClampPosition, hardware: Hardware
) -> tuple[list[tuple[float, float]], FloatArray]:
    """The spans of both ears along x, and the points (2, 3) where their screws pass through the saddle's face."""
    screw, radius = hardware.screw, position.radius_mm
    x = radius + wrist.ring_mm + position.boss_radius_mm
    end = x + max(position.boss_radius_mm, (screw.nut_flats_mm + NUT_FIT_MM) / 2.0 + 1.2 * hardware.printer.wall_mm)
    spans = [(-end, -radius - 0.5 * wrist.ring_mm), (radius + 0.5 * wrist.ring_mm, end)]
    # The holes are off-centre: their roofs are higher than their radius, and a wall must remain on both sides.
    y, z = float(position.band_mm.mean()) + EAR_OFFSET_MM, position.axis_z_mm + wrist.gap_mm / 2.0
    return spans, np.array([(-x, y, z), (x, y, z)])


def _foot_cuts(heads: FloatArray, grip_mm: float, hardware: Hardware) -> Iterator[Bore]:
    """Holes for the screws of the foot, whose heads (n, 3) rest in the saddle, and for the screwdriver."""
    screw = hardware.screw
    driver_radius = head_space_mm(hardware)
    for head in heads:
        yield Bore(head - OUTSIDE_MM * ABOVE, ABOVE, screw.clearance_hole_mm / 2.0, grip_mm + 1.0, UP)
        yield Bore(head, -ABOVE, driver_radius, 99.0, UP)


def _ear_cuts(
    ears: FloatArray, band_mm: FloatArray, clamp: Stack, hardware: Hardware
) -> Iterator[Frustum | Bore | Hexagon]:
    """The threads of the clamp's screws in the saddle's ears.

    An ear is too narrow for a closed pocket, so a channel through it holds the nut by two sides.
    """
    screw = hardware.screw
    half_flats = (screw.nut_flats_mm + NUT_FIT_MM) / 2.0
    for ear in ears:
        hole, *pocket = thread(ear, ABOVE, UP, clamp, clamp.wall_mm, screw)
        yield hole
        if pocket:
            top = ear[2] + clamp.wall_mm
            low = (ear[0] - half_flats, band_mm[0] - 1.0, top - screw.nut_height_mm - NUT_FIT_MM)
            yield box(low, (ear[0] + half_flats, band_mm[1] + 1.0, top + 1.0))
