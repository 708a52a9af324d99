"""The pictures of a device from its model: assembled, exploded, with its light, and one for each step of the guide.

The picture of the camera's step labels points, slots and screws of the clip, and the end that goes in first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.action_pictures import action_pictures
from mirrorcam.cad.guide.assembly_steps import Stages, home_of, joins_of
from mirrorcam.cad.guide.picture_views import (
    ARROW_RGB,
    GUIDE_RGB,
    MIRROR_LIFT_MM,
    STEP_RATIO,
    DevicePicture,
    Item,
    arrow_head,
    assembled,
    axes_towards,
    displaced,
    exit_path,
    exploded_items,
    in_place,
    inserted,
    lifted,
    mean,
    name_of,
    triangles_of,
    view_axes,
)
from mirrorcam.cad.guide.shading import ShadedBody
from mirrorcam.cad.parts.camera_box import Nest
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount_openings import longest_mark_mm
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

# Tilt of a camera on its path into a nest, with its first end near the V or the stop.
TILT_DEG = 14.0
# Directions to the viewer in the rig frame if the nest's first end is on the left; otherwise mirrored along x.
ABOVE_SCENE, BELOW_SCENE = (0.15, 0.45, 1.0), (-0.35, 1.0, -0.75)
FIRST_END = "this end goes in first"


def viewers(clip: ClipPlan) -> tuple[FloatArray, FloatArray]:
    """Directions (3,) in the rig frame towards the two viewers: above the lens, and behind the camera."""
    mirrored = np.array([first_side(clip.tray) if clip.tray else -1.0, 1.0, 1.0]) * (-1.0, 1.0, 1.0)
    return np.array(ABOVE_SCENE) * mirrored, np.array(BELOW_SCENE) * mirrored


def first_side(nest: Nest) -> float:
    """The sign of x of the end that goes in first: the end with the front's corner pad far from the mount."""
    return float(np.sign(nest.points[0, 0]))


def is_v(nest: Nest) -> bool:
    """Return whether the first end rests in a V, which is for round ends."""
    return bool(abs(nest.normals[4, 0]) > 0.1)


def notes_of(clip: ClipPlan) -> tuple[tuple[str, FloatArray], ...]:
    """The labels of a clip's picture with their points (3,) in the rig frame: body contacts, and slots of the ties."""
    left, right, z = clip.tie_mm
    inner_y = clip.slide_y_mm + clip.slide.wall_mm
    notes = [("slot of the cable tie", np.array([x, inner_y, z])) for x in (left, right)]
    notes += [("slot of a tie round the body", np.array([x, inner_y, z])) for *xs, z in clip.straps_mm for x in xs]
    if clip.nest is None:
        return tuple(notes)
    points = clip.nest.points
    if clip.tray is None:
        return (*notes, ("fence", points[3]), ("fence", points[4]), ("stop", points[5]))
    notes += [("front pad", point) for point in points[:3]]
    if is_v(clip.tray):
        return (*notes, ("V", points[3]), ("V", points[4]), ("side pad", points[5]))
    return (*notes, ("side pad", points[3]), ("side pad", points[4]), ("end pad", points[5]))


def screw_label(clip: ClipPlan, screw: Component) -> str:
    """The title of a camera's screw, with its position if it is sprung."""
    if clip.tray is None:
        return screw.title
    centre = np.asarray(screw.mesh.bounds).mean(axis=0)
    nearest = int(np.argmin([np.linalg.norm((own.head + own.tip) / 2.0 - centre) for own in clip.tray.screws]))
    return f"{('back', 'corner')[nearest]} screw, {screw.title.removesuffix(' screw')}"


def tilted(clip: ClipPlan, triangles: FloatArray) -> FloatArray:
    """The triangles (n, 3, 3) of a camera tilted about its first end on its path into a tray; others are unchanged."""
    if clip.tray is None:
        return triangles
    side = first_side(clip.tray)
    pivot = end_point(clip.tray, triangles)
    rotation = Rotation.from_euler("z", -side * TILT_DEG, degrees=True).as_matrix()
    return np.asarray((triangles - pivot) @ rotation.T + pivot)


def end_point(nest: Nest, triangles: FloatArray) -> FloatArray:
    """The centre (3,) of a camera's first end."""
    corners = triangles.reshape(-1, 3)
    corner = corners[np.argmax(first_side(nest) * corners[:, 0])]
    return np.array([corner[0], corners[:, 1].mean(), nest.points[3, 2]])


