"""Calibration of a mirror camera from frames via the mirrors, frames of the bare camera, and the nominal layout.

The board is detected in all pictures; `corner_calibration` then fits the detected corners.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from mirrorcam.core.arguments import AnyPath, check_callable, check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import check_size, read_image, set_common_bit_depth
from mirrorcam.core.progress import Progress, Step, Steps, no_progress, no_step
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners, check_names
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames
from mirrorcam.optics.calibration.detection.detections import DetectedFrame
from mirrorcam.optics.calibration.detection.frame_choice import most_informative
from mirrorcam.optics.calibration.detection.joint_numbering import number_jointly
from mirrorcam.optics.calibration.detection.other_boards import FLIPPED, MAX_PICTURES, other_board, surely_other_board
from mirrorcam.optics.calibration.detection.segmentation import Extremes
from mirrorcam.optics.calibration.diagnostics.board_scale import wrong_size_message
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
)
from mirrorcam.optics.calibration.diagnostics.layout_misfit import fits_upside_down, unknown_mirrors
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.lateral_colour_estimate import colour_pictures, estimated_lateral_colour
from mirrorcam.optics.calibration.pupil_estimate import BoardPictures
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

UPSIDE_DOWN = (
    "the pictures fit the layout only when rotated by 180 deg: the camera is upside down in the device, or its "
    "pictures were rotated; rotate all of them"
)
EXCHANGED = "the pictures via the mirrors and those without them are exchanged, as the board's markers show: swap them"
SOLUTION_STEPS = 5
"""Steps of the solution of a model without additions, with that before the first."""
SAMPLE = 4
"""Pictures in which another board is searched before the stated one is searched in all."""
MAX_CHANNELS = 4  # of a single picture (h, w, channels), to tell it from a stack (n, h, w)
MAX_KEPT = 24  # arrays kept from an iterator, so that memory use stays bounded


def calibrate(
    frames: Iterable[Grey | AnyPath],
    base_frames: Iterable[Grey | AnyPath],
    layout: Layout,
    board: CalibrationBoard,
    *,
    model: RequestedModel | str = AUTO,
    detections: AnyPath | None = None,
    workers: int = 1,
    max_pictures: tuple[int | None, int | None] = (None, None),
    names: tuple[Sequence[str], Sequence[str]] | None = None,
    progress: Progress = no_progress,
    on_observations: Callable[[Sequence[Observations]], None] = lambda observations: None,
    on_step: Step = no_step,
) -> Calibration:
    """Calibrate a mirror camera from pictures of a board.

    Pictures are read one at a time, so they need not fit into memory together.

    Parameters
    ----------
    frames
        Pictures of the board in the mirrors: grey values (h, w) or paths of picture files, or a stack (n, h, w) of
        grey values, uint8. A damaged file is skipped, named in the notes and counted in the metrics.
    base_frames
        Pictures of the board taken by the camera without mirrors, in the same forms. If empty, the fit starts from the
        camera of `layout` and estimates the intrinsics from the mirrored views alone.
    layout
        Nominal layout: where to search for the board, and the starting point of the fit.
    board
        The board.
    model
        Model to fit: a `RequestedModel`, or its words, such as "fisheye+bend". Default: the largest that the pictures
        support.
    detections
        Folder that caches detected corners, so that each picture is searched only once.
    workers
        Number of detection threads.
    max_pictures
        Maximum number of pictures via the mirrors, and without them; None uses all.
    names
        Names of the pictures via the mirrors, and without them. Default: their numbers.
    progress
        Called with the number of steps done and the number expected: a step per picture searched, where pictures of an
        iterator count once they are read, and a few for the solution.
    on_observations
        Called after each picture via the mirrors with all observations so far.
    on_step
        Called with each step of the solution in words.

    Returns
    -------
    Calibration
        The calibrated layout in the rig frame, which is the camera's, in mm, with covariance and diagnostics.

    Raises
    ------
    InputError
        If no pictures are given, a picture cannot be read or has the wrong size, or the pictures do not determine the
        camera and the mirrors.
    """
    check_type("layout", layout, Layout)
    check_type("board", board, Checkerboard, Charuco, AprilGrid)
    check_count("workers", workers, WORKERS)
    check_callable("progress", progress)
    cache = None if detections is None else path_of("detections", detections)
    model = RequestedModel.parse(model)
    model.check_mirrored()
    frames, base_frames = (checked_pictures(*pair) for pair in (("frames", frames), ("base_frames", base_frames)))
    detect = partial(detect_frames, layout=layout, board=board, folder=cache, workers=workers)
    reader = PictureReader(layout.camera)

    counted = [len(pictures) for pictures in (frames, base_frames) if isinstance(pictures, Sequence)]
    steps = Steps(progress, sum(counted) + SOLUTION_STEPS)

    def report(detected: Sequence[DetectedFrame]) -> None:
        steps.advance()
        on_observations([frame.corners for frame in detected])

    other = other_board_in_sample(base_frames, board, mirrored=False)
    if other in (None, FLIPPED):
        other_in_mirrors = other_board_in_sample(frames, board, mirrored=True)
        other = EXCHANGED if other and other_in_mirrors == FLIPPED else other or other_in_mirrors
    if other:
        raise InputError(other)
    mirrored_detected = detect(reader.read(frames, mirrored=True), mirrored=True, on_frame=report)
    if not mirrored_detected:
        raise InputError("frames: no pictures given")
    base_detected = detect(reader.read(base_frames, mirrored=False), mirrored=False, on_frame=steps.advance)
    if names is not None:
        for group, found in zip(names, (mirrored_detected, base_detected), strict=True):
            check_names(group, len(found))
    if isinstance(board, Checkerboard):
        mirrored_detected = number_jointly(mirrored_detected, base_detected, layout, board)
    size = board.corners_in_board_mm, layout.camera.width_px
    chosen = [
        chosen_frames(detected, number, *size)
        for detected, number in zip((mirrored_detected, base_detected), max_pictures, strict=True)
    ]
    mirrored, base = (
        [detected[number].corners for number in numbers]
        for detected, numbers in zip((mirrored_detected, base_detected), chosen, strict=True)
    )
    # A board that is often partly out of view is found in few pictures only, so one detection confirms it.
    board_found = any(len(o) for o in mirrored), any(len(o) for o in base)
    reader.check_board(board, mirrored=board_found[0], base=board_found[1], fits=True)
    if reader.damaged and not any(map(len, mirrored)):
        raise InputError(f"{reader.damaged[0]}; no corner of the board found in other frames")
    try:
        calibration = calibrate_corners(
            mirrored,
            base,
            layout,
            board.corners_in_board_mm,
            model=model,
            extremes=reader.extremes,
            pictures=BoardPictures(
                [group[n] for group, used in zip((reader.mirrored, reader.base), chosen, strict=True) for n in used],
                board,
                workers,
            ),
            unknown=unknown_mirrors(layout, mirrored_detected),
            names=None
            if names is None
            else [group[n] for group, used in zip(names, chosen, strict=True) for n in used],
            on_step=steps.counting(on_step),
        )
    except InputError:
        # The stated board was found but does not fit: parts of a larger checkerboard can look like it.
        reader.check_board(board, mirrored=board_found[0], base=board_found[1], fits=False)
        if message := wrong_size_message(reader.first(mirrored=True), layout, board):
            raise InputError(message) from None
        if fits_upside_down(mirrored, layout, board):
            raise InputError(UPSIDE_DOWN) from None
        raise
    kept = ((reader.mirrored[number], detected) for number, detected in zip(chosen[0], mirrored, strict=True))
    files = [(picture, rows) for picture, rows in kept if isinstance(picture, Path) and len(rows)]
    if files:
        colour = estimated_lateral_colour(colour_pictures(files), calibration.layout.camera, board)
        calibration = calibration.with_lateral_colour(colour)
    steps.finish()
    return calibration.with_damaged_pictures(reader.damaged)


def chosen_frames(
    detected: Sequence[DetectedFrame], max_pictures: int | None, corners_in_board_mm: FloatArray, width_px: int
) -> Sequence[int]:
    """Numbers of the pictures to use: all, or the most informative ones if there are more than `max_pictures`."""
    if max_pictures is None or len(detected) <= max_pictures:
        return range(len(detected))
    boards = [
        [Corners(rows.corner[rows.view == view], rows.pixels[rows.view == view]) for view in np.unique(rows.view)]
        for rows in (frame.corners for frame in detected)
    ]
    return most_informative(boards, corners_in_board_mm, width_px=width_px, max_frames=max_pictures)


def checked_pictures(name: str, pictures: Iterable[Grey | AnyPath]) -> Iterable[Grey | Path]:
    """Return pictures with paths as `Path`; a sequence stays a sequence, and a stack (n, h, w) becomes one.

    Raises TypeError unless `pictures` is an iterable of arrays or paths, and InputError for an array that is not grey.
    """
    if isinstance(pictures, np.ndarray):
        if pictures.ndim != 3 or pictures.shape[2] <= MAX_CHANNELS:
            raise InputError(f"{name}: an array {pictures.shape}, expected a stack (n, h, w) of grey values")
        pictures = list(pictures)
    if isinstance(pictures, str | os.PathLike) or not isinstance(pictures, Iterable):
        raise TypeError(f"{name}: {type(pictures).__name__}, expected an iterable of arrays or paths")

    def checked(picture: Grey | AnyPath) -> Grey | Path:
        if not isinstance(picture, np.ndarray):
            return path_of(name, picture)
        if picture.dtype != np.uint8 or picture.ndim != 2:
            raise InputError(
                f"{name}: an array {picture.shape} of {picture.dtype}, expected (h, w) of uint8, grey values"
            )
        return picture

    return [checked(picture) for picture in pictures] if isinstance(pictures, Sequence) else map(checked, pictures)


def other_board_in_sample(
    pictures: Iterable[Grey | Path], board: CalibrationBoard, *, mirrored: bool | None
) -> str | None:
    """Describe how pictures, evenly spread over a sequence, show a board other than `board`; None in any doubt."""
    if not isinstance(pictures, Sequence) or not len(pictures):
        return None
    shown = []
    for number in np.unique(np.linspace(0, len(pictures) - 1, SAMPLE).round().astype(int)).tolist():
        picture = pictures[number]
        with suppress(InputError):  # raised when all pictures are read
            shown.append(read_image(picture, grey=True) if isinstance(picture, Path) else picture)
    return surely_other_board(shown, board, mirrored=mirrored)


class PictureReader:
    """Reads pictures one at a time and collects damaged files, the first pictures, and extremes of the mirrored ones.

    They must have the size of `camera`, which messages call `owner`.

    Attributes
    ----------
    damaged
        Errors for the damaged files so far.
    extremes
        Pixel-wise extremes of the pictures via the mirrors so far.
    mirrored, base
        The pictures via the mirrors and without them so far; None for a damaged file, and for further arrays from an
        iterator when `MAX_KEPT` arrays are kept.
    """

    def __init__(self, camera: Camera, owner: str = "the layout's camera") -> None:
        self.damaged: list[DamagedPicture] = []
        self.extremes = Extremes()
        self.mirrored: list[Grey | Path | None] = []
        self.base: list[Grey | Path | None] = []
        self._arrays = 0
        self._camera, self._owner = camera, owner
        self._first: dict[bool, list[Grey]] = {True: [], False: []}

    def read(self, pictures: Iterable[Grey | Path], *, mirrored: bool) -> Iterator[Grey | None]:
        """Yield the grey values of each picture, or None for a damaged file.

        Raises InputError if a picture file's size differs from the camera's.
        """
        in_memory = isinstance(pictures, Sequence)
        if in_memory:
            set_common_bit_depth([picture for picture in pictures if isinstance(picture, Path)])
        for picture in pictures:
            grey = self._grey(picture)
            yield grey
            # The caller asks for the next picture only after it accepted this one's size.
            keep = in_memory or isinstance(picture, Path) or self._arrays < MAX_KEPT
            self._arrays += not isinstance(picture, Path)
            (self.mirrored if mirrored else self.base).append(picture if grey is not None and keep else None)
            if grey is None:
                continue
            if mirrored:
                self.extremes.add(grey)
            if len(self._first[mirrored]) < MAX_PICTURES:
                self._first[mirrored].append(grey)

    def first(self, *, mirrored: bool) -> Sequence[Grey]:
        """The first pictures via the mirrors or without them, at most `MAX_PICTURES`."""
        return self._first[mirrored]

    def check_board(self, board: CalibrationBoard, *, mirrored: bool, base: bool, fits: bool) -> None:
        """Raise InputError if the first pictures show a board other than `board`.

        `mirrored` and `base` state whether `board` was found in any picture via the mirrors, and without them;
        `fits`, whether the calibration has not failed to fit.
        """
        found = mirrored or base
        for kind, found_in_kind in ((False, base), (True, mirrored)):
            message = other_board(self._first[kind], board, mirrored=kind, found=found, fits=fits and found_in_kind)
            if message is not None:
                raise InputError(message)

    def _grey(self, picture: Grey | Path) -> Grey | None:
        if not isinstance(picture, Path):
            return picture
        try:
            grey = read_image(picture, grey=True)
        except DamagedPicture as error:
            self.damaged.append(error)
            return None
        size = (self._camera.width_px, self._camera.height_px)
        check_size(picture, (grey.shape[1], grey.shape[0]), size, self._owner)
        return grey
