"""The mount, which carries the mirror holder over the camera, and on its slide the camera's clip.

It is a profile in the y-z plane, extruded along x, and prints on its end; only its holes have overhangs. Two skins with
a truss of webs between them run from the foot up behind the camera, round the lower end of the holder, and along the
holder's back. The mount prints parallel to the bed's sides, rotated, or cut in two, with blocks for the joining pins.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import shapely
from shapely import LineString, Polygon, get_coordinates

from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount_openings import (
    cable_half_width_mm,
    driver_holes_top_mm,
    head_end_mm,
    leaves_unprintable_web_ends,
    openings,
)
from mirrorcam.cad.parts.mount_stiffness import HEAD_MM, mount_compliance
from mirrorcam.cad.parts.truss import (
    FOOT_DEPTH_MM,
    FOOT_X_MM,
    Foot,
    foot_line,
    foot_of,
    foot_plate_mm,
    inner_path,
    offset,
    truss,
    up_to_head,
    webs_between,
)
from mirrorcam.cad.plan.cuts import clearance_around_pin_mm
from mirrorcam.cad.plan.dimension import GENERAL_MM, Datum, Hole, Length, holes, length
from mirrorcam.cad.plan.fasteners import Bore, Hexagon, Stack, head_space_mm, stack_into
from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Hardware
from mirrorcam.cad.plan.prisms import overlap_mm, prism_along_x
from mirrorcam.cad.plan.seats import Frustum, keep_outs
from mirrorcam.cad.plan.stand import lean_deg
from mirrorcam.cad.plan.stiffness import Section, beam_compliance
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

# Margin to the edge of the bed.
BED_MARGIN_MM = 0.5
ROTATION_STEP_DEG = 5
# Candidate cuts, as fractions of the length of a segment of the profile, and the largest angle of a cut from square.
CUT_FRACTIONS = (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7, 0.25, 0.75, 0.2, 0.8, 0.15, 0.85)
MAX_OBLIQUE_DEG = 32.0
BLOCK_MM = 16.0
FAR_MM = 1e4


@dataclass(frozen=True)
class Placement:
    """The placement of a profile (y and z in the rig frame) on the bed, rotated by `rotation_deg` about its normal.

    If it fits only in two pieces, `cut_mm` is the cut's coordinate along the bed's y, `cut_points` (2, 2) the points
    where it crosses the profile's inner and outer side, and `direction` (2,) the profile's direction there; y and z.
    """

    rotation_deg: float
    cut_mm: float | None = None
    cut_points: FloatArray | None = None
    direction: FloatArray | None = None


def place_on_bed(inner: FloatArray, outer: FloatArray, hardware: Hardware) -> Placement | None:
    """Rotate a profile between two polylines (n, 2) by the smallest angle at which it fits, or cut its longest segment.

    Returns None if it fits neither rotated nor in two pieces.
    """
    bed = np.array(hardware.printer.bed_mm[:2])
    band = Polygon([*inner, *outer[::-1]]).buffer(BED_MARGIN_MM, join_style="mitre")
    for degrees in range(0, 180, ROTATION_STEP_DEG):
        if fits(band, float(degrees), bed):
            return Placement(float(degrees))
    lengths = np.linalg.norm(np.diff(inner, axis=0), axis=1)[1:-1]
    if len(lengths) == 0:
        return None
    piece = 1 + int(lengths.argmax())
    direction = (inner[piece + 1] - inner[piece]) / lengths.max()
    square_deg = 90.0 - float(np.degrees(np.arctan2(direction[1], direction[0])))
    candidates = [float(deg) for deg in range(-90, 91, ROTATION_STEP_DEG) if abs(deg - square_deg) <= MAX_OBLIQUE_DEG]
    # The smallest rotation first.
    for angle_deg in sorted(candidates, key=abs):
        for fraction in CUT_FRACTIONS:
            inner_point = inner[piece] + fraction * (inner[piece + 1] - inner[piece])
            cut = float((rotation_2d(angle_deg) @ inner_point)[1])
            if all(fits(half, angle_deg, bed) for half in halves(band, angle_deg, cut)):
                normal = np.array([-direction[1], direction[0]])
                depth = float((outer[piece] - inner[piece]) @ normal)
                outer_point = inner_point + depth * (normal - np.tan(np.deg2rad(angle_deg - square_deg)) * direction)
                cut_points = np.array([inner_point, outer_point])
                # Blocks must not extend past the bends of the skins.
                starts = (cut_points - [inner[piece], outer[piece]]) @ direction
                ends = ([inner[piece + 1], outer[piece + 1]] - cut_points) @ direction
                if min(*starts, *ends) >= _block_mm(cut_points, direction, hardware)[1]:
                    return Placement(angle_deg, cut, cut_points, direction)
    return None


def rotation_2d(degrees: float) -> FloatArray:
    """The rotation matrix (2, 2) by an angle."""
    angle = np.deg2rad(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def fits(area: Polygon, degrees: float, bed: FloatArray) -> bool:
    """Return whether an area, rotated by an angle, fits on the bed."""
    return bool((np.ptp(get_coordinates(area) @ rotation_2d(degrees).T, axis=0) <= bed).all())


def halves(area: Polygon, degrees: float, cut_mm: float) -> tuple[Polygon, Polygon]:
    """The halves of an area below and above a cut that is level when the area is rotated by an angle."""
    rotated = Polygon(get_coordinates(area.exterior) @ rotation_2d(degrees).T)
    parts = (shapely.box(-FAR_MM, -FAR_MM, FAR_MM, cut_mm), shapely.box(-FAR_MM, cut_mm, FAR_MM, FAR_MM))
    lower, upper = (get_coordinates(rotated.intersection(part).convex_hull) @ rotation_2d(degrees) for part in parts)
    return Polygon(lower), Polygon(upper)


def joint_blocks(placement: Placement, skin_mm: float, half_width_mm: float, hardware: Hardware) -> list[Frustum]:
    """Blocks on both skins at both ends of the width, with space for the pins of a cut; none without a cut.

    The blocks at the end that prints last are on slopes of 45 deg.
    """
    direction = placement.direction
    if placement.cut_points is None or direction is None:
        return []
    normal = np.array([-direction[1], direction[0]])
    thickness, half_length = _block_mm(placement.cut_points, direction, hardware)
    blocks = []
    for point, inwards in zip(placement.cut_points, (normal, -normal), strict=True):
        ends = np.array([point - half_length * direction, point + half_length * direction])
        profile = np.array([*ends, *(ends[::-1] + thickness * inwards)])
        root = np.array([*ends, *(ends[::-1] + 0.5 * skin_mm * inwards)])
        blocks.append(prism_along_x(profile, -half_width_mm, -half_width_mm + BLOCK_MM))
        blocks.append(prism_along_x(profile, half_width_mm - BLOCK_MM, half_width_mm))
        top, foot = half_width_mm - BLOCK_MM, half_width_mm - BLOCK_MM - thickness
        blocks.append(
            Frustum(
                np.column_stack([np.full(4, foot), root]),
                np.column_stack([np.full(4, top), profile]),
            )
        )
    return blocks


def _block_mm(cut_points: FloatArray, direction: FloatArray, hardware: Hardware) -> tuple[float, float]:
    """Thickness of a block, and its extent along its skin on either side of the cut through two points (2, 2)."""
    normal, span = np.array([-direction[1], direction[0]]), cut_points[1] - cut_points[0]
    tangent = float(np.abs(span @ direction) / np.abs(span @ normal))
    # 1 mm of margin, which includes the clearance of a pin's hole.
    half_length = hardware.holder.pin_mm[1] / 2.0 + hardware.printer.wall_mm + 1.0
    thickness = 2.0 * clearance_around_pin_mm(hardware) + 1.0 + 2.0 * half_length * tangent
    return thickness, half_length + thickness * tangent


# Angle of the webs to the skins: less plastic than at 45 deg, and stiff enough.
WEB_DEG = 36.0
GRAVITY_N_PER_KG = 9.80665
GLASS_G_PER_CM3 = 2.5
# Mass of a carrier's screw with head, insert and spring, over the mass of its shank.
SCREW_RATIO, STEEL_G_PER_CM3 = 2.0, 7.85
# Largest mass of a holder over its estimate: of the estimate itself, or with infill of 20 %.
PLASTIC_MARGIN = 1.2
# Steps of the candidate widths and depths, and candidate factors of the thicknesses.
WIDTH_STEP_MM, DEPTH_STEP_MM = 2.0, 0.5
# Skins and webs that are this much thinner are also stiff enough: walls of two lines are hardly more accurate.
THINNER_MM = 0.02
THICKNESS_FACTORS = (1.0, 1.5, 2.0)
# Number of candidate heights of the bend; a mount with a higher bend leans further back.
BEND_HEIGHTS = 4


@dataclass(frozen=True)
class MountPlan:
    """A mount in the rig frame, mm: convex pieces, cuts, and its interfaces to the other parts.

    `rig_from_head` (4, 4) is the frame of the face on the holder's back (z out of the mount, into the holder), with the
    screws at `holes_in_head_mm` (4, 2) and their stack `head`. An adapter is screwed to `foot`, whose face has its
    front and rear edges at `foot_corners` (2, 2; y and z); `slide` (3,) is the centre of the clip's travel. `tilt_deg`
    and `shift_um` are the rotation and displacement of the mirrors due to the weight of `load_g` at `load_at` (3,) in
    the worst direction. `path` (n, 2; y and z) is the centre line of the truss, and `walls` are the thicknesses of its
    skins and webs.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    light: tuple[Frustum, ...]
    rig_from_head: FloatArray
    holes_in_head_mm: FloatArray
    head: Stack
    foot: Foot
    foot_corners: FloatArray
    slide: FloatArray
    path: FloatArray
    section: Section
    load_g: float
    load_at: FloatArray
    tilt_deg: float
    shift_um: float
    bed_turn_deg: float
    bed_cuts_mm: tuple[float, ...]
    walls: tuple[Length, ...]

    @property
    def half_width_mm(self) -> float:
        return self.section.width_mm / 2.0

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The holes, and the positions of the screws on the oblique faces of the head and of a leaning foot.

        The screws are dimensioned from the foot's corner at the slide along both axes of the bed, which are also the
        axes of the drawing's view; the head's screws are dimensioned from row to row.
        """
        rows = transform(self.rig_from_head, np.column_stack([self.holes_in_head_mm, np.zeros(4)]))[[1, 2]]
        corner = np.array([rows[0, 0], *self.foot_corners[0]])
        edge = np.array([-self.half_width_mm, *corner[1:]])
        axes = [np.array([0.0, *axis]) for axis in rotation_2d(self.bed_turn_deg)]
        ends = (*self.foot.screws_in_rig[:2, 1:], self.foot_corners[1])
        on_foot = [length(edge, np.array([edge[0], *end]), direction=axis) for end in ends for axis in axes]
        return (
            *(replace(hole, datum=Datum(edge, "the foot's edge at the slide")) for hole in holes(self.cuts)),
            *(length(corner, row, direction=axis) for row in rows for axis in axes),
            *(dimension for dimension in on_foot if np.linalg.norm(dimension.span_in_rig) > 1e-6),
            length(rows[0], rows[1], "head screws"),
            *self.walls,
        )


@dataclass(frozen=True)
class Profile:
    """A truss between an `inner` and an `outer` line (n, 2; y and z); `path` is its centre line up to the head."""

    section: Section
    foot: Foot
    inner: FloatArray
    outer: FloatArray
    path: FloatArray
    volume_mm3: float


def plan_mount(layout: Layout, holder: HolderPlan, clip: ClipPlan, hardware: Hardware) -> MountPlan:
    """Plan the lightest mount that is stiff enough; raises InputError with the dimension if there is none."""
    load_g, load_at = _load(layout, holder, hardware)
    profile, placement = _lightest(holder, clip, load_g, load_at, lean_deg(layout, hardware), hardware)
    section, half_width = profile.section, profile.section.width_mm / 2.0
    tilt_deg, shift_um = bending(profile, holder, clip, load_g, load_at, hardware)
    grip = hardware.mount.grip_mm
    pieces, webs = truss(profile.inner, profile.outer, section, hardware)
    pieces += [_rib(clip), _slide_skin(clip, profile, half_width), *_head_skin(profile, holder, hardware)]
    webs += joint_blocks(placement, section.skin_mm, half_width, hardware)
    light = tuple(
        volume
        for volumes in keep_outs(layout, hardware)
        for volume in volumes
        if any(overlap_mm(piece, volume) > 0.0 for piece in pieces)
    )
    return MountPlan(
        pieces=(*pieces, *webs),
        cuts=openings(holder, clip, profile.foot, section, hardware),
        light=light,
        rig_from_head=holder.rig_from_mount @ np.diag([1.0, -1.0, -1.0, 1.0]),
        holes_in_head_mm=holder.holes_in_mount_mm * [1.0, -1.0],
        head=stack_into(grip, holder.thread_mm, holder.hole_depth_mm, holder.hole_depth_mm, hardware.screw),
        foot=profile.foot,
        foot_corners=np.array([profile.inner[0], profile.outer[0]]),
        slide=clip.slide_centre,
        path=profile.path,
        section=section,
        load_g=load_g,
        load_at=load_at,
        tilt_deg=tilt_deg,
        shift_um=shift_um,
        bed_turn_deg=placement.rotation_deg,
        bed_cuts_mm=() if placement.cut_mm is None else (placement.cut_mm,),
        walls=_walls(profile, holder, clip, load_g, load_at, hardware),
    )


def _walls(
    profile: Profile, holder: HolderPlan, clip: ClipPlan, load_g: float, load_at: FloatArray, hardware: Hardware
) -> tuple[Length, ...]:
    """Thicknesses of a skin, of a web, and of the skin round the clip's screws.

    Skins and webs may be thinner together until the mirrors tilt as far as they may. The tilt is convex in the
    deviation, so interpolation to the general tolerance is on the safe side.
    """
    section, limit = profile.section, hardware.mount.tilt_deg
    tilt, thin_tilt = (
        bending(thinned(profile, mm), holder, clip, load_g, load_at, hardware)[0] for mm in (THINNER_MM, GENERAL_MM)
    )
    range_mm = GENERAL_MM - THINNER_MM
    minus = THINNER_MM + float(np.floor(100.0 * range_mm * min((limit - tilt) / (thin_tilt - tilt), 1.0))) / 100.0

    def wall(line: FloatArray, thickness: float, text: str, start: float) -> Length:
        """The thickness at the middle of a line (2, 2; y and z), from `start` on its left."""
        along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
        left = np.array([0.0, -along[1], along[0]])
        point = np.array([-section.width_mm / 2.0, *line.mean(axis=0)]) + start * left
        return length(point, point + thickness * left, text)

    webs = webs_between(profile.inner, profile.outer, section, hardware).webs
    web = webs[int(np.argmax(np.linalg.norm(webs[:, 1] - webs[:, 0], axis=1)))]
    return (
        replace(wall(profile.outer[-2:][::-1], section.skin_mm, "skins", 0.0), minus_mm=minus),
        replace(wall(web, section.web_mm, "webs", -section.web_mm / 2.0), minus_mm=minus),
        wall(profile.inner[:2], clip.slide.grip_mm, "slide", 0.0),
    )


def thinned(profile: Profile, mm: float) -> Profile:
    """The same profile with skins and webs that are thinner."""
    section = profile.section
    return replace(profile, section=replace(section, skin_mm=section.skin_mm - mm, web_mm=section.web_mm - mm))


def _lightest(
    holder: HolderPlan, clip: ClipPlan, load_g: float, load_at: FloatArray, lean: float, hardware: Hardware
) -> tuple[Profile, Placement]:
    """The lightest profile that is stiff enough and fits the bed; raises InputError if there is none."""
    limit = hardware.mount.tilt_deg
    candidates = sorted(profiles(holder, clip, lean, hardware), key=lambda profile: profile.volume_mm3)

    @cache
    def is_stiff(number: int) -> bool:
        # The beam has no openings and is stiffer: if it tilts too far, so do the plates.
        thin = thinned(candidates[number], THINNER_MM)
        return (
            beam_tilt_deg(candidates[number], load_g, load_at) <= limit
            and bending(thin, holder, clip, load_g, load_at, hardware)[0] <= limit
        )

    # Of one depth and thickness, wider mounts are stiffer: if the narrowest is not stiff enough, bisection is faster.
    by_section: dict[tuple[float, float], list[int]] = {}
    for number, profile in enumerate(candidates):
        by_section.setdefault((profile.section.skin_mm, profile.section.depth_mm), []).append(number)
    for numbers in by_section.values():
        numbers.sort(key=lambda number: candidates[number].section.width_mm)

    @cache
    def first_stiff(section: tuple[float, float]) -> int:
        """The place of the narrowest stiff mount among those of a section; their number if none is."""
        numbers = by_section[section]
        return bisect_left(numbers, True, key=is_stiff) if is_stiff(numbers[-1]) else len(numbers)

    stiff: Profile | None = None
    for number, profile in enumerate(candidates):
        section = profile.section.skin_mm, profile.section.depth_mm
        place = by_section[section].index(number)
        if not (is_stiff(number) if place == 0 else place >= first_stiff(section)):
            continue
        if not prints(profile, holder, hardware):
            continue
        placement = place_on_bed(profile.inner, profile.outer, hardware)
        if placement is not None:
            return profile, placement
        stiff = stiff or profile
    if stiff is None:
        printable = [profile for profile in candidates if prints(profile, holder, hardware)]
        if not printable:
            raise InputError("mirror holder is too low over the camera's clip for the mount's bend, but must be higher")
        stiffest = min(printable, key=lambda profile: beam_tilt_deg(profile, load_g, load_at))
        tilt = bending(stiffest, holder, clip, load_g, load_at, hardware)[0]
        raise InputError(
            f"mirrors tilt by {tilt:.3f} deg under their holder's {load_g:.0f} g on the stiffest mount, "
            f"{stiffest.section.width_mm:.0f} mm wide and {stiffest.section.depth_mm:g} mm deep, "
            f"expected at most {limit:g} deg"
        )
    depth, height = np.ptp(np.vstack([stiff.inner, stiff.outer]), axis=0)
    width, length, _ = hardware.printer.bed_mm
    raise InputError(
        f"mount is {depth:.0f} x {height:.0f} mm in profile to be stiff enough, "
        f"but must fit the printer's bed of {width:g} x {length:g} mm in at most two pieces"
    )


def profiles(holder: HolderPlan, clip: ClipPlan, lean: float, hardware: Hardware) -> Iterator[Profile]:
    """The profiles of all candidate widths, thicknesses and depths of a mount that leans back by `lean` deg."""
    mount, screw = hardware.mount, hardware.screw
    head_margin = head_space_mm(hardware) + screw.insert_wall_mm
    # The holder may be off the camera's centre.
    screws = head_screws(holder)
    min_half = max(float(np.abs(screws[:, 0]).max()), clip.slide_x_mm, FOOT_X_MM) + head_margin
    min_half = max(min_half, cable_half_width_mm(hardware))
    max_half = min(max(min_half, holder.size_mm[0] / 2.0), hardware.printer.bed_mm[2] / 2.0)
    path = cache(partial(inner_path, holder, clip, hardware=hardware))
    for half_width in np.arange(min_half, max_half + 0.1, WIDTH_STEP_MM).tolist():
        for factor in THICKNESS_FACTORS:
            skin, web = factor * mount.skin_mm, factor * mount.web_mm
            end = head_end_mm(holder, half_width, web, hardware)
            line_from = partial(path, head_end_mm=end)
            for depth in np.arange(FOOT_DEPTH_MM, mount.deepest_mm + 0.1, DEPTH_STEP_MM).tolist():
                lines = _lines(line_from, clip, depth, lean, hardware)
                if lines is None:
                    continue
                inner, outer = lines
                foot = foot_of(np.array([inner[0], outer[0]]), half_width, hardware)
                if foot is None:
                    continue
                section = Section(depth, 2.0 * half_width, skin, web, WEB_DEG, hardware.printer.plastic_mpa)
                centre_line = (inner + outer) / 2.0
                plate = PRINT_SETTINGS.plastic_mm(foot_plate_mm(depth, hardware), hardware.printer.wall_mm)
                foot_mm3 = depth * plate / np.cos(np.deg2rad(lean)) * section.width_mm
                # The webs across the truss at the foot and at both ends of every straight piece.
                across_mm3 = len(inner) * depth * section.web_mm * section.width_mm
                volume = LineString(centre_line).length * section.plastic_mm2 + across_mm3 + foot_mm3
                yield Profile(section, foot, inner, outer, up_to_head(centre_line, holder), volume)


def prints(profile: Profile, holder: HolderPlan, hardware: Hardware) -> bool:
    """Return whether the webs of a profile print where the holes for screwdrivers cut them."""
    webs = webs_between(profile.inner, profile.outer, profile.section, hardware)
    return not leaves_unprintable_web_ends(holder, webs, profile.section, hardware)


def _lines(
    line_from: Callable[[float], FloatArray | None], clip: ClipPlan, depth: float, lean: float, hardware: Hardware
) -> tuple[FloatArray, FloatArray] | None:
    """The inner and the outer line (n, 2; y and z) of a mount of a given depth; None if it is too deep.

    `line_from` returns the inner line for a z of the slide's top in the rig frame, as `inner_path` does.

    The lines bend above the slide, higher in a deep mount: the web from corner to corner is almost parallel to the
    screwdriver holes below it, and would end in a thin edge at one of them.
    """
    slide_top = clip.top_mm + clip.travel_mm + 2.0
    front, back = foot_line(clip, depth, lean, hardware)
    min_bend_z = driver_holes_top_mm(clip, hardware) + max(THICKNESS_FACTORS) * hardware.mount.web_mm / 2.0
    for bends in range(BEND_HEIGHTS):
        chain = line_from(slide_top)
        if chain is None and bends == 0:
            raise InputError("mirror holder's back faces the camera's clip, but must face away from it for the mount")
        if chain is None:
            return None
        inner = np.vstack([front, chain])
        outer = offset(inner, depth)
        outer[0] = back
        if outer[1, 1] >= min_bend_z:
            return inner, outer
        slide_top += min_bend_z - float(outer[1, 1]) + 0.1
    return None


def head_screws(holder: HolderPlan) -> FloatArray:
    """Intersections (4, 3) of the head's screws with the holder's back, in the rig frame."""
    return transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))


def beam_tilt_deg(profile: Profile, load_g: float, load_at: FloatArray) -> float:
    """Largest rotation of the mirrors under their weight, with the profile as a sandwich beam without openings."""
    rotation, _ = beam_compliance(profile.path, load_at, profile.section)
    return float(np.degrees(np.linalg.norm(rotation, ord=2))) * load_g / 1000.0 * GRAVITY_N_PER_KG


def bending(
    profile: Profile, holder: HolderPlan, clip: ClipPlan, load_g: float, load_at: FloatArray, hardware: Hardware
) -> tuple[float, float]:
    """Largest rotation in deg and shift in um of the mirrors under their weight, over all directions of gravity."""
    cuts = openings(holder, clip, profile.foot, profile.section, hardware)
    inner, outer, section = profile.inner, profile.outer, profile.section
    compliance = mount_compliance(inner, outer, section, profile.foot, head_screws(holder), cuts, load_at, hardware)[
        :, :3
    ]
    weight_n = load_g / 1000.0 * GRAVITY_N_PER_KG
    return (
        float(np.degrees(np.linalg.norm(compliance[3:], ord=2))) * weight_n,
        1000.0 * float(np.linalg.norm(compliance[:3], ord=2)) * weight_n,
    )


def _load(layout: Layout, holder: HolderPlan, hardware: Hardware) -> tuple[float, FloatArray]:
    """Mass in g, and centre (3,), of the mirrors and the holder as printed; an upper bound."""
    glass = sum(Polygon(m.outline_in_plane_mm).area * m.thickness_mm for m in layout.mirrors)
    plastic = PLASTIC_MARGIN * hardware.printer.plastic_g_per_cm3 * holder.printed_mm3
    screws = SCREW_RATIO * STEEL_G_PER_CM3 * holder.screws_mm3
    mass = (plastic + GLASS_G_PER_CM3 * glass + screws) / 1000.0
    return mass, np.asarray(holder.corners_in_rig.mean(axis=0))


def _rib(clip: ClipPlan) -> Frustum:
    """The V rib that guides the clip over its full travel."""
    height, root = clip.rib_mm, 1.0
    y, low = clip.slide_y_mm, clip.bottom_mm - clip.travel_mm
    corners = np.array([(-height - root, y - root, low), (height + root, y - root, low), (0.0, y + height, low)])
    return Frustum(corners, corners + (clip.top_mm + clip.travel_mm - low) * ABOVE)


def _head_skin(profile: Profile, holder: HolderPlan, hardware: Hardware) -> list[Frustum]:
    """The thicker parts of the skin on the holder's back, round both rows of the holder's screws."""
    start, end = profile.inner[-2:]
    along = (end - start) / np.linalg.norm(end - start)
    depth = hardware.mount.grip_mm * np.array([-along[1], along[0]])
    half_width = profile.section.width_mm / 2.0
    length = float((end - start) @ along)
    pieces, reach = [], HEAD_MM[hardware.holder.mirrors]
    for row in head_screws(holder)[[0, 2], 1:]:
        position = float((row - start) @ along)
        ends = np.array([start + np.clip(position + side * reach, 0.0, length) * along for side in (-1.0, 1.0)])
        pieces.append(prism_along_x(np.vstack([ends, ends[::-1] + depth]), -half_width, half_width))
    return pieces


def _slide_skin(clip: ClipPlan, profile: Profile, half_width: float) -> Frustum:
    """The thicker part of the skin, from the foot's face to the bend above the slide.

    Wherever the skin beside the slide is thin, the camera pitches under its own weight.
    """
    front, bend = profile.inner[:2]
    share = clip.slide.grip_mm / profile.section.depth_mm
    low, high = (
        line[0] + share * (line[1] - line[0]) for line in ((front, profile.outer[0]), (bend, profile.outer[1]))
    )
    return prism_along_x(np.array([front, low, high, bend]), -half_width, half_width)
