"""Calibration of a mirror camera from frames through the mirrors, frames of the bare camera, and the nominal layout.

The board is detected in all pictures, and what they show is calibrated by `corner_calibration`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from mirrorcam.core.arguments import AnyPath, check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames
from mirrorcam.optics.calibration.detection.detections import DetectedFrame
from mirrorcam.optics.calibration.detection.frame_choice import most_telling
from mirrorcam.optics.calibration.detection.joint_numbering import numbered_together
from mirrorcam.optics.calibration.diagnostics.board_scale import other_size
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
)
from mirrorcam.optics.calibration.diagnostics.nested_models import additions_of
from mirrorcam.optics.calibration.diagnostics.unknown_mirrors import unknown_mirrors
from mirrorcam.optics.calibration.diagnostics.upside_down import fits_upside_down
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.calibration.taken_pictures import TakenPictures, checked_pictures
from mirrorcam.optics.calibration.whole_pupil import Pictures
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.targets import AprilGrid, Charuco, Checkerboard, Target

UPSIDE_DOWN = (
    "the pictures fit the layout only when they are turned by 180 deg: the camera is upside down in the device, or its "
    "pictures were turned; turn all of them"
)


def calibrate(
    frames: Iterable[Grey | AnyPath],
    base_frames: Iterable[Grey | AnyPath],
    layout: Layout,
    target: Target,
    *,
    level: str | None = None,
    extend: bool = False,
    lens: LensName | None = None,
    detections: AnyPath | None = None,
    workers: int = 1,
    most: tuple[int | None, int | None] = (None, None),
    names: tuple[Sequence[str], Sequence[str]] | None = None,
    on_frame: Callable[[int], None] = lambda done: None,
    on_seen: Callable[[Sequence[Observations]], None] = lambda seen: None,
) -> Calibration:
    """Calibrate a mirror camera from pictures of a board.

    Pictures are taken from the iterables one at a time, so that they need not fit into memory together.

    Parameters
    ----------
    frames
        Pictures of the board through the mirrors: grey values (h, w), or paths of picture files. A damaged file is
        left out, named in the notes and counted in the metrics.
    base_frames
        Pictures of the board by the camera without mirrors, likewise. Without any, the camera starts from that of
        `layout`, and the intrinsics rest on the mirrored views alone.
    layout
        Nominal layout: where to search for the board, and where to start.
    target
        The board.
    level
        Model to fit: `paper`, or `joint` with additions (`nested_models`). None selects the largest one that the
        pictures support.
    extend
        Whether further additions are made to the given model where the pictures support them, instead of an alarm.
    lens
        Lens model of the camera; None keeps the layout's, or a larger one that the pictures support.
    detections
        Folder that caches detected corners, so that no picture is searched twice.
    workers
        Number of threads that search pictures.
    most
        Number of pictures through the mirrors, and without them, to use of those searched; None: all.
    names
        Names of the pictures through the mirrors, and without them. Default: their numbers.
    on_frame
        Called with the number of pictures done.
    on_seen
        Called after each picture through the mirrors with all observations so far.

    Returns
    -------
    Calibration
        The calibrated layout, in the frame `rig` of the camera as it sits, in mm, with covariance and diagnostics.

    Raises
    ------
    InputError
        Where no pictures are given or the level is unknown, a picture cannot be read or has another size, or the
        pictures do not determine camera and mirrors.
    """
    check_type("layout", layout, Layout)
    check_type("target", target, Checkerboard, Charuco, AprilGrid)
    check_count("workers", workers, WORKERS)
    cache = None if detections is None else path_of("detections", detections)
    frames, base_frames = (checked_pictures(*given) for given in (("frames", frames), ("base_frames", base_frames)))
    detect = partial(detect_frames, layout=layout, target=target, folder=cache, workers=workers)
    taken = TakenPictures(layout.camera)

    def report(found: Sequence[DetectedFrame]) -> None:
        on_frame(len(found))
        on_seen([frame.corners for frame in found])

    if level is not None:
        additions_of(level)  # refused before pictures are searched
    found = detect(taken.read(frames, mirrored=True), mirrored=True, on_frame=report)
    pictures = taken.read(base_frames, mirrored=False)
    found_in_base = detect(pictures, mirrored=False, on_frame=lambda done: on_frame(len(found) + len(done)))
    if isinstance(target, Checkerboard):
        found = numbered_together(found, found_in_base, layout, target)
    size = target.corners_in_board_mm, layout.camera.width_px
    chosen = [_chosen(detected, number, *size) for detected, number in zip((found, found_in_base), most, strict=True)]
    seen, base = (
        [detected[number].corners for number in numbers]
        for detected, numbers in zip((found, found_in_base), chosen, strict=True)
    )
    # A board that is often partly out of view is found in few pictures: what is found anywhere is the stated one.
    shown = any(len(o) for o in seen), any(len(o) for o in base)
    taken.refuse_other_board(target, seen=shown[0], base=shown[1], fits=True)
    if taken.damaged and not any(map(len, seen)):
        raise InputError(f"{taken.damaged[0]}; no corner of the board found in other frames")
    try:
        calibration = calibrate_corners(
            seen,
            base,
            layout,
            target.corners_in_board_mm,
            level=level,
            extend=extend,
            lens=lens,
            extremes=taken.extremes,
            pictures=Pictures([taken.mirrored[number] for number in chosen[0]], target, workers),
            unknown=unknown_mirrors(layout, found),
            names=None if names is None else [of[n] for of, some in zip(names, chosen, strict=True) for n in some],
        )
    except InputError:
        # Unless it does not fit: parts of a checkerboard are taken for a smaller one here and there.
        taken.refuse_other_board(target, seen=shown[0], base=shown[1], fits=False)
        if other := other_size(taken.first(mirrored=True), layout, target):
            raise InputError(other) from None
        if fits_upside_down(seen, layout, target):
            raise InputError(UPSIDE_DOWN) from None
        raise
    return calibration.with_damaged_pictures(taken.damaged)


def _chosen(
    detected: Sequence[DetectedFrame], most: int | None, corners_in_board_mm: FloatArray, width_px: int
) -> Sequence[int]:
    """Numbers of the pictures to use."""
    if most is None or len(detected) <= most:
        return range(len(detected))
    boards = [
        [Corners(rows.corner[rows.view == view], rows.pixels[rows.view == view]) for view in np.unique(rows.view)]
        for rows in (frame.corners for frame in detected)
    ]
    return most_telling(boards, corners_in_board_mm, width_px=width_px, most=most)
