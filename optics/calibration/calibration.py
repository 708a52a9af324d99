"""Calibration of a mirror camera from frames through the mirrors, frames of the bare camera, and the nominal layout.

The board is detected in all pictures, and what they show is calibrated by `corner_calibration`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from mirrorcam.core.arguments import AnyPath, check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import agree_on_bits, check_size, read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames
from mirrorcam.optics.calibration.detection.detections import DetectedFrame
from mirrorcam.optics.calibration.detection.frame_choice import most_telling
from mirrorcam.optics.calibration.detection.joint_numbering import numbered_together
from mirrorcam.optics.calibration.detection.other_boards import MOST_PICTURES, other_board
from mirrorcam.optics.calibration.detection.segmentation import Extremes
from mirrorcam.optics.calibration.diagnostics.board_scale import other_size
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
)
from mirrorcam.optics.calibration.diagnostics.layout_misfit import fits_upside_down, unknown_mirrors
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.pupil_estimate import BoardPictures
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import AprilGrid, Charuco, Checkerboard, Target

UPSIDE_DOWN = (
    "the pictures fit the layout only when they are turned by 180 deg: the camera is upside down in the device, or its "
    "pictures were turned; turn all of them"
)
MOST_KEPT = 24  # arrays of an iterator, so that memory stays flat


def calibrate(
    frames: Iterable[Grey | AnyPath],
    base_frames: Iterable[Grey | AnyPath],
    layout: Layout,
    target: Target,
    *,
    model: RequestedModel = AUTO,
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
    model
        Model to fit, as `RequestedModel.parse("fisheye+bend")`. Default: the largest one that the pictures support.
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
        Where no pictures are given, a picture cannot be read or has another size, or the
        pictures do not determine camera and mirrors.
    """
    check_type("layout", layout, Layout)
    check_type("target", target, Checkerboard, Charuco, AprilGrid)
    check_count("workers", workers, WORKERS)
    cache = None if detections is None else path_of("detections", detections)
    model.check_mirrored()
    frames, base_frames = (checked_pictures(*given) for given in (("frames", frames), ("base_frames", base_frames)))
    detect = partial(detect_frames, layout=layout, target=target, folder=cache, workers=workers)
    taken = PictureReader(layout.camera)

    def report(found: Sequence[DetectedFrame]) -> None:
        on_frame(len(found))
        on_seen([frame.corners for frame in found])

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
            model=model,
            extremes=taken.extremes,
            pictures=BoardPictures([taken.mirrored[number] for number in chosen[0]], target, workers),
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


def checked_pictures(name: str, pictures: Iterable[Grey | AnyPath]) -> Iterable[Grey | Path]:
    """Pictures with paths as `Path`; a sequence stays one. Raises TypeError for what is no iterable of them.

    Raises InputError for an array of anything but grey values.
    """
    if isinstance(pictures, str | os.PathLike | np.ndarray) or not isinstance(pictures, Iterable):
        raise TypeError(f"{name}: {type(pictures).__name__}, expected an iterable of arrays or paths")

    def checked(picture: Grey | AnyPath) -> Grey | Path:
        if not isinstance(picture, np.ndarray):
            return path_of(name, picture)
        if picture.dtype != np.uint8 or picture.ndim != 2:
            raise InputError(
                f"{name}: an array {picture.shape} of {picture.dtype}, expected (h, w) of uint8, grey values"
            )
        return picture

    return [checked(each) for each in pictures] if isinstance(pictures, Sequence) else map(checked, pictures)


class PictureReader:
    """Pictures that are read one at a time: those that are damaged, the first ones, and the extremes of those mirrored.

    Attributes
    ----------
    damaged
        What is wrong with each damaged file so far.
    extremes
        Extremes of the pictures through the mirrors so far.
    mirrored
        The pictures through the mirrors so far; None for a damaged one, and for an array that only an iterator holds
        once `MOST_KEPT` of them are kept.
    """

    def __init__(self, camera: Camera) -> None:
        self.damaged: list[DamagedPicture] = []
        self.extremes = Extremes()
        self.mirrored: list[Grey | Path | None] = []
        self._arrays = 0
        self._camera = camera
        self._first: dict[bool, list[Grey]] = {True: [], False: []}

    def read(self, pictures: Iterable[Grey | Path], *, mirrored: bool) -> Iterator[Grey | None]:
        """Return the grey values of pictures, None for each file that is damaged.

        Raises InputError for a file of another size than the camera's.
        """
        held = isinstance(pictures, Sequence)
        if held:
            agree_on_bits([each for each in pictures if isinstance(each, Path)])
        for picture in pictures:
            grey = self._grey(picture)
            yield grey
            # Once the next one is requested, this one was found to have the expected size.
            if mirrored:
                keep = held or isinstance(picture, Path) or self._arrays < MOST_KEPT
                self._arrays += not isinstance(picture, Path)
                self.mirrored.append(picture if grey is not None and keep else None)
            if grey is None:
                continue
            if mirrored:
                self.extremes.add(grey)
            if len(self._first[mirrored]) < MOST_PICTURES:
                self._first[mirrored].append(grey)

    def first(self, *, mirrored: bool) -> Sequence[Grey]:
        """The first pictures, up to `MOST_PICTURES`, through the mirrors or without them."""
        return self._first[mirrored]

    def refuse_other_board(self, target: Target, *, seen: bool, base: bool, fits: bool) -> None:
        """Raise InputError where the first pictures show another board than the stated one.

        `seen` and `base` are whether that was found in any picture through the mirrors, and without them, and `fits`
        whether what was found fits as far as is known.
        """
        for mirrored, found in ((False, base), (True, seen)):
            other = other_board(
                self._first[mirrored], target, mirrored=mirrored, found=seen or base, fits=fits and found
            )
            if other is not None:
                raise InputError(other)

    def _grey(self, picture: Grey | Path) -> Grey | None:
        if not isinstance(picture, Path):
            return picture
        try:
            grey = read_image(picture, grey=True)
        except DamagedPicture as error:
            self.damaged.append(error)
            return None
        size = (self._camera.width_px, self._camera.height_px)
        check_size(picture, (grey.shape[1], grey.shape[0]), size, "the layout's camera")
        return grey
