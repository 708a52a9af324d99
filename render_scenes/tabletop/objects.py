"""Objects of a tabletop scene as Mitsuba shapes, their materials and procedural textures, and the light sources.

Textures are linear RGB, 0 to 1: a picture, or generated from a seed. Every generated texture has detail at all scales
down to its texels, so that views can be matched everywhere.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from mirrorcam.core.arguments import PathField
from mirrorcam.core.bounds import SEED, Bounds
from mirrorcam.core.images.pictures import PICTURE_ENDINGS, is_picture, read_image
from mirrorcam.core.values import FloatArray, Matrix4, Points3, Shaped, Value, Vector3
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.optics.light_field.render.linear_light import light_from_levels
from mirrorcam.render_scenes.mesh_shapes import Triangles, leaves, read_mesh
from mirrorcam.render_scenes.reference.mirror_shapes import mesh

TextureName = Literal["wood", "poster", "page", "label", "cover", "globe"]
Texture = NDArray[np.float32]
_TEXT = """
light field view mirror camera pupil ray depth plane focus disparity parallax aperture sharp far near image of the a
with by from seen through nine flat angle fold lens pixel scene point line and to in is are moves turns behind
"""
_WORDS = _TEXT.split()


def texture(name: TextureName, size_px: tuple[int, int], seed: int) -> Texture:
    """Generate a texture (height, width, 3) with `size_px` = width, height; the seed determines it."""
    width, height = size_px
    picture = _MAKERS[name](height, width, np.random.default_rng(seed))
    return np.clip(picture, 0.02, 0.9).astype(np.float32)


def grain(
    height: int, width: int, random: np.random.Generator, *, cell: tuple[float, float], gain: float
) -> FloatArray:
    """Generate fractal noise (height, width) with mean 0 and standard deviation near 1.

    The coarsest cells have the size `cell` = (h, w). Each further octave has cells half as large and an amplitude
    `gain` times as large.
    """
    total, amplitude, power = np.zeros((height, width)), 1.0, 0.0
    cell_height, cell_width = cell
    while max(cell_height, cell_width) >= 1.0:
        rows, columns = (max(int(np.ceil(n / max(c, 1.0))), 2) for n, c in ((height, cell_height), (width, cell_width)))
        coarse = random.standard_normal((rows, columns)).astype(np.float32)
        total += amplitude * np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC))
        power += amplitude**2
        amplitude, cell_height, cell_width = amplitude * gain, cell_height / 2.0, cell_width / 2.0
    return np.asarray(total / np.sqrt(power))


def _mix(fraction: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Interpolate between two colours (3,) by a fraction (h, w)."""
    return np.asarray(low + np.clip(fraction, 0.0, 1.0)[..., None] * (high - low))


PALETTE = np.array(
    [
        (0.74, 0.045, 0.04),
        (0.85, 0.26, 0.03),
        (0.86, 0.60, 0.05),
        (0.13, 0.52, 0.10),
        (0.03, 0.46, 0.46),
        (0.05, 0.20, 0.74),
        (0.34, 0.10, 0.60),
        (0.84, 0.20, 0.42),
    ]
)
"""Colours of the objects, linear RGB: bright and saturated, so that small pictures of the scene stay readable."""


