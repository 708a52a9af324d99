"""Objects of a scene as arrays that rays are traced through, and their textures. In view axes, mm.

One table stores the textures at several scales, for the means over footprints of pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.compiled import inlined
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.render_scenes.boards import margin_mm, printed_radiance
from mirrorcam.render_scenes.mesh_shapes import leaves
from mirrorcam.render_scenes.preview.triangle_tree import NO_TRIANGLES, TriangleTree, triangle_tree
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.tabletop.objects import (
    LAMP,
    SKY,
    Kind,
    SceneObject,
    TextureName,
    lamp_square,
    surface_texture,
    texture_size_px,
)
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop

MOST_TAPS = 8
"""Maximum number of samples along the longer axis of a footprint; a longer footprint uses a coarser scale."""

SHARPER = 0.75
"""Texels of the scale that is looked up, in widths of a footprint: between texels it is smoothed, which widens them."""


class TextureAtlas(NamedTuple):
    """Textures at scales of 1, 1/2, 1/4, ...

    Attributes
    ----------
    texels
        (n, 3): of all scales of all textures, row by row.
    scales
        (m, 3): where the texels of a scale begin, its columns and its rows.
    textures
        (k, 2): the first scale of a texture, and the number of its scales.
    """

    texels: NDArray[np.float32]
    scales: NDArray[np.int64]
    textures: NDArray[np.int64]


def texture_atlas(pictures: Sequence[NDArray[np.float32]]) -> TextureAtlas:
    """Build the atlas of pictures (rows, columns, 3); the texels of each scale are means of the picture."""
    texels: list[NDArray[np.float32]] = []
    scales: list[tuple[int, int, int]] = []
    textures: list[tuple[int, int]] = []
    begin = 0
    for picture in pictures:
        first = len(scales)
        shown = np.ascontiguousarray(picture, dtype=np.float32)
        while True:
            rows, columns = shown.shape[:2]
            scales.append((begin, columns, rows))
            texels.append(shown.reshape(-1, 3))
            begin += rows * columns
            if max(rows, columns) == 1:
                break
            size = ((columns + 1) // 2, (rows + 1) // 2)
            shown = np.asarray(cv2.resize(shown, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        textures.append((first, len(scales) - first))
    return TextureAtlas(
        np.concatenate([*texels, np.zeros((1, 3), np.float32)]),
        np.array(scales, dtype=np.int64).reshape(-1, 3),
        np.array(textures, dtype=np.int64).reshape(-1, 2),
    )


@inlined
def mean_colour(texels: Any, scales: Any, textures: Any, texture: Any, at: Any, right: Any, down: Any) -> Any:
    """Return the mean of a texture over the parallelogram with sides `right` and `down`, (2,) each, around `at`.

    All are in widths and heights of the texture, from its top left corner.
    """
    first, count = textures[texture, 0], textures[texture, 1]
    columns, rows = scales[first, 1], scales[first, 2]
    ax, ay, bx, by = right[0] * columns, right[1] * rows, down[0] * columns, down[1] * rows
    if ax * ax + ay * ay < bx * bx + by * by:
        ax, ay, bx, by = bx, by, ax, ay
    longer = max(np.sqrt(ax * ax + ay * ay), 1e-9)
    shorter = abs(ax * by - ay * bx) / longer
    taps = int(min(np.ceil(longer / max(shorter, 1.0)), float(MOST_TAPS)))
    scale = np.log2(max(SHARPER * max(shorter, longer / taps), 1.0))
    if taps > 1:
        # Of several places, each at the nearest scale: what is between them smooths the step to the next.
        scale = np.floor(scale + 0.5)
    fine = min(int(scale), count - 1)
    coarse = min(fine + 1, count - 1)
    part = min(max(scale - fine, 0.0), 1.0)
    red, green, blue = 0.0, 0.0, 0.0
    for tap in range(taps):
        offset = (tap + 0.5) / taps - 0.5
        u, v = at[0] + offset * ax / columns, at[1] + offset * ay / rows
        c = _between(texels, scales, first + fine, u, v)
        red, green, blue = red + (1.0 - part) * c[0], green + (1.0 - part) * c[1], blue + (1.0 - part) * c[2]
        if part > 0.0:
            c = _between(texels, scales, first + coarse, u, v)
            red, green, blue = red + part * c[0], green + part * c[1], blue + part * c[2]
    return (red / taps, green / taps, blue / taps)


@inlined
def _between(texels: Any, scales: Any, scale: Any, u: Any, v: Any) -> Any:
    """Interpolate the colour of a scale at a point between four texels; the border is replicated."""
    begin, columns, rows = scales[scale, 0], scales[scale, 1], scales[scale, 2]
    x = min(max(u * columns - 0.5, 0.0), columns - 1.0)
    y = min(max(v * rows - 0.5, 0.0), rows - 1.0)
    column, line = int(x), int(y)
    x, y = x - column, y - line
    upper = begin + line * columns + column
    lower = upper + columns if line + 1 < rows else upper
    step = 1 if column + 1 < columns else 0
    a, b, c, d = (1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y
    return (
        a * texels[upper, 0] + b * texels[upper + step, 0] + c * texels[lower, 0] + d * texels[lower + step, 0],
        a * texels[upper, 1] + b * texels[upper + step, 1] + c * texels[lower, 1] + d * texels[lower + step, 1],
        a * texels[upper, 2] + b * texels[upper + step, 2] + c * texels[lower, 2] + d * texels[lower + step, 2],
    )


RECTANGLE, SPHERE, CYLINDER, BOX, TRIANGLES = range(5)
KINDS = {"rectangle": RECTANGLE, "sphere": SPHERE, "cylinder": CYLINDER, "box": BOX, "leaves": TRIANGLES}
MATTE, GLOSSY, GLASS, PRINTED = range(4)
MATERIALS = {"matte": MATTE, "glossy": GLOSSY, "glass": GLASS}
PLAIN = -1
"""Texture number of an object without one."""
LAMP_ORDER = (0, 15, 6, 9, 3, 12, 5, 10, 1, 14, 7, 8, 2, 13, 4, 11)
"""Points of the lamp, of 4 x 4, that shadows are made of: two of its corners and two near its middle first."""
OPEN = 0.6
"""Fraction of the sky visible from an object of the scene."""
LIT = 0.35
"""Fraction of an object's surface lit by the lamp, times the cosine."""
TWIGS_OPAQUE = 0.35


