"""The pupil in a calibration: estimated from the frames, and corners of which mirrors serve only a part of it left out.

Where a mirror serves a part of the pupil, a corner out of focus is seen from the middle of that part, and light fades
across it: it is found beside its place, by .1 px and more. There are few such corners, and they are not needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.detection.border_light import BoardFrame, border_light
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.pupil_blur import SeenPupil, seen_pupil
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil, served_through
from mirrorcam.optics.geometry.targets import Target

MARGIN_PX = 9.0
"""Between a corner and where the mirror begins to serve the whole pupil: the picture around it counts too."""

MIN_KEPT = 1.0 / 3.0
"""Part of a mirror's corners that must be left, or all of them are kept."""

MOST_FRAMES = 24
"""Frames that tell the pupil: more would not tell more of it."""

PASSES = 2
"""Estimates of the pupil, each with what rays through the parts of the last one show."""


@dataclass(frozen=True)
class Pictures:
    """Pictures through the mirrors, in the order of their frames (None: not at hand), of a board.

    `workers` is the number of threads that look at them.
    """

    frames: Sequence[Grey | Path | None]
    target: Target
    workers: int = 1

    def placed(self, numbers: Sequence[int], rig_from_board: FloatArray) -> list[BoardFrame]:
        """Up to `MOST_FRAMES` pictures at hand of the numbers, with the poses (n, 4, 4) of their boards."""
        pairs = ((self.frames[number], pose) for number, pose in zip(numbers, rig_from_board, strict=False))
        return [BoardFrame(picture, pose) for picture, pose in pairs if picture is not None][:MOST_FRAMES]


@dataclass(frozen=True)
class EstimatedPupil:
    """The camera with the pupil that frames show, as far as they show it, figures of it and a note."""

    camera: Camera
    metrics: dict[str, Metric]
    note: str


def estimated_pupil(layout: Layout, frames: Sequence[BoardFrame], target: Target) -> EstimatedPupil:
    """The pupil of a layout's camera from frames; where they do not show it, what the camera says of it is kept.

    Parameters
    ----------
    layout
        A layout whose camera, mirror planes and outlines are right.
    frames
        Frames through its mirrors.
    target
        The board.
    """
    seen, trial = _seen(layout, frames, target), layout
    for _ in range(PASSES - 1):
        if seen is not None:
            trial = layout.replaced(camera=_with_pupil(layout.camera, seen))
            seen = _seen(trial, frames, target)
    if seen is None:
        return EstimatedPupil(layout.camera, {}, _unseen(layout.camera))
    camera = _with_pupil(layout.camera, seen)
    metrics = {
        "aperture_mm": Metric(value=seen.aperture_mm, unit="mm"),
        "aperture_sigma_mm": Metric(value=seen.aperture_sigma_mm, unit="mm"),
    }
    if seen.shows_focus:
        metrics["focus_mm"] = Metric(value=camera.focus_mm, unit="mm")
        metrics["focus_sigma_per_m"] = Metric(value=1e3 * seen.nearness_sigma, unit="1/m")
    return EstimatedPupil(camera, metrics, _told(seen, camera))


def _seen(layout: Layout, frames: Sequence[BoardFrame], target: Target) -> SeenPupil | None:
    return seen_pupil(layout, border_light(layout, frames, target))


def _with_pupil(camera: Camera, seen: SeenPupil) -> Camera:
    if seen.is_pinhole:
        return camera.with_pupil(Pupil(0.0, camera.focus_mm))
    focus_mm = float(np.clip(1.0 / seen.nearness, DEPTH_MM.least, DEPTH_MM.most))
    return camera.with_pupil(Pupil(seen.aperture_mm, focus_mm if seen.shows_focus else camera.focus_mm))


def _unseen(camera: Camera) -> str:
    given = f"{camera.aperture_mm:g} mm wide and in focus at {camera.focus_mm:g} mm"
    kept = given if camera.aperture_mm > 0.0 else "a pinhole"
    return f"the frames do not show the blur of enough mirrors' edges to tell the pupil: {kept}, as in the layout"


def _told(seen: SeenPupil, camera: Camera) -> str:
    width = f"the pupil is {seen.aperture_mm:.2f} ± {seen.aperture_sigma_mm:.2f} mm wide"
    edges = f"by the blur of {seen.borders} mirror edges"
    if seen.is_pinhole:
        return f"{width}, {edges}: a pinhole, and the distance in focus cannot be told"
    per_m, sigma_per_m = 1e3 * seen.nearness, 1e3 * seen.nearness_sigma
    if seen.shows_focus:
        return f"{width} and in focus at {camera.focus_mm:.0f} mm ({per_m:.2f} ± {sigma_per_m:.2f} per metre), {edges}"
    return f"{width}, {edges}; they do not tell the distance in focus, which is the layout's {camera.focus_mm:g} mm"


def wholly_served(layout: Layout, observations: Observations) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Mask (n,) of the corners of which the whole pupil is served, by `MARGIN_PX`, and notes.

    Corners of the bare camera are, and so are all of a pinhole's.
    """
    kept = np.ones(len(observations), dtype=np.bool_)
    if layout.camera.aperture_mm == 0.0:
        return kept, ()
    notes = []
    for index, mirror in enumerate(layout.mirrors):
        rows = np.flatnonzero(observations.view == index)
        whole = _beyond_px(layout.camera, mirror, observations.pixels[rows]) > MARGIN_PX
        if whole.sum() < MIN_KEPT * len(rows):
            name = layout.mirror_names[index]
            notes.append(f"mirror {name}: hardly any corner is seen by the whole pupil, all are used")
        else:
            kept[rows] = whole
    few = np.bincount(observations.frame, weights=kept, minlength=1) < MIN_CORNERS
    kept |= few[observations.frame]
    left_out = int((~kept).sum())
    if left_out:
        notes.append(f"{left_out} of {len(kept)} corners left out: near mirrors' edges, which the pupil sees partly")
    return kept, tuple(notes)


def _beyond_px(camera: Camera, mirror: Mirror, pixels: FloatArray) -> FloatArray:
    """Distance (n,) of pixels from where the mirror begins to serve the whole pupil, inwards."""

    def inside_mm(at: FloatArray) -> FloatArray:
        return served_through(mirror, camera.normalized_from_pixels(at), camera.focus_mm).distance

    here = inside_mm(pixels)
    slope = np.hypot(*(inside_mm(pixels + step) - here for step in np.eye(2)))
    return np.asarray(((here - camera.pupil.radius_mm) / slope).min(axis=1))
