"""Folders of the 4D Light Field Benchmark (HCI Heidelberg and University of Konstanz; Honauer et al., ACCV 2016).

`input_Cam000.png` and following, row by row from the top left view; `parameters.cfg`; `gt_disp_lowres.pfm`, px per view
step, positive nearer than the focus distance; `gt_depth_lowres.pfm`, metres from the cameras. Views are pinholes with
shifted sensors on an even grid, with the principal point in the centre: disparity is zero at the focus distance, as in
`Views`.

Our light fields have a nearly even grid, and principal points anywhere. Other programs read the mean step and ignore
the section `mirrorcam` of `parameters.cfg`, which holds the exact geometry for `read_hci`.
"""

from __future__ import annotations

import json
import re
from configparser import ConfigParser, Error
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import read_bytes, write_text
from mirrorcam.core.disk.nested_text import json_value
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pfm import read_pfm, write_pfm
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.messages import shortened
from mirrorcam.optics.light_field.camera_array import central_view
from mirrorcam.optics.light_field.io.light_field_format import Contents, Format
from mirrorcam.optics.light_field.io.view_images import check_size, common_size
from mirrorcam.optics.light_field.io.views_file import views_of_fields
from mirrorcam.optics.light_field.light_field import Axis, LightField, Views

Float32 = NDArray[np.float32]

PARAMETERS = "parameters.cfg"
DISPARITY, DEPTH = "gt_disp_lowres.pfm", "gt_depth_lowres.pfm"
SECTION = "mirrorcam"
MAX_VIEWS, MAX_PICTURES = 1000, 100_000
"""Maximum number of rows or columns of views in a scene, and of views in total."""
MAX_BYTES = 300_000
"""Maximum size of the parameters: the benchmark's take 1 kB, a hundred of our exact views 10 kB."""
SENSOR_SIZE_MM = 35.0
"""Written as the longer side of the sensor; only its ratio to the focal length matters."""
_KEYS = {
    "intrinsics": ("image_resolution_x_px", "image_resolution_y_px", "focal_length_mm", "sensor_size_mm"),
    "extrinsics": ("num_cams_x", "num_cams_y", "baseline_mm", "focus_distance_m"),
}
_LONG_BLANK = re.compile(r"[^\S\n]{100}")
_COUNTS = ("image_resolution_x_px", "image_resolution_y_px", "num_cams_x", "num_cams_y")


@dataclass(frozen=True, eq=False)
class HciScene:
    """A scene of the benchmark: its light field and, if available, the central view's true disparity.

    Attributes
    ----------
    disparity_px
        Disparity (v, u), float32, px per view step, positive nearer than the reference plane; or None.
    disparity_range_px
        Minimum and maximum disparity of the scene as stated by its parameters, or None.
    """

    light_field: LightField
    disparity_px: Float32 | None
    disparity_range_px: tuple[float, float] | None

    @property
    def depth_mm(self) -> Float32 | None:
        """True depth (v, u) of the central view from the pupil, or None."""
        if self.disparity_px is None:
            return None
        axis: Axis = "s" if self.light_field.cols > 1 else "t"
        return self.light_field.depth_mm_from_disparity(self.disparity_px.astype(np.float64), axis).astype(np.float32)

    @property
    def depth_range_mm(self) -> tuple[float, float] | None:
        """Nearest and farthest depth as stated by the parameters, or None; infinite for disparities beyond infinity."""
        if self.disparity_range_px is None:
            return None
        axis: Axis = "s" if self.light_field.cols > 1 else "t"
        far, near = self.light_field.depth_mm_from_disparity(np.array(self.disparity_range_px), axis).tolist()
        return near, np.inf if np.isnan(far) else far


def write_hci(folder: Path, light_field: LightField, depth_mm: Float32 | None = None) -> None:
    """Write a light field, and the depth (v, u) of its reference view from the pupil, as a scene of the benchmark.

    Pictures have 8 bits. If some samples are missing, `mask_Cam000.png` and following mark the valid ones.
    """
    views, has_missing = light_field, not light_field.valid.all()
    samples: Any = light_field.samples
    if samples.dtype == np.float32:
        samples = np.rint(np.clip(samples, 0.0, 1.0) * np.float32(255.0)).astype(np.uint8)
    for number, (t, s) in enumerate(np.ndindex(views.rows, views.cols)):
        colours = np.broadcast_to(samples[t, s], (*samples.shape[2:4], 3))
        write_image(folder / f"input_Cam{number:03d}.png", np.ascontiguousarray(colours))
        if has_missing:
            mask = np.where(light_field.valid[t, s], 255, 0).astype(np.uint8)
            write_image(folder / f"mask_Cam{number:03d}.png", mask)
    if depth_mm is not None:
        reference_view_depth_mm = views.reference_view_depth_mm
        axis: Axis = "s" if views.cols > 1 else "t"
        write_pfm(
            folder / DISPARITY, views.disparity_px_from_depth(depth_mm.astype(np.float64), axis).astype(np.float32)
        )
        write_pfm(
            folder / DEPTH, ((depth_mm - np.float32(reference_view_depth_mm)) / np.float32(1000.0)).astype(np.float32)
        )
    # Write this file last: a folder without it is not a scene.
    write_text(folder / PARAMETERS, _parameters(views, samples.shape[-1], depth_mm))