# Columns of the table of objects. Few tables, and none of their slices, go through the loops: numba counts the users of
# every array that it passes on or cuts.
KIND, MATERIAL, SHADES, TEXTURE, COLOUR, BOUND, UNIT = 0, 1, 2, 3, 4, 7, 11
# Rows of the tables of the lamp and of the surroundings.
MIDDLE, FACING, FIRST_SIDE, SECOND_SIDE, RADIANCE, POINTS = 0, 1, 2, 3, 4, 5
SKY_LIGHT, FLOOR_LIGHT, WALL_LIGHT, PLACES = range(4)
# Columns of the table of balls.
RADIUS, OWNER, OPAQUE, GLOW = 3, 4, 5, 6


class TracedScene(NamedTuple):
    """Objects (n), each a unit shape in a frame of its own, with the light on them.

    The unit shapes are a square and a box of -1 to 1, a sphere and a cylinder of radius 1 and, for the latter, z of -1
    to 1 with a lid on top, and the triangles of a `TriangleTree`.

    Attributes
    ----------
    objects
        (n, 23): kind and material as numbered above; whether it may hide the lamp from others; number of the texture
        in the atlas or `PLAIN`; colour, where there is no texture; middle and radius of a sphere around it; affine map
        (3, 4) from view axes to the frame of the unit shape.
    boxes, triangles
        Those of the leaves.
    texels, scales, textures
        Those of a `TextureAtlas`.
    lamp
        (21, 3): middle of a square, the unit vector to the side that it shines to, vectors from its
        middle to the middles of two sides, RGB radiance, and points spread over it.
    around
        (4, 3): RGB radiance of the sky, of the floor and of the wall; y of the floor, z of the wall (infinite where
        there is none) and 0.
    balls
        (k, 9): spheres that hide the sky from other objects: middle, radius, object that it stands for, part of the
        light that it hides, RGB radiance.
    """

    objects: FloatArray
    boxes: FloatArray
    triangles: FloatArray
    texels: NDArray[np.float32]
    scales: NDArray[np.int64]
    textures: NDArray[np.int64]
    lamp: FloatArray
    around: FloatArray
    balls: FloatArray


