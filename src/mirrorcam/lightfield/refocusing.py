"""Pictures of light fields as files: refocused, all in focus, from new viewpoints, and animations."""

from __future__ import annotations

import glob
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import write_npz
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.video.animation import write_loop
from mirrorcam.lightfield.depth_maps import record_depth, stored_depth, write_depth
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, NamedLightField, RecordingFilter
from mirrorcam.lightfield.requests import RefocusRequest
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.perspective import all_in_focus, insert_views, orbit, render_view
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, RenderedPicture, aperture, refocus, to_bytes
from mirrorcam.optics.light_field.render.view_depths import ViewDepths, remove_nearer

ORBIT_PICTURES, ORBIT_HZ = 36, 20.0
SWEEP_PICTURES, SWEEP_HZ = 24, 12.0
# Default ends of a sweep, as multiples of the reference depth.
NEAR, FAR = 0.75, 2.0
MIN_REPORTED_GREY = 0.01
"""Fraction of a picture without data from any view above which it is reported."""


@dataclass(frozen=True)
class GreyPicture:
    """A picture that is partly grey: its name, and the fraction that no view covers."""

    name: str
    hidden: float


@dataclass(frozen=True)
class UsedDepth:
    """The depth map with which pictures of a light field were rendered.

    Attributes
    ----------
    path
        The file of the depth map.
    searched_mm
        Nearest and farthest depth of the search, mm.
    measured
        Whether it was estimated in this run.
    """

    name: str
    path: Path
    searched_mm: tuple[float, float]
    measured: bool


@dataclass(frozen=True)
class Refocused:
    """The pictures that are partly grey, and the depth maps that were used."""

    grey: tuple[GreyPicture, ...]
    depths: tuple[UsedDepth, ...]