def colours(random: np.random.Generator, count: int) -> FloatArray:
    """Draw colours (count, 3) of the palette, different ones first, with a small variation."""
    order = np.concatenate([random.permutation(len(PALETTE)) for _ in range(-(-count // len(PALETTE)))])[:count]
    return np.asarray(np.clip(PALETTE[order] * random.uniform(0.9, 1.1, (count, 3)), 0.03, 0.87))


def _wood(height: int, width: int, random: np.random.Generator) -> FloatArray:
    rings = grain(height, width, random, cell=(height / 6.0, width * 2.0), gain=0.8)
    lines = grain(height, width, random, cell=(6.0, 160.0), gain=0.7)
    specks = grain(height, width, random, cell=(4.0, 4.0), gain=1.0)
    fraction = 0.5 + 0.22 * np.sin(4.0 * rings) + 0.14 * lines + 0.1 * specks
    return _mix(fraction, np.array([0.44, 0.25, 0.12]), np.array([0.80, 0.60, 0.38]))


def _poster(height: int, width: int, random: np.random.Generator) -> FloatArray:
    hills = grain(height, width, random, cell=(height / 3.0, width / 4.0), gain=0.6)
    ground = _mix(0.5 + 0.35 * hills, np.array([0.36, 0.64, 0.84]), np.array([0.74, 0.84, 0.86]))
    canvas = np.ascontiguousarray(ground, dtype=np.float32)
    for colour in colours(random, 220).tolist():
        position = (int(random.integers(width)), int(random.integers(height)))
        radius = int(random.uniform(0.004, 0.03) * width)
        if random.random() < 0.5:
            cv2.circle(canvas, position, radius, colour, -1, cv2.LINE_AA)
        else:
            corners = cv2.boxPoints((position, (radius, 2.0 * radius), float(random.uniform(0.0, 180.0))))
            cv2.fillPoly(canvas, [corners.astype(np.int32)], colour, cv2.LINE_AA)
    weave = grain(height, width, random, cell=(6.0, 6.0), gain=0.9)
    return np.asarray(canvas * (1.0 + 0.10 * weave[..., None]))


def _page(height: int, width: int, random: np.random.Generator) -> FloatArray:
    paper, ink = np.full((height, width, 3), 0.85), np.zeros((height, width), dtype=np.uint8)
    margin, line = width // 12, max(height // 20, 9)
    row = margin + line
    _write(ink, " ".join(random.choice(_WORDS, 3)), (margin, row), 1.3 * line)
    row += 2 * line
    while row < height - margin:
        if 0.5 * height < row < 0.5 * height + line:
            block = min(5 * line, height - margin - row)
            paper[row : row + block, margin : width - margin] = _poster(block, width - 2 * margin, random)
            row += block + line
        _write(ink, " ".join(random.choice(_WORDS, 10)), (margin, row), 0.62 * line)
        row += line
    ink[:, width - margin :] = 0
    fibres = 0.02 * grain(height, width, random, cell=(8.0, 8.0), gain=1.0)[..., None]
    return np.asarray((paper + fibres) * (1.0 - 0.94 * (ink / 255.0)[..., None]))


def _write(ink: NDArray[np.uint8], text: str, position: tuple[int, int], capital_px: float) -> None:
    """Draw a line of text with capitals `capital_px` texels tall and the bottom left corner `position`."""
    scale = capital_px / 30.0
    cv2.putText(ink, text, position, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, max(round(2 * scale), 1), cv2.LINE_AA)


def _label(height: int, width: int, random: np.random.Generator) -> FloatArray:
    background, band, *dots = colours(random, 2 + 12)
    picture = np.broadcast_to(background, (height, width, 3)).copy()
    for top, bottom in ((0.06, 0.12), (0.36, 0.64), (0.88, 0.94)):
        picture[int(top * height) : int(bottom * height)] = band
    ink, step = np.zeros((height, width), dtype=np.uint8), width // 6
    for column in range(6):
        _write(ink, str(random.choice(_WORDS[:17])), (int((column + 0.1) * step), int(0.56 * height)), step / 6.0)
        for number, row in enumerate((0.24, 0.76)):
            disc = np.zeros((height, width), dtype=np.uint8)
            centre = (int((column + 0.5) * step), int(row * height))
            cv2.circle(disc, centre, min(step // 3, height // 10), 255, -1, cv2.LINE_AA)
            picture += (disc / 255.0)[..., None] * (dots[2 * column + number] - picture)
    picture += (ink / 255.0)[..., None] * (0.85 - picture)
    return np.asarray(picture * (1.0 + 0.10 * grain(height, width, random, cell=(10.0, 10.0), gain=0.9)[..., None]))


def _cover(height: int, width: int, random: np.random.Generator) -> FloatArray:
    cells = 6
    squares = colours(random, cells * cells).reshape(cells, cells, 3).astype(np.float32)
    patches = np.asarray(cv2.resize(squares, (width, height), interpolation=cv2.INTER_NEAREST))
    threads = grain(height, width, random, cell=(12.0, 12.0), gain=0.85)
    return np.asarray(patches * (1.0 + 0.14 * threads[..., None]))


def _globe(height: int, width: int, random: np.random.Generator) -> FloatArray:
    land = grain(height, width, random, cell=(height / 4.0, width / 6.0), gain=0.65)
    detail = grain(height, width, random, cell=(8.0, 16.0), gain=0.9)
    sea = _mix(0.5 + 0.3 * detail, np.array([0.04, 0.22, 0.58]), np.array([0.14, 0.44, 0.82]))
    shore = _mix(0.5 + 0.4 * detail, np.array([0.16, 0.48, 0.08]), np.array([0.80, 0.66, 0.24]))
    picture = np.where((land > 0.1)[..., None], shore, sea)
    for position in np.arange(1, 12) / 12.0:
        picture[:, int(position * width)] = 0.85
        picture[int(position * height)] = 0.85
    return np.asarray(picture)


_MAKERS: dict[TextureName, Callable[[int, int, np.random.Generator], FloatArray]] = {
    "wood": _wood,
    "poster": _poster,
    "page": _page,
    "label": _label,
    "cover": _cover,
    "globe": _globe,
}


Kind = Literal["sphere", "cylinder", "box", "rectangle", "leaves", "mesh"]
Material = Literal["matte", "glossy", "glass"]

GLASS_INDEX = 1.5
MIN_TEXELS, MAX_TEXELS = 64, 4096
SKY = (0.62, 0.65, 0.70)
LAMP = (105.0, 98.0, 87.0)
LAMP_OFFSET = (-1.2, -2.4, -1.3)
"""Centre of the area light relative to its target, in view axes, in units of the arrangement's scale."""
LAMP_HALF_SIDE = 0.22
"""Half the side length of the area light, in units of the arrangement's scale."""


_Texels = Annotated[int, Bounds(MIN_TEXELS, MAX_TEXELS).limits]


def _checked_texture(value: Any) -> str | Path | Texture | None:
    """Return the name of a random texture, the path of a picture, or texels (h, w, 3), linear RGB."""
    if value is None or (isinstance(value, str) and value in _MAKERS):
        return value
    if isinstance(value, str | os.PathLike):
        if not is_picture(Path(value)):
            raise ValueError(f"{value}, expected one of {', '.join(_MAKERS)}, or a {', '.join(PICTURE_ENDINGS)} file")
        return Path(value)
    texels = np.array(value)
    if texels.ndim != 3 or texels.shape[2] != 3 or not texels.size:
        raise ValueError(f"shape {texels.shape}, expected a name, a path, or an array (h, w, 3)")
    if texels.dtype == np.uint8:
        texels = light_from_levels(texels)
    elif texels.dtype.kind != "f":
        raise ValueError(f"an array of {texels.dtype}, expected uint8, or floating point from 0 to 1")
    elif not (texels.min() >= 0.0 and texels.max() <= 1.0):  # also refuses NaN
        raise ValueError(f"{texels.dtype} from {texels.min():g} to {texels.max():g}, expected 0 to 1, or uint8")
    texels = texels.astype(np.float32)
    texels.flags.writeable = False
    return texels


def _vertex_indices(faces: FloatArray) -> NDArray[np.int64]:
    indices = faces.astype(np.int64)
    if not len(indices) or (indices != faces).any() or indices.min() < 0:
        raise ValueError("expected one or more triangles of three indices of vertices, counted from 0")
    indices.flags.writeable = False
    return indices


_SIDES = {"sphere": [0], "leaves": [0], "cylinder": [0, 2], "rectangle": [0, 1], "mesh": []}
"""Sides that a kind of object uses, if not all."""
_TEXTURED = ("rectangle", "sphere", "cylinder", "box")
"""Kinds that can have a random texture. On a box, pictures would be mirrored on some sides: Mitsuba's cube is so."""


class SceneObject(Value):
    """An object of a scene: a surface around the origin of its frame, placed in view axes.

    Attributes
    ----------
    name
        Name in lists.
    kind
        `sphere`, `cylinder` about its z, `box`, `rectangle` in its x and y, `leaves`, or a `mesh`.
    material
        `matte`, `glossy` or `glass`.
    view_from_object
        Pose (4, 4), rigid, mm, in view axes: origin at the pupil, x right, y down, z forward to the scene.
    size_mm
        Sides along the object's x, y and z. A sphere and leaves use only x; a cylinder x (diameter) and z (length); a
        rectangle x and y; a mesh has the size of its vertices.
    texture
        None for the uniform `colour`; a picture on a rectangle, a sphere or a cylinder: the path of a file, or an array
        (h, w, 3), RGB, which is uint8 and encoded as sRGB, or linear reflectance in floating point from 0 to 1; or the
        name of a random texture, also on a box: `wood`, `poster`, `page`, `label`, `cover` or `globe`. The first row
        and column of a picture are at the least y and x of a rectangle. On a sphere and around a cylinder, the first
        row is at the greatest z, and columns run counterclockwise about z from x.
    texels_per_mm, texture_px
        Resolution of a random texture, or its columns and rows.
    colour
        Reflectance (3,), linear RGB from 0 to 1.
    seed
        Seed of a random texture and of leaves.
    file
        STL, PLY or OBJ file of a mesh, in mm with z up; the centre of its base is the object's origin. Only triangles
        are read: colours, materials (MTL) and textures of the file are not.
    vertices_mm, faces
        A mesh in memory instead of a file: vertices (n, 3) in the object's frame, and the indices (m, 3) of the corners
        of its triangles.
    """

    name: str = ""
    kind: Kind
    material: Material = "matte"
    view_from_object: Matrix4 = Field(serialization_alias="view_from_thing")
    size_mm: Vector3 = Field(default=(0.0, 0.0, 0.0), validate_default=True)
    texture: Annotated[
        str | os.PathLike[str] | NDArray[np.uint8] | NDArray[np.floating] | None,
        PlainValidator(_checked_texture),
        PlainSerializer(lambda texture: texture.tolist() if isinstance(texture, np.ndarray) else texture),
        WithJsonSchema({"type": ["string", "array", "null"]}),
    ] = None
    texels_per_mm: float = Field(default=1.0, gt=0.0)
    texture_px: tuple[_Texels, _Texels] | None = None
    colour: Vector3 = Field(default=(0.6, 0.6, 0.6), validate_default=True)
    seed: int = SEED.field(0)
    file: PathField | None = None
    vertices_mm: Points3 | None = None
    faces: Annotated[NDArray[np.int64], Shaped((None, 3), largest=2**31), AfterValidator(_vertex_indices)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        self._check_mesh()
        turn = self.view_from_object[:3, :3]
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or np.linalg.det(turn) < 0.0:
            raise ValueError("view_from_object is not rigid, expected a rotation and a shift")
        used = self.size_mm[_SIDES.get(self.kind, [0, 1, 2])]
        if not (used > 0.0).all():
            raise ValueError(f"a {self.kind} of {self.size_mm.tolist()} mm, expected positive sides")
        if self.colour.min() < 0.0 or self.colour.max() > 1.0:
            raise ValueError(f"colour {self.colour.tolist()}, expected linear RGB from 0 to 1")
        if self.texture is not None and (self.kind not in _TEXTURED or self.material == "glass"):
            expected = f"none, or a matte or glossy {', '.join(_TEXTURED)}"
            raise ValueError(f"a texture on a {self.kind} of {self.material} material, expected {expected}")
        if self.kind == "box" and not isinstance(self.texture, str | None):
            raise ValueError("a picture on a box, expected the name of a random texture, or six rectangles instead")
        return self

    def _check_mesh(self) -> None:
        given = [name for name in ("file", "vertices_mm", "faces") if getattr(self, name) is not None]
        if given not in ([["file"], ["vertices_mm", "faces"]] if self.kind == "mesh" else [[]]):
            expected = "a file or vertices_mm and faces for a mesh, and nothing for other kinds"
            raise ValueError(f"a {self.kind} with {' and '.join(given) or 'no triangles'}, expected {expected}")
        if self.vertices_mm is not None and self.faces is not None and self.faces.max() >= len(self.vertices_mm):
            raise ValueError(f"faces have the index {self.faces.max()}, expected less than {len(self.vertices_mm)}")


def shapes_of(item: SceneObject, view_from_rig: FloatArray) -> list[Any]:
    """Return the shapes of an object in the rig frame, mm."""
    import mitsuba as mi

    rig_from_object = rigid(view_from_rig.T, np.zeros(3)) @ item.view_from_object
    width, depth, height = item.size_mm
    bsdf = _bsdf(item)

    def load(kind: str, object_from_shape: FloatArray) -> Any:
        to_world = (rig_from_object @ object_from_shape).astype(np.float32)
        return _load_quietly({"type": kind, "to_world": mi.ScalarTransform4f(to_world), "bsdf": bsdf})

    if item.kind == "sphere":
        return [load("sphere", np.diag([width / 2, width / 2, width / 2, 1.0]))]
    if item.kind == "rectangle":
        return [load("rectangle", np.diag([width / 2, depth / 2, 1.0, 1.0]))]
    if item.kind == "box":
        return [load("cube", np.diag([width / 2, depth / 2, height / 2, 1.0]))]
    if item.kind == "cylinder":
        side, lid = np.diag([width / 2, width / 2, height, 1.0]), np.diag([width / 2, width / 2, 1.0, 1.0])
        side[2, 3], lid[2, 3] = -height / 2, height / 2
        return [load("cylinder", side), load("disk", lid)]
    surface = leaves(float(width), item.seed) if item.kind == "leaves" else mesh_surface(item)
    points = transform(rig_from_object, surface.points)
    shape = mesh(item.kind, points, surface.faces.astype(np.int64), bsdf)
    if surface.colours is not None:
        shape.add_attribute("vertex_color", 3, np.float32(surface.colours).ravel())
    return [shape]


def _load_quietly(shape: dict[str, Any]) -> Any:
    """Load a shape without warnings: Mitsuba mistakes float32 rounding of a scaled rotation for shear."""
    import mitsuba as mi

    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        return mi.load_dict(shape)
    finally:
        mi.set_log_level(level)


def mesh_surface(item: SceneObject) -> Triangles:
    """Return the triangles of a mesh in its object's frame; raise InputError for an unreadable file."""
    if item.file is None:
        assert item.vertices_mm is not None and item.faces is not None
        return Triangles(item.vertices_mm, item.faces.astype(np.uint32))
    surface = read_mesh(item.file)
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    return Triangles(surface.points - [*(low[:2] + high[:2]) / 2.0, low[2]], surface.faces)


def _bsdf(item: SceneObject) -> dict[str, Any]:
    if item.material == "glass":
        return {"type": "dielectric", "int_ior": GLASS_INDEX, "ext_ior": 1.0}
    colour = _reflectance(item)
    if item.material == "glossy":
        return {"type": "plastic", "int_ior": GLASS_INDEX, "ext_ior": 1.0, "diffuse_reflectance": colour}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}


def _reflectance(item: SceneObject) -> dict[str, Any]:
    import mitsuba as mi

    if item.kind == "leaves":
        return {"type": "mesh_attribute", "name": "vertex_color"}
    if item.texture is None:
        return {"type": "rgb", "value": item.colour.tolist()}
    picture = surface_texture(item).copy()  # Mitsuba takes no read-only array
    return {"type": "bitmap", "bitmap": mi.Bitmap(picture), "raw": True, "wrap_mode": "clamp"}


def texture_size_px(item: SceneObject) -> tuple[int, int]:
    """Return the columns and rows of an object's random texture."""
    if item.texture_px is not None:
        return item.texture_px
    width, depth, height = item.size_mm
    curved = {"sphere": (np.pi * width, np.pi * width / 2), "cylinder": (np.pi * width, height)}
    flat = {"rectangle": (width, depth), "box": (max(width, depth), height)}
    columns, rows = (
        int(np.clip(item.texels_per_mm * side, MIN_TEXELS, MAX_TEXELS)) for side in (curved | flat)[item.kind]
    )
    return columns, rows


def surface_texture(item: SceneObject) -> Texture:
    """Return the texture (rows, columns, 3) of an object; texture coordinates start at the top left corner.

    Raises InputError for an unreadable file.
    """
    if isinstance(item.texture, Path):
        picture = light_from_levels(read_image(item.texture))
    elif isinstance(item.texture, np.ndarray):
        picture = np.asarray(item.texture, dtype=np.float32)
    else:
        picture = texture(cast(TextureName, item.texture), texture_size_px(item), item.seed)
    # The v coordinate of a cylinder grows towards its top.
    return picture[::-1] if item.kind == "cylinder" else picture


def lamp_square(target_in_view: FloatArray, scale_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the centre (3,), unit normal (3,) and half sides (2, 3) of the area light, in view axes, mm."""
    normal = -np.array(LAMP_OFFSET) / np.linalg.norm(LAMP_OFFSET)
    first = np.cross([0.0, 0.0, 1.0], normal)
    first /= np.linalg.norm(first)
    sides = LAMP_HALF_SIDE * scale_mm * np.stack([first, np.cross(normal, first)])
    return target_in_view + scale_mm * np.array(LAMP_OFFSET), normal, sides


def lights(target_in_view: FloatArray, scale_mm: float, view_from_rig: FloatArray) -> dict[str, Any]:
    """Return a uniform environment and an area light, in the rig frame: above, left of and in front of a target.

    Size and distance of the area light are proportional to `scale_mm`: the target's irradiance does not depend on it.
    """
    import mitsuba as mi

    origin, _, _ = lamp_square(target_in_view, scale_mm)
    side = LAMP_HALF_SIDE * scale_mm
    to_world = mi.ScalarTransform4f().look_at(
        origin=(view_from_rig.T @ origin).tolist(),
        target=(view_from_rig.T @ target_in_view).tolist(),
        up=(view_from_rig.T @ [0.0, 0.0, 1.0]).tolist(),
    )
    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": list(SKY)}},
        "lamp": {
            "type": "rectangle",
            "to_world": to_world @ mi.ScalarTransform4f().scale([side, side, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(LAMP)}},
        },
    }