def traced_tabletop(tabletop: Tabletop) -> TracedScene:
    """Return the arrays of a tabletop scene; raise InputError for meshes from files, or more than one of leaves."""
    objects = tabletop.objects
    for item in objects:
        if item.kind not in KINDS:
            raise InputError(f"{item.name}: a {item.kind}, expected one of {', '.join(KINDS)}")
    twigs = [item for item in objects if item.kind == "leaves"]
    if len(twigs) > 1:
        raise InputError(f"{len(twigs)} objects are leaves, expected one at most")
    textured = [item for item in objects if item.texture is not None]
    atlas = _atlas(tuple((item.kind, item.texture, texture_size_px(item), item.seed) for item in textured))
    places = {id(item): number for number, item in enumerate(textured)}
    lamp = _lamp(tabletop)
    colours = np.array([_mean(atlas, places[id(item)]) if id(item) in places else item.colour for item in objects])
    rows = [
        [
            KINDS[item.kind],
            MATERIALS[item.material],
            item.name not in ("wall", "desk"),
            places.get(id(item), PLAIN),
            *colour,
            *item.view_from_object[:3, 3],
            _radius_mm(item),
            *unit_from_view(item).ravel(),
        ]
        for item, colour in zip(objects, colours, strict=True)
    ]
    tree = _twigs(twigs[0].seed) if twigs else NO_TRIANGLES
    around, balls = _surroundings(tabletop, colours, lamp)
    return _scene(np.array(rows, dtype=np.float64), tree, atlas, (lamp, around, balls))


def traced_board(target: Target, view_from_board: FloatArray, settings: RenderSettings) -> TracedScene:
    """Return the arrays of a uniformly lit board at a rigid pose (4, 4), mm, against black."""
    width, height = np.array(target.size_mm) + 2.0 * margin_mm(target)
    middle = view_from_board @ np.array([*target.size_mm, 0.0, 2.0]) / 2.0
    unit = inverse(rigid(view_from_board[:3, :3], middle[:3]))[:3] / np.array([width / 2.0, height / 2.0, 1.0])[:, None]
    atlas = _print_atlas(target.model_dump_json(), settings.paper, settings.ink, type(target))
    row = [RECTANGLE, PRINTED, 0.0, 0.0, 0.0, 0.0, 0.0, *middle[:3], np.hypot(width, height) / 2.0, *unit.ravel()]
    lamp, around = np.zeros((POINTS, 3)), np.array([(0.0,) * 3] * 3 + [(np.inf, np.inf, 0.0)])
    return _scene(np.array([row]), NO_TRIANGLES, atlas, (lamp, around, np.zeros((0, 9))))


@lru_cache(maxsize=4)
def _print_atlas(target: str, paper: float, ink: float, kind: type[Target]) -> TextureAtlas:
    grey = printed_radiance(kind.model_validate_json(target), RenderSettings(paper=paper, ink=ink))
    return texture_atlas([np.repeat(grey[..., None], 3, axis=2).astype(np.float32)])


def _scene(
    objects: FloatArray, tree: TriangleTree, atlas: TextureAtlas, light: tuple[FloatArray, FloatArray, FloatArray]
) -> TracedScene:
    return TracedScene(
        objects, tree.boxes, tree.triangles, atlas.texels, atlas.scales, atlas.textures, light[0], light[1], light[2]
    )


def unit_from_view(item: SceneObject) -> FloatArray:
    """Return the affine map (3, 4) from view axes, mm, to the frame of an object's unit shape."""
    width, depth, height = item.size_mm
    half = {
        "rectangle": (width / 2.0, depth / 2.0, 1.0),
        "sphere": (width / 2.0,) * 3,
        "cylinder": (width / 2.0, width / 2.0, height / 2.0),
        "box": (width / 2.0, depth / 2.0, height / 2.0),
        "leaves": (width,) * 3,
    }[item.kind]
    return np.asarray(inverse(item.view_from_object)[:3] / np.array(half)[:, None])