def write_refocused(
    inputs: LightFieldInputs,
    folder: Path,
    request: RefocusRequest = RefocusRequest(),
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> Refocused:
    """Write the requested pictures and animations of every light field into a folder.

    Depth, if needed, is read from NAME_depth.npz in the folder if it was estimated in the same light field, else
    estimated and kept there. `force` also replaces files that it did not write.
    """
    grey, used = [], []
    recording = RecordingFilter()
    with output_folder(folder, "refocus", force=force) as output:
        for named in inputs.open_all(progress):
            names = endings(named.light_field, request)
            output.refuse_others(*(f"{glob.escape(named.name)}_{ending}" for ending in names))
            with output.staged(complete=False) as staged:
                depths = None
                if request.needs_depth:
                    depth, depths = _read_or_estimate_depths(named, recording.filtered(named), output, staged, request)
                    used.append(depth)
                grey += _write_pictures(named, depths, staged, request)
            if depths is not None and used[-1].measured:
                record_depth(output, named.name, named.light_field, used[-1].searched_mm)
    return Refocused(tuple(grey), tuple(used))


def _read_or_estimate_depths(
    named: NamedLightField, filtered: LightField, output: OutputFolder, staged: Path, request: RefocusRequest
) -> tuple[UsedDepth, ViewDepths]:
    """Read the stored depth map, or estimate it in the filtered light field and store it."""
    light_field = named.light_field
    near, far = named.depths_to_search(request.near_mm, request.far_mm)
    stored, name = stored_depth(output.path, named.name, light_field, near, far), f"{named.name}_depth.npz"
    if stored is None or output.has_written(name):
        output.refuse_others(glob.escape(name))
    if stored is not None:
        used = UsedDepth(named.name, stored.path, stored.searched_mm, measured=False)
        return used, ViewDepths.of_reference(light_field, stored.depth_mm)
    estimator = DepthEstimator(light_field, near_mm=near, far_mm=far)
    depth = estimator.estimate(filtered)
    searched = (estimator.near_mm, estimator.far_mm)
    write_depth(staged, named.name, depth, light_field, searched)
    used = UsedDepth(named.name, output.path / name, searched, measured=True)
    return used, ViewDepths.of_reference(light_field, depth.depth_mm)


def _write_pictures(
    named: NamedLightField, depths: ViewDepths | None, folder: Path, request: RefocusRequest
) -> list[GreyPicture]:
    light_field, name = named.light_field, named.name
    if depths is not None and request.behind_mm is not None:
        light_field = remove_nearer(light_field, depths, request.behind_mm)
    grey = []
    for title, picture in stills(light_field, depths, request):
        _save_picture(folder / f"{name}_{title}.npz", picture, light_field.layout_identity)
        write_image(folder / f"{name}_{title}.png", to_bytes(picture))
        hidden = float(1.0 - picture.valid.mean())
        if hidden > MIN_REPORTED_GREY:
            grey.append(GreyPicture(f"{name}_{title}", hidden))
    if depths is not None and request.orbit is not None:
        viewpoints = list(orbit(light_field, ORBIT_PICTURES))
        pictures = [to_bytes(render_view(light_field, depths, position_mm)) for position_mm in viewpoints]
        write_loop(folder / f"{name}_orbit.{request.orbit}", pictures, ORBIT_HZ)
    if request.sweep is not None:
        dense = _with_inserted_views(light_field, depths, request)
        pictures = _focal_sweep(dense, request, *named.depths_to_search(request.near_mm, request.far_mm))
        write_loop(folder / f"{name}_sweep.{request.sweep}", pictures + pictures[-2:0:-1], SWEEP_HZ)
    return grey


def focused(light_field: LightField, request: RefocusRequest, depth_mm: float) -> RenderedPicture:
    """Return the picture focused at a depth."""
    return refocus(
        light_field,
        FocalPlane.at_depth(light_field, depth_mm, request.tilt_deg),
        combine="median" if request.combine == "median" else "mean",
        view_weights=aperture(light_field) if request.combine == "weighted" else None,
        scale=request.scale,
    )


def _depths_mm(light_field: LightField, request: RefocusRequest) -> tuple[float, ...]:
    """Return the depths to focus on."""
    others = request.all_in_focus or request.from_mm or request.orbit or request.sweep
    return request.depth_mm or (() if others else (light_field.reference_depth_mm,))


def endings(light_field: LightField, request: RefocusRequest) -> list[str]:
    """Return the endings of the file names of a light field."""
    titles = [f"focus_{depth_mm:g}mm" for depth_mm in _depths_mm(light_field, request)]
    titles += ["all_in_focus"] if request.all_in_focus else []
    titles += ["from"] if request.from_mm is not None else []
    loops = {"orbit": request.orbit, "sweep": request.sweep}
    return [
        *(f"{title}.{ending}" for title in titles for ending in ("npz", "png")),
        *(f"{title}.{ending}" for title, ending in loops.items() if ending is not None),
    ]


def stills(
    light_field: LightField, depths: ViewDepths | None, request: RefocusRequest
) -> Iterator[tuple[str, RenderedPicture]]:
    """Yield the requested pictures, each with the ending of its name."""
    if planes := _depths_mm(light_field, request):
        dense = _with_inserted_views(light_field, depths, request)
        for depth_mm in planes:
            yield f"focus_{depth_mm:g}mm", focused(dense, request, depth_mm)
    if depths is not None and request.all_in_focus:
        yield "all_in_focus", all_in_focus(light_field, depths)
    if depths is not None and request.from_mm is not None:
        yield "from", render_view(light_field, depths, np.array([*request.from_mm, 0.0]))


def _with_inserted_views(light_field: LightField, depths: ViewDepths | None, request: RefocusRequest) -> LightField:
    """Return the views to average, with interpolated views between them if requested."""
    if depths is None or not request.between:
        return light_field
    return insert_views(light_field, depths, request.between)


def _focal_sweep(
    light_field: LightField, request: RefocusRequest, near_mm: float | None, far_mm: float | None
) -> list[NDArray[np.uint8]]:
    """Return pictures focused from near to far, in equal steps of 1 / depth."""
    reference = light_field.reference_depth_mm
    ends = 1.0 / (near_mm or NEAR * reference), 1.0 / (far_mm or FAR * reference)
    depths_mm = [float(1.0 / q) if q > 0 else np.inf for q in np.linspace(*ends, SWEEP_PICTURES)]
    return [to_bytes(focused(light_field, request, depth_mm)) for depth_mm in depths_mm]


def _save_picture(path: Path, picture: RenderedPicture, layout_identity: str) -> None:
    identity = np.array(layout_identity)
    write_npz(path, {"image": picture.image, "weights": picture.weights, "layout_identity": identity})
