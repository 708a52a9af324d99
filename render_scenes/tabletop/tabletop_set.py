"""A tabletop scene photographed via a layout's mirrors, with the ground truth of its light field in a separate folder.

The truth is the picture and depth of a pinhole at each virtual camera, on the grid that decoding with the layout as
built uses. The request determines the bytes of a set. Every file is written atomically, so an interrupted set
can be continued.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mirrorcam.core.bounds import DEPTH_MM, GRID, SAMPLES_PER_PIXEL, SEED, SENSOR_PX
from mirrorcam.core.disk.files import read_bytes, write_files, write_json
from mirrorcam.core.disk.fingerprint import digest, value_digest
from mirrorcam.core.disk.resumable import FolderManifest
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.optics.light_field.decoder import choose_views, default_reference_depth_mm
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.render_scenes.lens import true_camera, with_pupil_of
from mirrorcam.render_scenes.settings import SENSORS, SensorModel
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.single_frame import REFLECTANCE, photographed
from mirrorcam.render_scenes.tabletop.tabletop import UserMesh, arrange_tabletop, check_meshes, clear_depth_mm
from mirrorcam.render_scenes.tabletop.tabletop_scene import NOTHING, Hits, TabletopScene, pinhole_rays
from mirrorcam.render_scenes.truth.pixel_maps import exr_bytes, pixel_rays
from mirrorcam.render_scenes.variant import use_variant

MANIFEST = "scene.json"
FIRST_FILES = ("layout.json", "truth/layout.json", "truth/things.json")
"""Files that are written before any picture."""
MAPS = "truth/maps/frames/0000.exr"
# Values of a mask: no object, or an object of this material.
MASK = {"nothing": 0, "matte": 1, "glossy": 2, "glass": 3}
# Streams of random numbers; each is independent of the number of draws from the others.
_AS_BUILT, _ARRANGEMENT, _FRAME, _NOISE, _VIEWS = range(5)

_Index = Annotated[int, Field(ge=0, lt=GRID.max)]


class TabletopRequest(Value):
    """All inputs that determine the files of a tabletop set.

    Parameters
    ----------
    layout
        Nominal layout; the scene is photographed with an as-built copy, drawn with `tolerances`.
    depths_mm
        Depths of the objects, ascending; by default the layout's design depths.
    meshes
        Additional objects from files.
    seed
        Seed of the as-built copy, of colours, textures and shifts, and of the noise.
    tolerances
        Tolerances of the as-built copy.
    sensor
        Lens and sensor.
    spp
        Samples per pixel.
    mirror_reflectance
        Reflectance of all mirrors.
    """

    layout: Layout
    depths_mm: tuple[float, ...] = ()
    meshes: tuple[UserMesh, ...] = Field(default=(), max_length=200)
    seed: int = SEED.field(0)
    tolerances: Tolerances = Tolerances()
    sensor: SensorModel = SENSORS["c920"]
    spp: int = SAMPLES_PER_PIXEL.narrowed(min=4).field(64)
    mirror_reflectance: float = Field(default=REFLECTANCE, gt=0, le=1)


class TabletopSet(FolderManifest):
    """The manifest, `scene.json`: what the user of a real camera knows, and a checksum of each file written so far.

    `request` is a digest of everything that determines the bytes of the set, including the seed.
    """

    FILE = MANIFEST
    NOUN = "scene"
    FILES = ("layout.json",)
    FOLDERS = ("frames", "truth")

    schema_id: Literal["mirrorcam.scene/1"] = Field(default="mirrorcam.scene/1", alias="schema")
    layout_identity: str
    depths_mm: tuple[Annotated[float, DEPTH_MM.limits], ...]
    meshes: tuple[tuple[str, str], ...] = Field(description="name and SHA-256 of the file of each mesh on the table")
    width_px: int = SENSOR_PX.field()
    height_px: int = SENSOR_PX.field()
    tolerances: Tolerances
    sensor: SensorModel
    spp: int = SAMPLES_PER_PIXEL.field()
    mirror_reflectance: float = Field(gt=0, le=1)
    renderer: str = Field(description="program, version and variant")
    central_view: tuple[_Index, _Index] = Field(description="row and column of the reference view")
    request: str
    files: dict[str, str] = Field(default_factory=dict, description="SHA-256 of each file, by its name in the set")

    @property
    def frame_name(self) -> str:
        """The name of the picture."""
        return "frames/0000" + (".png" if self.sensor.jpeg_quality is None else ".jpg")


def render_tabletop(request: TabletopRequest, out: Path, *, progress: Progress = no_progress) -> TabletopSet:
    """Render a tabletop scene via the mirrors of an as-built copy of a layout, with its ground truth.

    Parameters
    ----------
    request
        Inputs of the set; the same request gives the same bytes.
    out
        Folder for the set. Finished files of an interrupted run with the same request are kept.
    progress
        Called with the number of pictures done and the total, at the start, after the frame and after each true view.

    Returns
    -------
    TabletopSet
        The manifest.

    Raises
    ------
    InputError
        If no backend compiles the renderer, depths or meshes are invalid, views have no common field, or `out` contains
        anything else.
    """
    layout = request.layout
    if request.sensor.h264_crf is not None:
        raise InputError("a scene is one picture, expected a sensor without h264_crf")
    depths = request.depths_mm or default_depths_mm(layout)
    variant = use_variant(colour=True)
    built = draw_as_built(layout, request.tolerances, _random(request.seed, _AS_BUILT))
    built = built.replaced(camera=with_pupil_of(built.camera, request.sensor))
    seed = int(_random(request.seed, _ARRANGEMENT).integers(2**31))
    tabletop = arrange_tabletop(layout, depths, seed, request.meshes)
    check_meshes(layout, tabletop.objects)
    views = _views(built, default_reference_depth_mm(layout))
    manifest = _manifest(request, depths, variant)
    manifest = manifest.replaced(request=_request_digest(manifest, built, tabletop.objects, request.seed))
    truth = {(t, s): _truth_names(t, s, views.rows * views.cols) for t, s in np.ndindex(views.rows, views.cols)}
    pictures = (manifest.frame_name, MAPS, *(name for names in truth.values() for name in names.values()))
    manifest = manifest.resumed(out, (*FIRST_FILES, *pictures))

    def write_first(folder: Path) -> None:
        layout.save(folder / "layout.json")
        built.save(folder / "truth/layout.json")
        write_json(folder / "truth/things.json", _object_list(tabletop.objects, views, request.seed))

    manifest = manifest.added(out, write_first)
    total = 1 + len(truth)
    progress(0, total)
    built_with_true_lens = built.replaced(camera=true_camera(built.camera, request.sensor))
    scene = TabletopScene(built_with_true_lens, tabletop, request.mirror_reflectance, variant)
    if not {manifest.frame_name, MAPS} <= manifest.files.keys():
        picture, maps = _frame(scene, built, request)
        manifest = manifest.added(out, partial(write_files, files={MAPS: maps, manifest.frame_name: picture}))
    progress(1, total)
    mask_values = np.array([*(MASK[item.material] for item in tabletop.objects), MASK["nothing"]], dtype=np.uint8)
    for number, ((t, s), names) in enumerate(truth.items()):
        if not set(names.values()) <= manifest.files.keys():
            files = _true_view(scene, views, t, s, request, mask_values)
            named_files = {name: files[kind] for kind, name in names.items()}
            manifest = manifest.added(out, partial(write_files, files=named_files))
        progress(2 + number, total)
    return manifest


def _manifest(request: TabletopRequest, depths_mm: tuple[float, ...], variant: str) -> TabletopSet:
    """Return the manifest without its digest and files."""
    layout = request.layout
    return TabletopSet(
        layout_identity=layout.identity,
        depths_mm=depths_mm,
        meshes=tuple((mesh.file.name, digest(read_bytes(mesh.file))) for mesh in request.meshes),
        width_px=layout.camera.width_px,
        height_px=layout.camera.height_px,
        tolerances=request.tolerances,
        sensor=request.sensor,
        spp=request.spp,
        mirror_reflectance=request.mirror_reflectance,
        renderer=f"mitsuba {metadata.version('mitsuba')} {variant}",
        central_view=divmod(layout.central_index, layout.cols),
        request="",
    )


def read_map(path: Path, channel: str) -> FloatArray:
    """Read one channel (h, w) of an EXR file of the ground truth; raise InputError if it is missing."""
    import OpenEXR

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return np.array(file.channels()[channel].pixels, dtype=np.float64)
    except (RuntimeError, KeyError):
        raise InputError(f"{path}: not a readable EXR file with a channel {channel!r}") from None


def _truth_names(t: int, s: int, views: int) -> dict[str, str]:
    """Return the file names of a true view by kind; a single view has no disparity."""
    return {
        kind: f"truth/{kind}/{t}_{s}{suffix}" for kind, suffix in _KINDS.items() if kind != "disparity" or views > 1
    }


_KINDS = {"views": ".png", "depth": ".exr", "disparity": ".exr", "mask": ".png", "things": ".png"}


def default_depths_mm(layout: Layout) -> tuple[float, ...]:
    """Return the nearest and farthest design depth of a layout, and its plane of zero disparity in between."""
    middle_mm = default_reference_depth_mm(layout)
    if layout.spec is None:
        return 0.8 * middle_mm, middle_mm, 4.0 / 3.0 * middle_mm
    return tuple(sorted({min(layout.spec.depths_mm), middle_mm, max(layout.spec.depths_mm)}))


def _random(*key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(key))


def _views(built: Layout, reference_depth_mm: float) -> Views:
    """Return the views for decoding with the layout as built, with apparent mirrors for second-surface mirrors."""
    apparent = built.replaced(mirrors=tuple(mirror.apparent for mirror in built.mirrors))
    return replace(choose_views(apparent, reference_depth_mm, "common"), layout_identity=built.identity)


def _frame(scene: TabletopScene, layout: Layout, request: TabletopRequest) -> tuple[bytes, bytes]:
    """Return the files of the picture and of the ground-truth maps of its pixels."""
    seed = int(_random(request.seed, _FRAME).integers(2**32))
    rays = pixel_rays(scene.layout, mirrors=True)
    hits = scene.hits(rays.start, rays.direction)
    path = np.where(hits.object_index == NOTHING, np.nan, rays.path_before_mm + hits.path_mm)
    noise = _random(request.seed, _NOISE)
    picture = photographed(scene, layout, request.sensor, spp=request.spp, seed=seed, noise=noise)
    depth = _depth_mm(hits, layout.view_from_rig, miss_value=np.nan)
    maps = {"mirror": rays.mirror, "thing": hits.object_index + 1.0, "depth": depth, "path": path}
    quality = request.sensor.jpeg_quality
    encoded = encoded_image(picture, ".png") if quality is None else encoded_image(picture, ".jpg", quality)
    return encoded, exr_bytes(maps, {"layout": layout.identity, "units": "mm"})


def _depth_mm(hits: Hits, view_from_rig: FloatArray, *, miss_value: float) -> FloatArray:
    """Return the depths of hits in the frame of the views, and `miss_value` for rays without a hit."""
    nothing = hits.object_index == NOTHING
    return np.where(nothing, miss_value, np.where(nothing[..., None], 0.0, hits.points) @ view_from_rig[2])


def _true_view(
    scene: TabletopScene, views: Views, t: int, s: int, request: TabletopRequest, mask_values: NDArray[np.uint8]
) -> dict[str, bytes]:
    """Return the files of a true view by kind."""
    start_mm = clear_depth_mm(scene.layout)
    seed = int(_random(request.seed, _VIEWS, t, s).integers(2**32))
    radiance = scene.view(views, t, s, start_mm, spp=request.spp, seed=seed)
    grey = np.rint(radiance * np.float32(255.0 * request.mirror_reflectance * request.sensor.exposure))
    hits = scene.hits(*pinhole_rays(views, t, s, start_mm))
    depth = _depth_mm(hits, views.view_from_rig, miss_value=np.inf)
    counts = {"s": views.cols, "t": views.rows}
    disparity = {axis: views.disparity_px_from_depth(depth, axis) for axis in ("s", "t") if counts[axis] > 1}
    header = {"layout": scene.layout.identity, "view": f"{t}_{s}", "units": "mm, from the pupil along view z"}
    disparity_header = header | {"units": "px per mean view step, positive nearer than the reference plane"}
    files = {"disparity": exr_bytes(disparity, disparity_header)} if disparity else {}
    return files | {
        "views": encoded_image(np.clip(grey, 0, 255).astype(np.uint8), ".png"),
        "depth": exr_bytes({"depth": depth}, header),
        "mask": encoded_image(mask_values[hits.object_index], ".png"),
        "things": encoded_image((hits.object_index + 1).astype(np.uint8), ".png"),
    }


def _object_list(objects: tuple[SceneObject, ...], views: Views, seed: int) -> dict[str, object]:
    """Return the content of `truth/things.json`; labels in `truth/things` count from 1, in this order."""
    return {
        "seed": seed,
        "mask": MASK,
        "reference_depth_mm": views.reference_depth_mm,
        "view_px": [views.width_px, views.height_px],
        "focal_px": views.focal_px,
        "centre_px": views.centre_px.tolist(),
        "positions_mm": views.positions_mm.tolist(),
        "things": [
            item.model_dump(mode="json", by_alias=True, exclude_none=True, exclude={"file"}) for item in objects
        ],
    }


def _request_digest(manifest: TabletopSet, built: Layout, objects: tuple[SceneObject, ...], seed: int) -> str:
    """Return a digest (16 hexadecimal digits) of everything that determines the bytes of a set."""
    inputs = manifest.model_dump(mode="json", exclude={"request", "files"})
    things = [item.model_dump(mode="json", by_alias=True, exclude={"file"}) for item in objects]
    samples = {"seed": seed, "built": built.identity, "things": things}
    return value_digest(inputs | samples)[:16]