# Directions to the viewer (right, down, forward as the device stands): in the scene, facing the mirrors, or behind the
# device.
IN_FRONT = (0.95, 0.12, 1.0)
BELOW = (0.55, 0.75, 1.0)
BEHIND = (-0.80, -0.35, -1.0)
LEVEL = (1.0, -0.45, 0.45)
# Length of central rays beyond their mirrors, as a multiple of the distance of the central mirror.
RAY_LENGTH_RATIO = 1.1
BED_GAP_MM = 14.0
COUNT_CAPTION = "From behind; the number after a name is how many go into the part"
# Thickness of the bars that mark the reading edge of a scale.
BAR_MM = 1.4
# Downward component of the direction to the viewer of the mirrors, and height of a seat's label above the seat.
SEATS_FROM_BELOW, SEAT_NAME_MM = 0.3, 2.0
EDGE_TEXT = "This edge at the longest mark"
# Radius within which an opening for a tool is sought, and the distance of a screw behind it.
OPENING_MM, BEHIND_MM = 6.0, 4.0


NO_BODY = ShadedBody(np.zeros((0, 3, 3)), GUIDE_RGB)


def pictures_of(
    device: Device, parts: Sequence[BuiltPart], components: Sequence[Component]
) -> tuple[DevicePicture, ...]:
    """All pictures of a device, in the order of the page; pictures of steps have the steps' names."""
    layout = device.layout
    viewers = (IN_FRONT, LEVEL, BELOW, BEHIND)
    front, level, below, behind = (view_axes(device.level_from_rig, viewer) for viewer in viewers)
    labelled = tuple(in_place(component, name_of(component)) for component in components)
    unlabelled = tuple(in_place(component) for component in components)
    rays = tuple(central_ray(layout, index) for index in range(len(layout.mirrors)))
    exploded = exploded_items([(component, component.explode_mm) for component in components])
    stages = Stages(components)
    return (
        DevicePicture("assembled", "The device, assembled", front, labelled),
        DevicePicture("exploded", "Exploded view", front, exploded),
        DevicePicture("light", "The light: from the lens via every mirror to the scene", front, unlabelled, rays),
        DevicePicture("behind", "The device from behind", behind, unlabelled),
        DevicePicture("print", "The printed parts as they lie on the printer's bed", ISOMETRIC_AXES, _on_bed(parts)),
        _inserts(device, stages, behind, below),
        _mirrors(device, stages),
        DevicePicture("holder", "Mirror holder and mount", behind, _holder_on_mount(stages)),
        _camera(device, stages),
        DevicePicture("clip", "Clip and mount", level, _clip_on_mount(device, stages)),
        DevicePicture("adapter", "What carries the device", front, _adapter_on_mount(stages)),
        *action_pictures(device, stages),
    )


# The printer's bed from the front right, above: z is up.
ISOMETRIC_AXES = Rotation.from_euler("zx", (-28.0, -52.0), degrees=True).as_matrix()


def central_ray(layout: Layout, index: int) -> FloatArray:
    """The central ray (3, 3) of a mirror in the rig frame, mm: pupil, mirror centre, a point towards the scene."""
    mirror = layout.mirrors[index]
    centre = mirror.outline_in_rig_mm.mean(axis=0)
    direction = centre - mirror.virtual_centre_in_rig_mm
    length = RAY_LENGTH_RATIO * np.linalg.norm(layout.mirrors[layout.central_index].outline_in_rig_mm.mean(axis=0))
    return np.array([np.zeros(3), centre, centre + length * direction / np.linalg.norm(direction)])


def _inserts(device: Device, stages: Stages, behind: FloatArray, below: FloatArray) -> DevicePicture:
    """The parts from behind and from the front, with inserts and nuts, and separately the carriers."""
    title = "Where inserts and nuts go"
    carriers = stages.carriers
    items = _threads(stages, [part for part in stages.of_kind("part") if part not in carriers])
    third = None
    if carriers:
        moves = [np.diff(exit_path(thread), axis=0)[-1] for thread in stages.threads_in(carriers)]
        axes = axes_towards(device.level_from_rig, mean([move / np.linalg.norm(move) for move in moves]))
        third = DevicePicture(
            "inserts", title, axes, _threads(stages, carriers), caption="The mirror carriers", labels_on_bodies=True
        )
    front = DevicePicture("inserts", title, below, items, caption="The same parts from the front", lower=third)
    return DevicePicture("inserts", title, behind, items, caption=COUNT_CAPTION, lower=front)


