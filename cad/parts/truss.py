"""The mount's profile in the y-z plane: a path around the ray cones, a truss of skins and webs along it, and its foot.

An adapter's screws enter the foot.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely import LineString, MultiPoint, Point, Polygon, get_coordinates
from shapely.geometry.polygon import orient
from shapely.ops import substring

from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, Stack, head_space_mm, stack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import prism_along_x
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stand import rig_from_stand
from mirrorcam.cad.plan.stiffness import Section
from mirrorcam.cad.plan.threads import SUNK_HEAD, thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

# The adapter's screws in the mount's foot: +-x, distance of the front ones behind its front, and from these to the rear
# ones, at least. In a clamp, these distances leave walls around the self-supporting roofs of the holes for the screws'
# heads.
FOOT_X_MM, FOOT_FRONT_MM, FOOT_ROWS_MM = 17.0, 4.5, 9.5
FOOT_DEPTH_MM = 20.0
# Height above its foot's plate at which a nut leaves it, relative to its thickness.
NUT_RISE = 1.25
# Widening of the hole for a countersunk head in an adapter (backs/blocks.py).
WIDER_MM = 0.7
# The foot's plate transmits the full moment of the mirrors from the outer skin to the screws near the inner one. At
# this ratio of the mount's depth to the plate's thickness, the plate bends less than the truss above it.
DEPTH_TO_PLATE_RATIO = 3.0


@dataclass(frozen=True)
class Foot:
    """The mount's foot in the stand frame, mm: its lower face is level, and an adapter is under it.

    `screws` (4, 3) are the points where the adapter's screws enter that face. The face between `front_y_mm` and
    `back_y_mm` has material above it as far as the screws reach; in a mount that leans back the front edge of the face,
    at `edge_y_mm`, is further forward. `rig_from_stand` (3, 3) rotates to the rig frame.
    """

    rig_from_stand: FloatArray
    screws: FloatArray
    edge_y_mm: float
    front_y_mm: float
    back_y_mm: float
    half_width_mm: float

    @property
    def z_mm(self) -> float:
        """Height of the lower face."""
        return float(self.screws[0, 2])

    @property
    def screws_in_rig(self) -> FloatArray:
        """The points (4, 3) where the screws enter the face, in the rig frame."""
        return np.asarray(self.screws @ self.rig_from_stand.T)

    @property
    def up_in_rig(self) -> FloatArray:
        """The normal (3,) of the face, into the mount."""
        return np.asarray(self.rig_from_stand[:, 2])


def foot_line(clip: ClipPlan, depth_mm: float, lean: float, hardware: Hardware) -> FloatArray:
    """The front and rear ends (2, 2; y and z in the rig frame) of the foot's lower face, for a mount of given depth.

    The face is level in a device that leans back by `lean` deg. Above it are the foot's plate and the cable's window,
    below the clip's lowest position at the front, and below the screwdriver holes for the clip's screws at the rear.
    """
    slope, cosine = float(np.tan(np.deg2rad(lean))), float(np.cos(np.deg2rad(lean)))
    above = (foot_plate_mm(depth_mm, hardware) + hardware.mount.cable_window_mm[1]) / cosine
    front_z = clip.bottom_mm - clip.travel_mm - 1.0 - above
    drivers_z = min(clip.slide_z_mm) - clip.travel_mm - head_space_mm(hardware)
    front_z = min(front_z, drivers_z - depth_mm * slope - above)
    return np.array([(clip.slide_y_mm, front_z), (clip.slide_y_mm - depth_mm, front_z + depth_mm * slope)])


def lean_of(line: FloatArray) -> float:
    """The lean in deg of a mount whose foot's lower face has the ends (2, 2; y and z in the rig frame)."""
    along_y, along_z = line[1] - line[0]
    return float(np.degrees(np.arctan2(along_z, -along_y)))