def _parameters(views: Views, channels: int, depth_mm: Float32 | None) -> str:
    step_mm = views.step_mm("s" if views.cols > 1 else "t")
    distance_mm = views.reference_distance_mm
    depths_mm = np.array([views.reference_depth_mm]) if depth_mm is None else depth_mm[np.isfinite(depth_mm)]
    disparity = views.focal_px * step_mm * (1.0 / (depths_mm - views.reference_view_depth_mm) - 1.0 / distance_mm)
    parser = ConfigParser()
    parser.read_dict(
        {
            "intrinsics": {
                "image_resolution_x_px": views.width_px,
                "image_resolution_y_px": views.height_px,
                "focal_length_mm": repr(views.focal_px * SENSOR_SIZE_MM / max(views.width_px, views.height_px)),
                "sensor_size_mm": SENSOR_SIZE_MM,
                "fstop": 100.0,
            },
            "extrinsics": {
                "num_cams_x": views.cols,
                "num_cams_y": views.rows,
                "baseline_mm": repr(step_mm),
                "focus_distance_m": repr(distance_mm / 1000.0),
                **{f"center_cam_{name}_m": 0.0 for name in "xyz"},
                **{f"center_cam_r{name}_rad": 0.0 for name in "xyz"},
                "offset": repr(views.focal_px * step_mm / distance_mm),
            },
            "meta": {
                "scene": "light field",
                "category": "other",
                "date": "",
                "version": "v0",
                "authors": "MirrorCam",
                "contact": "",
                "disp_min": repr(float(np.floor(10.0 * disparity.min()) / 10.0)),
                "disp_max": repr(float(np.ceil(10.0 * disparity.max()) / 10.0)),
                "frustum_disp_min": repr(float(disparity.min())),
                "frustum_disp_max": repr(float(disparity.max())),
                "depth_map_scale": 1.0,
            },
            SECTION: {
                "channels": channels,
                "positions_mm": json.dumps(views.positions_mm.tolist()),
                "focal_px": repr(views.focal_px),
                "centre_px": json.dumps(views.centre_px.tolist()),
                "reference_depth_mm": repr(views.reference_depth_mm),
                "reference_view_in_rig_mm": json.dumps(views.reference_view_in_rig_mm.tolist()),
                "view_from_rig": json.dumps(views.view_from_rig.tolist()),
                "layout_identity": views.layout_identity,
            },
        }
    )
    text = StringIO()
    parser.write(text)
    return text.getvalue()