def _threads(stages: Stages, candidates: Sequence[Component]) -> tuple[Item, ...]:
    """Exploded parts, with their inserts and nuts at the start of their insertion paths, and arrows."""
    parts = [part for part in candidates if stages.threads_in([part])]
    carriers = {component.name for component in stages.carriers}
    threads = stages.threads_in(parts)
    homes = [home_of(thread, joins_of(thread)[-1], parts) for thread in threads]
    counts = Counter(home.name for home in homes if home)
    items = [
        displaced(
            part,
            part.explode_mm,
            _label_with_count(part, part.name in carriers, counts[part.name]),
            pale=True,
        )
        for part in parts
    ]
    for thread, home in zip(threads, homes, strict=True):
        items += inserted(thread, home.explode_mm if home else np.zeros(3))
    return tuple(items)


def _label_with_count(part: Component, short: bool, count: int) -> str:
    """The name of a part, or its number if `short`, and the count of its inserts or nuts."""
    return f"{part.number if short else name_of(part)}: {count}"


def _mirrors(device: Device, stages: Stages) -> DevicePicture:
    """The mirrors in front of their seats, seen along their normals, and below in the same view the labelled seats."""
    title, layout = "Which mirror goes where", device.layout
    normal = mean([mirror.normal_in_rig for mirror in layout.mirrors])
    normal = normal / np.linalg.norm(normal)
    axes = axes_towards(device.level_from_rig, normal + SEATS_FROM_BELOW * device.level_from_rig[1])
    holder = tuple(in_place(component, pale=True) for component in stages.holder)
    fasteners = [
        displaced(component, component.explode_mm - mean([p.explode_mm for p in stages.holder]))
        for component in stages.carrier_screws
    ]
    lifted_mirrors = [lifted(component, stages.holder, normal) for component in (*stages.mirrors, *stages.carriers)]
    lines = [
        Item(NO_BODY, "", np.array([corner, corner + MIRROR_LIFT_MM * normal]))
        for mirror in layout.mirrors
        for corner in mirror.outline_in_rig_mm
    ]
    seat_labels = tuple(
        (f"seat {name}", mirror.outline_in_rig_mm.mean(axis=0) + SEAT_NAME_MM * mirror.normal_in_rig)
        for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)
    )
    seats = DevicePicture(
        "mirrors",
        title,
        axes,
        holder,
        notes=seat_labels,
        labels_on_bodies=True,
        caption="The seats without the mirrors, from the same side",
    )
    caption = "Seen from the scene: each mirror in front of its seat"
    return DevicePicture(
        "mirrors",
        title,
        axes,
        (*holder, *lifted_mirrors, *fasteners, *lines),
        caption=caption,
        labels_on_bodies=True,
        lower=seats,
    )


def _holder_on_mount(stages: Stages) -> tuple[Item, ...]:
    """The mount behind the holder, and the screws behind the openings in the mount's back that their heads pass."""
    existing = [*stages.holder, *stages.carriers, *stages.mirrors, *stages.threads_in(stages.holder)]
    apart = STEP_RATIO * (
        mean([component.explode_mm for component in stages.mount]) - mean([p.explode_mm for p in stages.holder])
    )
    screws = [displaced(screw, apart + way_out_mm(screw, stages.mount), seat=apart) for screw in stages.holder_screws]
    return (*assembled(existing, stages.mount, [], stages.holder), *screws)


def way_out_mm(screw: Component, parts: Sequence[Component]) -> FloatArray:
    """The displacement (3,) of a screw or washer along its axis to `BEHIND_MM` behind the openings of its tool."""
    assert screw.item is not None
    frame, length = screw.item.rig_from_item, screw.item.length_mm
    offsets = np.vstack([part.mesh.vertices for part in parts]) - frame[:3, 3]
    along = offsets @ frame[:3, 2]
    across = np.linalg.norm(offsets - along[:, None] * frame[:3, 2], axis=1)
    return np.asarray((along[across < OPENING_MM].max(initial=0.0) + length + BEHIND_MM) * frame[:3, 2])


def _camera(device: Device, stages: Stages) -> DevicePicture:
    """The camera in front of its clip, from above the lens and from behind, with labels for the guide."""
    clip = device.clip
    existing = [*stages.clip, *stages.threads_in(stages.clip)]
    items = assembled(existing, [], stages.camera_screws, stages.clip)
    screws = zip(items[len(existing) :], stages.camera_screws, strict=True)
    clip_items = (*items[: len(existing)], *(replace(item, label=screw_label(clip, screw)) for item, screw in screws))
    shift = STEP_RATIO * (stages.camera[0].explode_mm - mean([component.explode_mm for component in stages.clip]))
    upper_axes, lower_axes = (axes_towards(device.level_from_rig, viewer) for viewer in viewers(clip))
    camera_items = []
    for camera in stages.camera:
        body = displaced(camera, shift, name_of(camera)).body
        camera_items.append(Item(replace(body, triangles=tilted(clip, body.triangles)), name_of(camera)))
        corners = body.triangles.reshape(-1, 3)
        end = corners[np.argmax(corners @ upper_axes[0])]
        seat, label = end - shift, ""
        if clip.tray is not None:
            end, seat, label = (
                end_point(clip.tray, body.triangles),
                end_point(clip.tray, triangles_of(camera)),
                FIRST_END,
            )
        direction = (seat - end) / np.linalg.norm(seat - end)
        camera_items.append(Item(arrow_head((end + seat) / 2.0, direction), label, np.array([end, seat])))
    notes, title = notes_of(clip), "Camera and clip"
    # The lower view omits the camera, which would hide the clip.
    lower = DevicePicture(
        "camera", title, lower_axes, clip_items, notes=notes, caption="The clip alone, from the camera's back"
    )
    return DevicePicture(
        "camera",
        title,
        upper_axes,
        (*clip_items, *camera_items),
        notes=notes,
        caption="From above the lens",
        lower=lower,
    )