def _radius_mm(item: SceneObject) -> float:
    """Return the radius of a sphere about an object's origin that contains the object."""
    width, depth, height = item.size_mm
    if item.kind == "leaves":
        reach = np.linalg.norm(leaves(1.0, item.seed).points, axis=1).max()
        return float(width * reach)
    sides = {"sphere": (width,), "cylinder": (width, height), "rectangle": (width, depth)}
    return float(np.linalg.norm(sides.get(item.kind, (width, depth, height)))) / 2.0


@lru_cache(maxsize=8)
def _twigs(seed: int) -> TriangleTree:
    return triangle_tree(leaves(1.0, seed))


@lru_cache(maxsize=4)
def _atlas(textures: tuple[tuple[Kind, TextureName, tuple[int, int], int], ...]) -> TextureAtlas:
    return texture_atlas([surface_texture(*each) for each in textures])


def _mean(atlas: TextureAtlas, texture: int) -> FloatArray:
    """Return the mean colour (3,) of a texture: its coarsest scale."""
    first, count = atlas.textures[texture]
    return np.asarray(atlas.texels[atlas.scales[first + count - 1, 0]], dtype=np.float64)


def _lamp(tabletop: Tabletop) -> FloatArray:
    centre, normal, across = lamp_square(tabletop.lit_in_view, tabletop.reach_mm)
    columns, rows = np.divmod(np.array(LAMP_ORDER), 4)
    spread = (np.column_stack([columns, rows]) - 1.5) / 2.0
    return np.concatenate([[centre, normal], across, [LAMP], centre + spread @ across])


def lamp_light(lamp: FloatArray, point: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the lamp's irradiance (3,) at a point (3,) with a unit normal (3,), as from its middle, unshadowed."""
    way = lamp[MIDDLE] - point
    squared = float(way @ way)
    area = 4.0 * float(np.linalg.norm(np.cross(lamp[FIRST_SIDE], lamp[SECOND_SIDE])))
    facing = max(float(normal @ way), 0.0) * max(-float(lamp[FACING] @ way), 0.0) / squared
    return np.asarray(lamp[RADIANCE] * (area * facing / squared))


def _surroundings(tabletop: Tabletop, colours: FloatArray, lamp: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Surroundings of the objects of a tabletop scene, whose floor is its desk, and the balls that stand for them."""
    around = np.array([SKY, (0.0,) * 3, (0.0,) * 3, (np.inf, np.inf, 0.0)])
    sky = np.pi * OPEN * around[SKY_LIGHT]
    sides = {"desk": (FLOOR_LIGHT, 1, (0.0, -1.0, 0.0)), "wall": (WALL_LIGHT, 2, (0.0, 0.0, -1.0))}
    balls = []
    for number, item in enumerate(tabletop.objects):
        if item.name in sides:
            row, axis, normal = sides[item.name]
            light = lamp_light(lamp, tabletop.lit_in_view, np.array(normal)) + sky
            around[row], around[PLACES, axis - 1] = colours[number] * light / np.pi, item.view_from_object[axis, 3]
        light = LIT * lamp_light(lamp, tabletop.lit_in_view, -lamp[FACING]) + sky
        opaque = TWIGS_OPAQUE if item.kind == "leaves" else 1.0
        balls += [[*ball, number, opaque, *(colours[number] * light / np.pi)] for ball in _balls(item)]
    return around, np.array(balls).reshape(-1, 9)


def _balls(item: SceneObject) -> list[list[float]]:
    """Return spheres, middle and radius, that approximate an object in occluding the sky."""
    width, depth, height = item.size_mm
    middle, upwards = item.view_from_object[:3, 3], item.view_from_object[:3, 2]
    if item.kind in ("sphere", "leaves"):
        return [[*middle, width / 2.0]]
    if item.kind in ("cylinder", "box"):
        radius = (width if item.kind == "cylinder" else float(np.sqrt(width * depth))) / 2.0
        count = max(round(height / (2.0 * radius)), 1)
        places = (np.arange(count) + 0.5) / count - 0.5
        # As much area to the side as the object has.
        radius *= float(np.sqrt(height / (2.0 * radius * count) * 4.0 / np.pi))
        return [[*(middle + place * height * upwards), radius] for place in places]
    return []