def read_hci(folder: Path, *, every: int = 1) -> HciScene:
    """Read a scene's light field, and the true disparity of its central view if available.

    Depths are measured from the central view, as nothing else is known. `every` selects every n-th view in both
    directions, including the central one; disparities are then per step of the selected views.

    Raises a one-line InputError for missing files, pictures of a different size, or a grid without a central view.
    """
    path = folder / PARAMETERS
    parser = ConfigParser(interpolation=None)
    raw = read_bytes(path, MAX_BYTES)
    try:
        text = raw.decode("utf-8")
        if _LONG_BLANK.search(text):  # the parser would search for the end of a name from each position
            raise ValueError("a hundred blanks in a row")
        parser.read_string(text)
        numbers = {key: parser.getfloat(section, key) for section, keys in _KEYS.items() for key in keys}
        disparity_limits = [every * parser.getfloat("meta", name, fallback=np.nan) for name in ("disp_min", "disp_max")]
    except (Error, ValueError, AttributeError) as error:  # AttributeError: a continued line without a value
        reason = " ".join(str(error).split())
        raise InputError(shortened(f"{path}: not the parameters of a light field: {reason}")) from None
    # A scene focused at infinity has zero disparity there.
    limits = {key: MAX_VIEWS if key.startswith("num_cams") else 1e6 for key in numbers} | {"focus_distance_m": np.inf}
    invalid = next((key for key, value in numbers.items() if not 0 < value <= limits[key]), None)
    invalid = invalid or next((key for key in _COUNTS if not numbers[key].is_integer()), None)
    if invalid is not None:
        kind = "positive whole number" if invalid in _COUNTS else "positive number"
        raise InputError(f"{path}: {invalid} is {numbers[invalid]:g}, expected a {kind} up to {limits[invalid]:g}")
    width, height, cols, rows = (int(numbers[key]) for key in _COUNTS)
    if cols * rows > MAX_PICTURES:
        raise InputError(f"{path}: {cols}x{rows} views, expected at most {MAX_PICTURES}")
    if every < 1 or (cols // 2) % every or (rows // 2) % every:
        raise InputError(f"{folder}: {cols}x{rows} views, but every {every}th must include the central one")
    views = _our_views(parser, path, (width, height)) if parser.has_section(SECTION) else _even_views(numbers)
    if (views.rows, views.cols) != (rows, cols):
        raise InputError(f"{path}: {views.cols}x{views.rows} positions for {cols}x{rows} views")
    selected = [(t, s) for t in range(0, rows, every) for s in range(0, cols, every)]
    files = [folder / f"input_Cam{t * cols + s:03d}.png" for t, s in selected]
    common_size(files)
    pictures = [_picture(file, (width, height)) for file in files]
    masks = [folder / f"mask_Cam{t * cols + s:03d}.png" for t, s in selected]
    weights = np.ones((len(selected), height, width), np.float32)
    for weight, mask in zip(weights, masks, strict=True):
        if mask.exists():
            weight[:] = _picture(mask, (width, height), grey=True) > 0
    grid = (len(range(0, rows, every)), len(range(0, cols, every)))
    channels = {"1": 1, "3": 3}.get(parser.get(SECTION, "channels", fallback="3"))
    if channels is None:
        raise InputError(f"{path}: section {SECTION!r}: channels is neither 1 nor 3")
    samples = np.stack(pictures).reshape(*grid, height, width, 3)[..., :channels]
    selected_views = replace(views, positions_mm=views.positions_mm[::every, ::every])
    light_field = LightField.of(selected_views, np.ascontiguousarray(samples), weights.reshape(*grid, height, width))
    disparity_range = (disparity_limits[0], disparity_limits[1]) if disparity_limits[0] < disparity_limits[1] else None
    if not (folder / DISPARITY).exists():
        return HciScene(light_field, None, disparity_range)
    disparity = read_pfm(folder / DISPARITY)
    if disparity.shape != (height, width):
        raise InputError(f"{folder / DISPARITY}: {disparity.shape[1]}x{disparity.shape[0]}, expected {width}x{height}")
    return HciScene(light_field, disparity * np.float32(every), disparity_range)


def _picture(path: Path, size: tuple[int, int], *, grey: bool = False) -> NDArray[np.uint8]:
    picture = read_image(path, grey=grey)
    check_size(path, picture, size)
    return picture


def _even_views(numbers: dict[str, float]) -> Views:
    """Build the views that the benchmark's parameters describe."""
    width, height, cols, rows = (int(numbers[key]) for key in _COUNTS)
    step_mm, distance_mm = numbers["baseline_mm"], 1000.0 * numbers["focus_distance_m"]
    central_row, central_col = central_view(rows, cols)
    offsets = np.stack(np.meshgrid(np.arange(cols) - central_col, np.arange(rows) - central_row), axis=-1) * step_mm
    return Views(
        positions_mm=np.concatenate([offsets, np.zeros((rows, cols, 1))], axis=-1),
        focal_px=numbers["focal_length_mm"] / numbers["sensor_size_mm"] * max(width, height),
        centre_px=np.array([(width - 1) / 2.0, (height - 1) / 2.0]),
        width_px=width,
        height_px=height,
        reference_depth_mm=distance_mm,
        reference_view_in_rig_mm=np.zeros(3),
        view_from_rig=np.eye(3),
        layout_identity="",
    )


def _our_views(parser: ConfigParser, path: Path, size: tuple[int, int]) -> Views:
    """Build the views from the section that `write_hci` wrote."""
    section = parser[SECTION]
    arrays = ("positions_mm", "centre_px", "reference_view_in_rig_mm", "view_from_rig")
    try:
        fields: dict[str, Any] = {
            **section,
            **{name: json_value(section[name].encode()) for name in arrays if name in section},
            **{name: float(section[name]) for name in ("focal_px", "reference_depth_mm") if name in section},
        }
    except ValueError as error:
        raise InputError(shortened(f"{path}: section {SECTION!r}: does not describe views: {error}")) from None
    return views_of_fields({**fields, "width_px": size[0], "height_px": size[1]}, f"{path}: section {SECTION!r}")


def _contents(folder: Path) -> Contents:
    scene = read_hci(folder)
    return Contents((scene.light_field,), scene.depth_mm, scene.depth_range_mm)


FORMAT = Format(
    name="hci",
    ending="_hci",
    detect=lambda path: (path / PARAMETERS).exists(),
    read=lambda path, assumed: _contents(path),
    write=lambda path, light_field, depth: write_hci(path, light_field, None if depth is None else depth.depth_mm),
    needs_grid=True,
)