def foot_of(line: FloatArray, half_width_mm: float, hardware: Hardware) -> Foot | None:
    """The foot of a mount with the ends (2, 2; y and z in the rig frame) of its lower face; None if it is too short.

    The screws keep their distance from the front skin up to the top of the foot's plate.
    """
    lean = lean_of(line)
    rotation = rig_from_stand(lean)
    (edge, z), (back, _) = line @ rotation[1:, 1:]
    slope, depth = float(np.tan(np.deg2rad(lean))), float(line[0, 0] - line[1, 0])
    front = edge - foot_plate_mm(depth, hardware) * max(slope, 0.0)
    screws_mm = FOOT_FRONT_MM
    if (screw := hardware.screw).kind == "nut":
        # Nuts get into the foot from the side, above its plate and behind the skin that carries the slide.
        skin_mm = hardware.mount.slide_skin_mm * float(np.hypot(1.0, slope)) + NUT_RISE * screw.nut_height_mm * max(
            slope, 0.0
        )
        screws_mm = max(screws_mm, skin_mm + screw.nut_flats_mm / 2.0 + NUT_FIT_MM)
    # A wall remains between the countersunk heads of the adapter's screws.
    head = SUNK_HEAD * thread_of(hardware.screw.thread).diameter_mm + WIDER_MM
    rows = max(FOOT_ROWS_MM, head + hardware.printer.wall_mm)
    if front - back < FOOT_DEPTH_MM - FOOT_ROWS_MM - FOOT_FRONT_MM + screws_mm + rows - 1e-9:
        return None
    screws = np.array([(x, front - screws_mm - y, z) for x in (-FOOT_X_MM, FOOT_X_MM) for y in (0.0, rows)])
    return Foot(rotation, screws, float(edge), float(front), float(back), half_width_mm)


def foot_plate_mm(depth_mm: float, hardware: Hardware) -> float:
    """Thickness of the foot's plate, normal to it, which holds the adapter's screws, in a mount of given depth."""
    return max(foot_stack(hardware).wall_mm, depth_mm / DEPTH_TO_PLATE_RATIO)


def foot_stack(hardware: Hardware) -> Stack:
    """The screws of the adapter into the threads of the mount's foot; raises InputError if none on the list engages."""
    return stack(hardware.back.grip_mm, hardware)


def inner_path(
    holder: HolderPlan,
    clip: ClipPlan,
    slide_top_mm: float,
    head_end_mm: float,
    hardware: Hardware,
) -> FloatArray | None:
    """The inner line (n, 2) in y and z: from the slide's top, tight round the holder, and up along the holder's back.

    `slide_top_mm` is z of the slide's top in the rig frame, `head_end_mm` the line's end, measured up along the back
    from the rig's origin. The line follows the convex hull of holder and pupil, which contains all camera cones.
    Returns None if the top of the slide or the holder's back lies inside that hull.
    """
    normal, origin = holder.rig_from_mount[:3, 2], holder.rig_from_mount[:3, 3]
    if abs(normal[0]) > 1e-9:
        raise InputError("the mirrors face to the side, expected a fold about the rig's x for the mount")
    outward, back_level = normal[1:], float(normal @ origin)
    up = np.array([outward[1], -outward[0]])
    corners = holder.corners_in_rig[:, 1:]
    far = 10.0 * np.abs(corners).max()
    half_plane = Polygon(
        [
            back_level * outward + far * up,
            back_level * outward - far * up,
            back_level * outward - far * up - far * outward,
            back_level * outward + far * up - far * outward,
        ]
    )
    obstacle = (
        MultiPoint(corners).convex_hull.buffer(hardware.mount.clearance_mm, join_style="mitre").intersection(half_plane)
    )
    head_end = back_level * outward + head_end_mm * up
    y = clip.slide_y_mm
    hull = MultiPoint([*get_coordinates(obstacle), (y, slide_top_mm), (0.0, 0.0), head_end]).convex_hull
    # Clockwise from the slide (y right, z up), the boundary runs up behind the camera.
    loop = get_coordinates(orient(hull))[-2::-1]
    distances = np.abs(loop - [y, slide_top_mm]).sum(axis=1)
    loop = np.roll(loop, -int(distances.argmin()), axis=0)
    on_back = np.flatnonzero(np.abs(loop @ outward - back_level) < 1e-6)
    if distances.min() > 1e-9 or len(on_back) < 2:
        return None
    return get_coordinates(LineString(np.vstack([loop[: on_back[0] + 1], head_end])).simplify(0.2))


def up_to_head(path: FloatArray, holder: HolderPlan) -> FloatArray:
    """The path up to halfway between the head's two rows of screws, which share the load."""
    line = LineString(path)
    end = line.project(Point(holder.rig_from_mount[1:3, 3]))
    return get_coordinates(substring(line, 0.0, end))


