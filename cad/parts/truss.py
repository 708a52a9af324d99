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
from mirrorcam.cad.plan.fasteners import Stack, stack, stack_into
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import prism_along_x
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.stiffness import Section
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

# The adapter's screws in the mount's foot: +-x, and distances behind the slide's plane. In a clamp, these distances
# leave walls around the self-supporting roofs of the holes for the screws' heads.
FOOT_X_MM = 17.0
FOOT_Y_MM = (4.5, 14.0)
FOOT_DEPTH_MM = 20.0
# The threads in the foot are as deep as under a skin of this thickness.
FOOT_GRIP_MM = 1.6
# The foot's plate transmits the full moment of the mirrors from the outer skin to the screws near the inner one. At
# this ratio of the mount's depth to the plate's thickness, the plate bends less than the truss above it.
DEPTH_TO_PLATE_RATIO = 3.0


def foot_z_mm(clip: ClipPlan, depth_mm: float, hardware: Hardware) -> float:
    """z of the foot's lower face: below the clip's lowest position are the cable's window and the foot's plate."""
    plate = foot_plate_mm(depth_mm, hardware)
    return clip.bottom_mm - clip.travel_mm - 1.0 - hardware.mount.cable_window_mm[1] - plate


def foot_plate_mm(depth_mm: float, hardware: Hardware) -> float:
    """Thickness of the foot's plate, which holds the adapter's screws, in a mount of given depth."""
    return max(stack(FOOT_GRIP_MM, hardware).wall_mm, depth_mm / DEPTH_TO_PLATE_RATIO)


def foot_stack(grip_mm: float, hardware: Hardware) -> Stack:
    """The screws of an adapter with `grip_mm` of material under their heads, into the threads of the mount's foot.

    Their tips may protrude from the foot's plate into the hollow above it. Raises InputError if no screw on the list
    engages.
    """
    in_mount, screw = stack(FOOT_GRIP_MM, hardware), hardware.screw
    length = screw.insert_mm if screw.kind == "insert" else screw.nut_height_mm
    max_depth = screw.insert_depth_mm if screw.kind == "insert" else in_mount.wall_mm + 1.0
    return stack_into(grip_mm, (in_mount.begins_mm, in_mount.begins_mm + length), max_depth, in_mount.wall_mm, screw)


def foot_screws(clip: ClipPlan, depth_mm: float, hardware: Hardware) -> FloatArray:
    """Points (4, 3) in the rig frame where the adapter's screws enter the foot's lower face, for a mount's depth."""
    z = foot_z_mm(clip, depth_mm, hardware)
    return np.array([(x, clip.slide_y_mm - y, z) for x in (-FOOT_X_MM, FOOT_X_MM) for y in FOOT_Y_MM])


def inner_path(
    holder: HolderPlan,
    clip: ClipPlan,
    slide_top_mm: float,
    half_width_mm: float,
    head_end_mm: float,
    hardware: Hardware,
) -> FloatArray | None:
    """The inner line (n, 2) in y and z: from the slide's top, tight round the holder, and up along the holder's back.

    `slide_top_mm` is z of the slide's top in the rig frame, `head_end_mm` the line's end, measured up along the back
    from the rig's origin. The line follows the convex hull of holder and pupil, which contains all camera cones.
    Returns None if the top of the slide or the holder's back lies inside that hull.
    """
    normal, origin = holder.rig_from_mount[:3, 2], holder.rig_from_mount[:3, 3]
    if abs(normal[0]) > np.sin(np.deg2rad(5.0)):
        raise InputError(
            f"mirror holder's back is rotated {np.degrees(np.arcsin(abs(normal[0]))):.1f} deg to the side, "
            "expected at most 5 deg for the mount"
        )
    normal_yz = float(np.linalg.norm(normal[1:]))
    outward = normal[1:] / normal_yz
    # The plane of the back where it is nearest to the camera over the mount's width; the mount is cut off beyond it.
    back_level = float(normal @ origin) / normal_yz - abs(normal[0]) / normal_yz * half_width_mm
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
    # No web crosses the cable's window, above the foot's plate.
    first_web_z = foot_plate_mm(depth, hardware) + hardware.mount.cable_window_mm[1] + web_mm / 2.0
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
    y, z = inner[0]
    plate = foot_plate_mm(depth, hardware)
    foot = np.array([(y, z), (y - depth, z), (y - depth, z + plate), (y, z + plate)])
    skins.append(prism_along_x(foot, -half_width, half_width))
    return skins, webs


def _web(start: FloatArray, end: FloatArray, thickness: float, half_width: float) -> Frustum:
    """A web from the middle of one skin to the middle of the other."""
    corners = get_coordinates(LineString([start, end]).buffer(thickness / 2.0, cap_style="flat"))[:-1]
    return prism_along_x(corners, -half_width, half_width)
