"""Calibration of a camera without mirrors from pictures of a board.

The board is detected in all pictures. A first estimate of the camera then serves `corner_calibration` as a layout
without mirrors, so that model selection, covariance and diagnostics are those of a mirror camera.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from mirrorcam.core.arguments import AnyPath, check_callable, check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.progress import Progress, Step, Steps, no_progress, no_step
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.calibration.calibration import (
    SOLUTION_STEPS,
    PictureReader,
    checked_pictures,
    chosen_frames,
    other_board_in_sample,
)
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners, check_names
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.consistency import repeated_frames
from mirrorcam.optics.calibration.diagnostics.nested_models import joint_model
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.pupil_estimate import BoardPictures
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError, start_robustly
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners, Observations
from mirrorcam.optics.calibration.solver.residuals import residuals
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

FISHEYE_FOCALS = (0.2, 0.35, 0.6)
"""Trial focal lengths of a fisheye, relative to the picture's width."""
FISHEYE_RATIO = 0.7
"""Median residual of a fisheye, relative to that of a Brown-Conrady lens, below which it is the first estimate."""


def calibrate_camera(
    pictures: Iterable[Grey | AnyPath],
    board: CalibrationBoard,
    *,
    nominal: Camera | None = None,
    model: RequestedModel | str = AUTO,
    detections: AnyPath | None = None,
    workers: int = 1,
    max_pictures: int | None = None,
    names: Sequence[str] | None = None,
    progress: Progress = no_progress,
    on_step: Step = no_step,
) -> Calibration:
    """Calibrate a camera without mirrors from pictures of a board.

    Parameters
    ----------
    pictures
        Pictures of the board: grey values (h, w) or paths of picture files, or a stack (n, h, w) of grey values, uint8.
        A damaged file is skipped, named in the notes and counted in the metrics.
    board
        The board.
    nominal
        The camera as published: its name, body and pupil are kept. Default: nothing is known.
    model
        Model to fit: a `RequestedModel`, or its words, such as "fisheye". Default: the largest that the pictures
        support.
    detections
        Folder that caches detected corners, so that each picture is searched only once.
    workers
        Number of detection threads.
    max_pictures
        Maximum number of pictures to use; None uses all.
    names
        Names of the pictures. Default: their paths or numbers.
    progress
        Called with the number of steps done and the number expected: a step per picture searched, and a few for the
        solution.
    on_step
        Called with each step of the solution in words.

    Returns
    -------
    Calibration
        Its layout has no mirrors; `CalibratedCamera.of(calibration.layout)` is the camera with its covariance.

    Raises
    ------
    InputError
        If no pictures are given, a picture cannot be read or has the wrong size, or the pictures do not determine the
        camera.
    """
    check_type("board", board, Checkerboard, Charuco, AprilGrid)
    check_count("workers", workers, WORKERS)
    check_callable("progress", progress)
    cache = None if detections is None else path_of("detections", detections)
    model = RequestedModel.parse(model)
    model.check_plain()
    given = list(checked_pictures("pictures", pictures))
    if not given:
        raise InputError("pictures: no pictures given")
    if names is not None:
        check_names(names, len(given))
    else:
        names = [item.name if isinstance(item, Path) else f"picture {number}" for number, item in enumerate(given)]
    provisional = _unknown_camera(given) if nominal is None else nominal
    steps = Steps(progress, len(given) + SOLUTION_STEPS)

    if other := other_board_in_sample(given, board, mirrored=False):
        raise InputError(other)
    reader = PictureReader(provisional, "the first picture" if nominal is None else f"the {nominal.name}")
    detected = detect_frames(
        reader.read(given, mirrored=False),
        Layout.bare(provisional),
        board,
        mirrored=False,
        folder=cache,
        workers=workers,
        on_frame=steps.advance,
    )
    corners_mm = board.corners_in_board_mm
    used = chosen_frames(detected, max_pictures, corners_mm, provisional.width_px)
    frames, names = [detected[number].corners for number in used], [names[number] for number in used]
    found = any(len(rows) for rows in frames)
    reader.check_board(board, mirrored=False, base=found, fits=True)
    if not found:
        raise InputError(
            str(reader.damaged[0])
            if reader.damaged
            else f"no {board.cols} x {board.rows} {board.name} found in any of {len(given)} pictures"
        )
    try:
        camera = first_camera(frames, corners_mm, provisional, model)
        layout = Layout.bare(camera if nominal is None else _with_body(camera, nominal))
        shown = BoardPictures([reader.base[number] for number in used], board, workers)
        calibration = calibrate_corners(
            [], frames, layout, corners_mm, model=model, pictures=shown, names=names, on_step=steps.counting(on_step)
        )
    except InputError:
        # The stated board was found but does not fit: parts of a larger checkerboard can look like it.
        reader.check_board(board, mirrored=False, base=True, fits=False)
        raise
    steps.finish()
    return calibration.with_damaged_pictures(reader.damaged)