def offset(inner: FloatArray, depth: float) -> FloatArray:
    """A polyline (n, 2) offset to its left by a depth, with mitred corners."""
    directions = np.diff(inner, axis=0) / np.linalg.norm(np.diff(inner, axis=0), axis=1)[:, None]
    left_normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    corners = [inner[0] + depth * left_normals[0]]
    for point, previous, following in zip(inner[1:-1], left_normals[:-1], left_normals[1:], strict=True):
        corners.append(point + depth * (previous + following) / (1.0 + previous @ following))
    return np.array([*corners, inner[-1] + depth * left_normals[-1]])


@dataclass(frozen=True)
class Webs:
    """The centre lines (n, 2; y and z) of both skins, and the `webs` (m, 2, 2) between them.

    The skins' lines start at the first web, above the cable's window, and end at the last. Each web runs from skin to
    skin.
    """

    inner: FloatArray
    outer: FloatArray
    webs: FloatArray


def webs_between(inner: FloatArray, outer: FloatArray, section: Section, hardware: Hardware) -> Webs:
    """Lay out the webs between an inner and an outer line (n, 2; y and z)."""
    depth, web_mm = section.depth_mm, section.web_mm
    half_skin = section.skin_mm / depth / 2.0
    inside, outside = inner + half_skin * (outer - inner), outer + half_skin * (inner - outer)
    # No web crosses the cable's window, above the foot's plate; the first is parallel to the plate.
    first_web_z = foot_plate_mm(depth, hardware) + hardware.mount.cable_window_mm[1] + web_mm / 2.0
    first_web_z /= np.cos(np.deg2rad(lean_of(np.array([inner[0], outer[0]]))))
    inside[0], outside[0] = inside[0] + [0.0, first_web_z], outside[0] + [0.0, first_web_z]
    webs = [(inside[0], outside[0])]
    # The last web ends flush with the skins.
    half_web = (inner[-1] - inner[-2]) / np.linalg.norm(inner[-1] - inner[-2]) * web_mm / 2.0
    inside[-1], outside[-1] = inside[-1] - half_web, outside[-1] - half_web
    for (a, b), (c, d) in zip(pairwise(inside), pairwise(outside), strict=True):
        panel = depth / np.tan(np.deg2rad(section.web_deg))
        count = max(1, round(float(np.linalg.norm((b + d) - (a + c)) / 2.0 / panel)))
        for i in range(count):
            start, end = i / count, (i + 1) / count
            diagonals = ((a + start * (b - a), c + end * (d - c)), (c + start * (d - c), a + end * (b - a)))
            webs.append(diagonals[i % 2])
        webs.append((b, d))
    return Webs(inside, outside, np.array(webs))


def truss(
    inner: FloatArray, outer: FloatArray, section: Section, hardware: Hardware
) -> tuple[list[Frustum], list[Frustum]]:
    """The skins with the foot's plate, and the webs between them."""
    depth, half_width = section.depth_mm, section.width_mm / 2.0
    skin = section.skin_mm / depth
    skins = []
    for (a, b), (c, d) in zip(pairwise(inner), pairwise(outer), strict=True):
        inner_skin = np.array([a, b, b + skin * (d - b), a + skin * (c - a)])
        outer_skin = np.array([c, d, d + skin * (b - d), c + skin * (a - c)])
        skins += [prism_along_x(profile, -half_width, half_width) for profile in (inner_skin, outer_skin)]
    lines = webs_between(inner, outer, section, hardware).webs
    webs = [_web(start, end, section.web_mm, half_width) for start, end in lines]
    line = np.array([inner[0], outer[0]])
    plate = np.array([0.0, foot_plate_mm(depth, hardware) / np.cos(np.deg2rad(lean_of(line)))])
    skins.append(prism_along_x(np.array([*line, *(line[::-1] + plate)]), -half_width, half_width))
    return skins, webs


def _web(start: FloatArray, end: FloatArray, thickness: float, half_width: float) -> Frustum:
    """A web from the middle of one skin to the middle of the other."""
    corners = get_coordinates(LineString([start, end]).buffer(thickness / 2.0, cap_style="flat"))[:-1]
    return prism_along_x(corners, -half_width, half_width)