def _clip_on_mount(device: Device, stages: Stages) -> tuple[Item, ...]:
    """The clip with its camera in front of the mount, with red bars on the scale and on the edge that reads it."""
    existing = [*stages.holder, *stages.carriers, *stages.mount, *stages.mirrors, *stages.holder_screws]
    new = [*stages.clip, *stages.camera, *stages.camera_screws]
    items = assembled(existing, new, stages.clip_screws, stages.mount, moved_with=stages.clip)
    shift = STEP_RATIO * (
        mean([component.explode_mm for component in stages.clip]) - mean([p.explode_mm for p in stages.mount])
    )
    threads = [displaced(thread, shift) for thread in stages.threads_in(stages.clip)]
    edge, mark = scale_edges(device)
    bars = (ShadedBody(edge + shift, ARROW_RGB), ShadedBody(mark, ARROW_RGB))
    line = np.array([mark.mean(axis=(0, 1)), edge.mean(axis=(0, 1)) + shift])
    return (*items, *threads, Item(bars[0], EDGE_TEXT, line), Item(bars[1], ""))


def scale_edges(device: Device) -> tuple[FloatArray, FloatArray]:
    """Triangles (n, 3, 3) in the rig frame of bars on the clip's reading edge and on the longest mark of the scale."""
    clip, mount = device.clip, device.mount
    longest = longest_mark_mm(clip, mount.half_width_mm, device.hardware)
    ends = np.array([mount.half_width_mm - longest, mount.half_width_mm])
    bar = trimesh.creation.box((float(np.ptp(ends)), BAR_MM, BAR_MM))
    bar.apply_translation((float(ends.mean()), clip.slide_y_mm, clip.top_mm))
    triangles = np.asarray(bar.triangles, dtype=np.float64)
    return triangles, triangles


def _adapter_on_mount(stages: Stages) -> tuple[Item, ...]:
    threads = stages.threads_in(stages.adapter)
    new = {component.name for component in (*stages.adapter, *stages.adapter_screws, *stages.back_nuts, *threads)}
    existing = [component for component in stages.components if component.name not in new]
    items = assembled(existing, stages.adapter, (*stages.adapter_screws, *stages.back_nuts), stages.mount)
    # Inserts and nuts are already in the adapter.
    base = mean([component.explode_mm for component in stages.mount])
    homes = [(thread, home_of(thread, joins_of(thread)[-1], stages.adapter)) for thread in threads]
    return (*items, *(displaced(thread, STEP_RATIO * (home.explode_mm - base)) for thread, home in homes if home))


def _on_bed(parts: Sequence[BuiltPart]) -> tuple[Item, ...]:
    """The parts in print orientation, in rows on a roughly square floor."""
    meshes = [(part, trimesh.load_mesh(part.stl)) for part in parts]
    printed = [(part, transform(part.print_from_rig, np.asarray(mesh.triangles))) for part, mesh in meshes]
    sizes = [np.ptp(triangles.reshape(-1, 3), axis=0) for _, triangles in printed]
    row_end = 1.05 * np.sqrt(sum((size[0] + BED_GAP_MM) * (size[1] + BED_GAP_MM) for size in sizes))
    x = y = row_depth = 0.0
    items = []
    for (part, triangles), size in zip(printed, sizes, strict=True):
        if x > 0.0 and x + size[0] > row_end:
            x, y, row_depth = 0.0, y - row_depth - BED_GAP_MM, 0.0
        shift = np.array([x, y - size[1], 0.0]) - triangles.reshape(-1, 3).min(axis=0)
        items.append(Item(ShadedBody(triangles + shift, part.rgb), f"{part.number} {part.title}"))
        x, row_depth = x + size[0] + BED_GAP_MM, max(row_depth, float(size[1]))
    return tuple(items)