def _unknown_camera(pictures: Sequence[Grey | Path]) -> Camera:
    """A camera of the first readable picture's size, whose other figures are placeholders."""
    for picture in pictures:
        try:
            grey = read_image(picture, grey=True) if isinstance(picture, Path) else picture
        except DamagedPicture:
            continue
        height, width = grey.shape
        return Camera(
            width_px=width,
            height_px=height,
            fx_px=float(width),
            fy_px=float(width),
            cx_px=(width - 1.0) / 2.0,
            cy_px=(height - 1.0) / 2.0,
        )
    raise InputError("no picture that can be read, expected pictures of the board")


def _with_body(camera: Camera, nominal: Camera) -> Camera:
    return camera.replaced(
        name=nominal.name,
        aperture_mm=nominal.aperture_mm,
        focus_mm=nominal.focus_mm,
        body_mm=nominal.body_mm,
        lens_mm=nominal.lens_mm,
    )


def first_camera(
    frames: Sequence[Observations], corners_in_board_mm: FloatArray, size: Camera, model: RequestedModel
) -> Camera:
    """Estimate a camera from corners alone.

    The best of several starts, each fitted robustly: two by Zhang's method, and fisheyes of several focal lengths.

    Parameters
    ----------
    frames
        Corners of each picture, as frame 0.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.
    size
        Camera with the size of the pictures.
    model
        Model to fit; without a lens, a fisheye is returned only if it fits much better.

    Raises
    ------
    InputError
        If too few pictures show the board, or they do not determine the camera.
    """
    repeats = repeated_frames(frames)
    different = [rows for number, rows in enumerate(frames) if len(rows) >= MIN_CORNERS and number not in repeats]
    views = [Corners(rows.corner, rows.pixels) for rows in different]
    rows = Observations.join(
        [Observations.of_view(frame, -1, view.ids, view.pixels) for frame, view in enumerate(views)]
    )
    costs: list[tuple[float, Camera]] = []
    for start in _starts(views, corners_in_board_mm, size):
        is_fisheye = start.lens_model == "fisheye"
        if model.lens is not None and is_fisheye != (model.lens == "fisheye"):
            continue
        fitted = _fitted(start, rows, corners_in_board_mm)
        if fitted is not None:
            cost, camera = fitted
            costs.append((cost / (FISHEYE_RATIO if is_fisheye else 1.0), camera))
    if not costs:
        raise InputError("the pictures do not determine the camera, expected boards at several tilts")
    return min(costs, key=lambda pair: pair[0])[1]


def _starts(views: Sequence[Corners], corners_in_board_mm: FloatArray, size: Camera) -> Iterator[Camera]:
    for full_distortion in (True, False):
        try:
            yield initial_estimates.intrinsics(
                views,
                corners_in_board_mm,
                width_px=size.width_px,
                height_px=size.height_px,
                full_distortion=full_distortion,
            )
        except (cv2.error, InvalidValue):
            continue
    for focal in FISHEYE_FOCALS:
        yield Camera(
            width_px=size.width_px,
            height_px=size.height_px,
            fx_px=focal * size.width_px,
            fy_px=focal * size.width_px,
            cx_px=(size.width_px - 1.0) / 2.0,
            cy_px=(size.height_px - 1.0) / 2.0,
            lens_model="fisheye",
            distortion=np.zeros(4),
        )


def _fitted(start: Camera, observations: Observations, corners_in_board_mm: FloatArray) -> tuple[float, Camera] | None:
    """Median residual, px, and camera of a robust fit; None if the start contradicts the corners."""
    if not np.isfinite(start.normalized_from_pixels(observations.pixels)).all():
        return None
    try:
        estimate = initial_estimates.first_estimate(observations, start, Layout.bare(start), corners_in_board_mm)
        model = joint_model(start, corners_in_board_mm)
        estimate, _ = start_robustly(estimate, observations, model)
    except (InputError, InvalidValue, UndeterminedError, cv2.error):
        return None
    errors = residuals(estimate, observations, model.board)
    return float(np.median(np.abs(errors))), estimate.camera
