"""A scene and its textures as arrays for ray tracing. Coordinates are in view axes, in mm.

Textures are stored at several scales (a mipmap), for means over the footprints of pixels.
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
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.render_scenes.boards import margin_mm, printed_radiance
from mirrorcam.render_scenes.mesh_shapes import leaves
from mirrorcam.render_scenes.preview.triangle_tree import NO_TRIANGLES, TriangleTree, triangle_tree
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.tabletop.objects import (
    LAMP,
    SKY,
    SceneObject,
    lamp_square,
    surface_texture,
    texture_size_px,
)
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop

MAX_TAPS = 8
"""Maximum number of samples along the longer axis of a footprint; a longer footprint uses a coarser scale."""

TEXEL_WIDTH = 0.75
"""Texel size of the sampled scale, relative to the footprint: interpolation between texels adds blur."""


class TextureAtlas(NamedTuple):
    """Textures at scales of 1, 1/2, 1/4, ...

    Attributes
    ----------
    texels
        (n, 3): texels of all scales of all textures, row by row.
    scales
        (m, 3): first texel of each scale, its columns and its rows.
    textures
        (k, 2): first scale of each texture, and the number of its scales.
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
        scaled = np.ascontiguousarray(picture, dtype=np.float32)
        while True:
            rows, columns = scaled.shape[:2]
            scales.append((begin, columns, rows))
            texels.append(scaled.reshape(-1, 3))
            begin += rows * columns
            if max(rows, columns) == 1:
                break
            size = ((columns + 1) // 2, (rows + 1) // 2)
            scaled = np.asarray(cv2.resize(scaled, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        textures.append((first, len(scales) - first))
    return TextureAtlas(
        np.concatenate([*texels, np.zeros((1, 3), np.float32)]),
        np.array(scales, dtype=np.int64).reshape(-1, 3),
        np.array(textures, dtype=np.int64).reshape(-1, 2),
    )


@inlined
def mean_colour(texels: Any, scales: Any, textures: Any, texture: Any, uv: Any, right: Any, down: Any) -> Any:
    """Return the mean colour of a texture over the parallelogram centred at `uv`, with sides `right` and `down` (2,).

    All are texture coordinates: fractions of width and height, from the top left corner.
    """
    first, count = textures[texture, 0], textures[texture, 1]
    columns, rows = scales[first, 1], scales[first, 2]
    ax, ay, bx, by = right[0] * columns, right[1] * rows, down[0] * columns, down[1] * rows
    if ax * ax + ay * ay < bx * bx + by * by:
        ax, ay, bx, by = bx, by, ax, ay
    longer = max(np.sqrt(ax * ax + ay * ay), 1e-9)
    shorter = abs(ax * by - ay * bx) / longer
    taps = int(min(np.ceil(longer / max(shorter, 1.0)), float(MAX_TAPS)))
    scale = np.log2(max(TEXEL_WIDTH * max(shorter, longer / taps), 1.0))
    if taps > 1:
        # Several samples already smooth the step between scales: one scale is enough.
        scale = np.floor(scale + 0.5)
    fine = min(int(scale), count - 1)
    coarse = min(fine + 1, count - 1)
    fraction = min(max(scale - fine, 0.0), 1.0)
    red, green, blue = 0.0, 0.0, 0.0
    for tap in range(taps):
        offset = (tap + 0.5) / taps - 0.5
        u, v = uv[0] + offset * ax / columns, uv[1] + offset * ay / rows
        c = _interpolate(texels, scales, first + fine, u, v)
        red, green, blue = (
            red + (1.0 - fraction) * c[0],
            green + (1.0 - fraction) * c[1],
            blue + (1.0 - fraction) * c[2],
        )
        if fraction > 0.0:
            c = _interpolate(texels, scales, first + coarse, u, v)
            red, green, blue = red + fraction * c[0], green + fraction * c[1], blue + fraction * c[2]
    return (red / taps, green / taps, blue / taps)


@inlined
def _interpolate(texels: Any, scales: Any, scale: Any, u: Any, v: Any) -> Any:
    """Interpolate the colour of a scale bilinearly at a point; the border is replicated."""
    begin, columns, rows = scales[scale, 0], scales[scale, 1], scales[scale, 2]
    x = min(max(u * columns - 0.5, 0.0), columns - 1.0)
    y = min(max(v * rows - 0.5, 0.0), rows - 1.0)
    column, row = int(x), int(y)
    x, y = x - column, y - row
    above = begin + row * columns + column
    below = above + columns if row + 1 < rows else above
    step = 1 if column + 1 < columns else 0
    a, b, c, d = (1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y
    return (
        a * texels[above, 0] + b * texels[above + step, 0] + c * texels[below, 0] + d * texels[below + step, 0],
        a * texels[above, 1] + b * texels[above + step, 1] + c * texels[below, 1] + d * texels[below + step, 1],
        a * texels[above, 2] + b * texels[above + step, 2] + c * texels[below, 2] + d * texels[below + step, 2],
    )


RECTANGLE, SPHERE, CYLINDER, BOX, TRIANGLES = range(5)
KINDS = {"rectangle": RECTANGLE, "sphere": SPHERE, "cylinder": CYLINDER, "box": BOX, "leaves": TRIANGLES}
MATTE, GLOSSY, GLASS, PRINTED = range(4)
MATERIALS = {"matte": MATTE, "glossy": GLOSSY, "glass": GLASS}
PLAIN = -1
"""Texture number of an object without a texture."""
LAMP_ORDER = (0, 15, 6, 9, 3, 12, 5, 10, 1, 14, 7, 8, 2, 13, 4, 11)
"""Order in which the 4 x 4 points of the lamp are tested for shadows: two corners and two inner points first."""
SKY_FRACTION = 0.6
"""Fraction of the sky visible from an object of the scene."""
LIT_FRACTION = 0.35
"""Mean of the lamp's cosine over an object's surface, with 0 in its shade."""
LEAF_OPACITY = 0.35


# Columns of the table of objects. Compiled loops pass few tables and no slices: numba counts the references of each.
KIND, MATERIAL, SHADES, TEXTURE, COLOUR, BOUNDING_SPHERE, TO_UNIT = 0, 1, 2, 3, 4, 7, 11
# Rows of the tables of the lamp and of the surroundings.
LAMP_CENTRE, FACING, FIRST_SIDE, SECOND_SIDE, RADIANCE, POINTS = 0, 1, 2, 3, 4, 5
SKY_LIGHT, FLOOR_LIGHT, WALL_LIGHT, POSITIONS = range(4)
# Columns of the table of balls.
RADIUS, OWNER, OPACITY, GLOW = 3, 4, 5, 6


class TracedScene(NamedTuple):
    """Objects, each a unit shape in its own frame, and their light sources.

    The unit shapes are a square and a box from -1 to 1, a sphere of radius 1, a cylinder of radius 1 with z from -1 to
    1 and a lid on top, and the triangles of a `TriangleTree`.

    Attributes
    ----------
    objects
        (n, 23): kind and material as numbered above; whether it may hide the lamp from others; number of the texture
        in the atlas or `PLAIN`; colour if it has no texture; centre and radius of its bounding sphere; affine map
        (3, 4) from view axes to the frame of the unit shape.
    boxes, triangles
        `TriangleTree` of the leaves.
    texels, scales, textures
        Fields of a `TextureAtlas`.
    lamp
        (21, 3): centre of the square lamp, its unit normal on the emitting side, half of its two sides, RGB radiance,
        and points spread over it.
    surroundings
        (4, 3): RGB radiance of the sky, of the floor and of the wall; y of the floor and z of the wall (infinite if
        absent), and 0.
    balls
        (k, 9): spheres that hide the sky from other objects: centre, radius, number of the approximated object,
        fraction of light that it hides, RGB radiance.
    """

    objects: FloatArray
    boxes: FloatArray
    triangles: FloatArray
    texels: NDArray[np.float32]
    scales: NDArray[np.int64]
    textures: NDArray[np.int64]
    lamp: FloatArray
    surroundings: FloatArray
    balls: FloatArray


def traced_tabletop(tabletop: Tabletop) -> TracedScene:
    """Return the arrays of a tabletop scene; raise InputError for meshes from files and for several plants."""
    objects = tabletop.objects
    for item in objects:
        if item.kind not in KINDS:
            raise InputError(f"{item.name}: a {item.kind}, expected one of {', '.join(KINDS)}")
    foliage = [item for item in objects if item.kind == "leaves"]
    if len(foliage) > 1:
        raise InputError(f"{len(foliage)} objects are leaves, expected at most one")
    textured = [item for item in objects if item.texture is not None]
    atlas = _atlas(textured)
    numbers = {id(item): number for number, item in enumerate(textured)}
    lamp = _lamp(tabletop)
    colours = np.array(
        [_mean_colour(atlas, numbers[id(item)]) if id(item) in numbers else item.colour for item in objects]
    )
    rows = [
        [
            KINDS[item.kind],
            MATERIALS[item.material],
            item.name not in ("wall", "desk"),
            numbers.get(id(item), PLAIN),
            *colour,
            *item.view_from_object[:3, 3],
            _radius_mm(item),
            *unit_from_view(item).ravel(),
        ]
        for item, colour in zip(objects, colours, strict=True)
    ]
    tree = _foliage_tree(foliage[0].seed) if foliage else NO_TRIANGLES
    surroundings, balls = _surroundings(tabletop, colours, lamp)
    return _scene(np.array(rows, dtype=np.float64), tree, atlas, (lamp, surroundings, balls))


def traced_board(board: CalibrationBoard, view_from_board: FloatArray, settings: RenderSettings) -> TracedScene:
    """Return the arrays of a uniformly lit board at a rigid pose (4, 4), mm, against black."""
    width, height = np.array(board.size_mm) + 2.0 * margin_mm(board)
    centre = view_from_board @ np.array([*board.size_mm, 0.0, 2.0]) / 2.0
    unit = inverse(rigid(view_from_board[:3, :3], centre[:3]))[:3] / np.array([width / 2.0, height / 2.0, 1.0])[:, None]
    atlas = _print_atlas(board.model_dump_json(), settings.paper, settings.ink, type(board))
    row = [RECTANGLE, PRINTED, 0.0, 0.0, 0.0, 0.0, 0.0, *centre[:3], np.hypot(width, height) / 2.0, *unit.ravel()]
    lamp, surroundings = np.zeros((POINTS, 3)), np.array([(0.0,) * 3] * 3 + [(np.inf, np.inf, 0.0)])
    return _scene(np.array([row]), NO_TRIANGLES, atlas, (lamp, surroundings, np.zeros((0, 9))))


@lru_cache(maxsize=4)
def _print_atlas(board: str, paper: float, ink: float, kind: type[CalibrationBoard]) -> TextureAtlas:
    grey = printed_radiance(kind.model_validate_json(board), RenderSettings(paper=paper, ink=ink))
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
        radius = np.linalg.norm(leaves(1.0, item.seed).points, axis=1).max()
        return float(width * radius)
    sides = {"sphere": (width,), "cylinder": (width, height), "rectangle": (width, depth)}
    return float(np.linalg.norm(sides.get(item.kind, (width, depth, height)))) / 2.0


@lru_cache(maxsize=8)
def _foliage_tree(seed: int) -> TriangleTree:
    return triangle_tree(leaves(1.0, seed))


def _atlas(textured: Sequence[SceneObject]) -> TextureAtlas:
    """Return the textures of objects; those of random textures only, which take half a second to draw, are cached."""
    if not all(isinstance(item.texture, str) for item in textured):
        return texture_atlas([surface_texture(item) for item in textured])
    unplaced = (
        SceneObject(
            kind=item.kind,
            view_from_object=np.eye(4),
            size_mm=np.ones(3),
            texture=item.texture,
            texture_px=texture_size_px(item),
            seed=item.seed,
        )
        for item in textured
    )
    return _drawn_atlas(tuple(unplaced))


@lru_cache(maxsize=4)
def _drawn_atlas(unplaced: tuple[SceneObject, ...]) -> TextureAtlas:
    return texture_atlas([surface_texture(item) for item in unplaced])


def _mean_colour(atlas: TextureAtlas, texture: int) -> FloatArray:
    """Return the mean colour (3,) of a texture: its coarsest scale."""
    first, count = atlas.textures[texture]
    return np.asarray(atlas.texels[atlas.scales[first + count - 1, 0]], dtype=np.float64)


def _lamp(tabletop: Tabletop) -> FloatArray:
    centre, normal, sides = lamp_square(tabletop.lamp_target_in_view_mm, tabletop.scale_mm)
    columns, rows = np.divmod(np.array(LAMP_ORDER), 4)
    spread = (np.column_stack([columns, rows]) - 1.5) / 2.0
    return np.concatenate([[centre, normal], sides, [LAMP], centre + spread @ sides])


def lamp_light(lamp: FloatArray, point: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the lamp's unshadowed irradiance (3,) at a point (3,) with a unit normal (3,), as if from its centre."""
    to_lamp = lamp[LAMP_CENTRE] - point
    squared = float(to_lamp @ to_lamp)
    area = 4.0 * float(np.linalg.norm(np.cross(lamp[FIRST_SIDE], lamp[SECOND_SIDE])))
    facing = max(float(normal @ to_lamp), 0.0) * max(-float(lamp[FACING] @ to_lamp), 0.0) / squared
    return np.asarray(lamp[RADIANCE] * (area * facing / squared))


def _surroundings(tabletop: Tabletop, colours: FloatArray, lamp: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the tables `surroundings` and `balls` of a `TracedScene`; its floor is the desk."""
    surroundings = np.array([SKY, (0.0,) * 3, (0.0,) * 3, (np.inf, np.inf, 0.0)])
    sky = np.pi * SKY_FRACTION * surroundings[SKY_LIGHT]
    planes = {"desk": (FLOOR_LIGHT, 1, (0.0, -1.0, 0.0)), "wall": (WALL_LIGHT, 2, (0.0, 0.0, -1.0))}
    balls = []
    for number, item in enumerate(tabletop.objects):
        if item.name in planes:
            row, axis, normal = planes[item.name]
            light = lamp_light(lamp, tabletop.lamp_target_in_view_mm, np.array(normal)) + sky
            surroundings[row] = colours[number] * light / np.pi
            surroundings[POSITIONS, axis - 1] = item.view_from_object[axis, 3]
        light = LIT_FRACTION * lamp_light(lamp, tabletop.lamp_target_in_view_mm, -lamp[FACING]) + sky
        opaque = LEAF_OPACITY if item.kind == "leaves" else 1.0
        balls += [[*ball, number, opaque, *(colours[number] * light / np.pi)] for ball in _balls(item)]
    return surroundings, np.array(balls).reshape(-1, 9)


def _balls(item: SceneObject) -> list[list[float]]:
    """Return spheres (centre and radius) that occlude the sky approximately as an object does."""
    width, depth, height = item.size_mm
    centre, upwards = item.view_from_object[:3, 3], item.view_from_object[:3, 2]
    if item.kind in ("sphere", "leaves"):
        return [[*centre, width / 2.0]]
    if item.kind in ("cylinder", "box"):
        radius = (width if item.kind == "cylinder" else float(np.sqrt(width * depth))) / 2.0
        count = max(round(height / (2.0 * radius)), 1)
        heights = (np.arange(count) + 0.5) / count - 0.5
        # Together, they have the area of the object from the side.
        radius *= float(np.sqrt(height / (2.0 * radius * count) * 4.0 / np.pi))
        return [[*(centre + fraction * height * upwards), radius] for fraction in heights]
    return []
