"""Detection of a board in frames: in the bare camera's view, or in every sub-image of a mirror camera."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.results import Results
from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.detection import charuco, detection_cache
from mirrorcam.optics.calibration.detection.assignment import assign, likely_mirror, unassigned_px
from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards, non_collinear
from mirrorcam.optics.calibration.detection.detections import DetectedFrame, DetectedGrid
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, Corners, Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard, Checkerboard
from mirrorcam.optics.geometry.layout import Layout


def find_boards(grey: Grey, board: CalibrationBoard, *, mirrored: bool, max_boards: int) -> list[tuple[Corners, ...]]:
    """Find up to `max_boards` boards in a picture (h, w), the largest first, each with all possible numberings.

    A numbering assigns ids to corners. `mirrored` states whether the boards appear in mirrors. Boards with few or
    collinear corners are left out, because they do not determine a pose, and so are parts of checkerboards that fit the
    board at several positions.
    """
    if isinstance(board, Checkerboard):
        found = [tuple(grid.numberings(board, mirrored=mirrored)) for grid in find_checkerboards(grey, board)]
        found = [detected for detected in found if len(detected) <= 1 + board.looks_same_upside_down]
    else:
        found = [
            (detected,)
            for detected in charuco.find_marked_boards(grey, board, mirrored=mirrored, max_boards=max_boards)
        ]
    return [detected for detected in found if detected and len(non_collinear(detected[0]))][:max_boards]


def detect_direct_view(grey: Grey, board: CalibrationBoard) -> Observations:
    """Return the corners of the largest board in a picture of the bare camera, as frame 0."""
    for numberings in find_boards(grey, board, mirrored=False, max_boards=1):
        return Observations.of_view(0, DIRECT, numberings[0].ids, numberings[0].pixels, numberings[0].sigma_px)
    return Observations.empty()


def detect_sub_images(
    grey: Grey, layout: Layout, board: CalibrationBoard, results: Results | None = None
) -> DetectedFrame:
    """Return the corners in every mirror of a frame (h, w), as frame 0; views without a board add no rows.

    A results store caches the boards, which do not depend on the layout.
    """
    max_boards = 2 * len(layout.mirrors)  # more boards than mirrors, because some may be stray
    if isinstance(board, Checkerboard):
        cached = _cached(grey, board, max_boards, results, lambda: _as_grids(find_checkerboards(grey, board)))
        return _checkerboards([grid for _, grid in cached.grids], layout, board)
    cached = _cached(
        grey,
        board,
        max_boards,
        results,
        lambda: _as_views(find_boards(grey, board, mirrored=True, max_boards=max_boards)),
    )
    parts = [cached.corners.where(cached.corners.view == number) for number in np.unique(cached.corners.view)]
    boards = [(Corners(part.corner, part.pixels, part.sigma_px),) for part in parts]
    assigned = assign(boards, layout, board)
    views = [Observations.of_view(0, index, found.ids, found.pixels, found.sigma_px) for index, found in assigned]
    return DetectedFrame(Observations.join(views), unassigned_px(boards, assigned, layout))


def _cached(
    grey: Grey, board: CalibrationBoard, boards: int, results: Results | None, find: Callable[[], DetectedFrame]
) -> DetectedFrame:
    """Return cached detections of a picture, or find and cache them; `boards` is 0 for the direct view."""
    if results is None:
        return find()
    name = detection_cache.name_of(grey, board, boards)
    cached = detection_cache.load(results, name, views=boards, corners=len(board.corners_in_board_mm))
    if cached is None:
        cached = find()
        detection_cache.save(results, name, cached)
    return cached


def _as_grids(grids: Sequence[DetectedGrid]) -> DetectedFrame:
    return DetectedFrame(Observations.empty(), grids=tuple((0, grid) for grid in grids))


def _as_views(boards: Sequence[tuple[Corners, ...]]) -> DetectedFrame:
    """Return boards with one numbering each as a frame, with the board's index in place of a view."""
    parts = [
        Observations.of_view(0, number, board.ids, board.pixels, board.sigma_px)
        for number, (board,) in enumerate(boards)
    ]
    return DetectedFrame(Observations.join(parts))


def _checkerboards(detected: Sequence[DetectedGrid], layout: Layout, board: Checkerboard) -> DetectedFrame:
    """Return the corners of checkerboards that can be numbered in a single view, and all checkerboards as grids."""
    grids = [grid for grid in detected if len(non_collinear(grid.corners))]
    numbered = [(grid, tuple(grid.numberings(board, mirrored=True))) for grid in grids[: 2 * len(layout.mirrors)]]
    boards = [options for _, options in numbered if 0 < len(options) <= 1 + board.looks_same_upside_down]
    assigned = assign(boards, layout, board)
    chosen = {id(corners): mirror for mirror, corners in assigned}
    views, mirror_grids = [], []
    for grid, options in numbered:
        corners = next((option for option in options if id(option) in chosen), options[0] if options else grid.corners)
        mirror = chosen.get(id(corners), likely_mirror(corners, layout))
        if mirror is None or not options:
            continue
        if id(corners) in chosen:
            views.append(Observations.of_view(0, mirror, corners.ids, corners.pixels, corners.sigma_px))
        if len(grid) >= MIN_CORNERS:
            mirror_grids.append((mirror, grid))
    return DetectedFrame(Observations.join(views), unassigned_px(boards, assigned, layout), tuple(mirror_grids))


def detect_frames(
    pictures: Iterable[Grey | None],
    layout: Layout,
    board: CalibrationBoard,
    *,
    mirrored: bool,
    folder: Path | None = None,
    workers: int = 1,
    on_frame: Callable[[Sequence[DetectedFrame]], None] = lambda found: None,
) -> list[DetectedFrame]:
    """Detect the board in every picture.

    Parameters
    ----------
    pictures
        Grey pictures (h, w) of the size of the layout's camera; at most two per worker are in memory at a time. None
        replaces an unreadable frame, which shows nothing.
    layout
        Nominal or calibrated layout, which locates the sub-images.
    board
        The board.
    mirrored
        Whether the pictures show the board in the mirrors (`detect_sub_images`), or directly.
    folder
        Folder that caches detections, if any.
    workers
        Number of threads.
    on_frame
        Called after each frame with all detections so far.

    Returns
    -------
    list of DetectedFrame
        One per picture, in order, each as frame 0.

    Raises
    ------
    InputError
        If a picture's size differs from the layout's camera, or the folder cannot be written.
    """
    expected = (layout.camera.height_px, layout.camera.width_px)
    results = None if folder is None else Results(folder)

    def detect(grey: Grey | None) -> DetectedFrame:
        if grey is None:
            return DetectedFrame(Observations.empty())
        if mirrored:
            return detect_sub_images(grey, layout, board, results)
        return _cached(grey, board, 0, results, lambda: DetectedFrame(detect_direct_view(grey, board)))

    def checked() -> Iterator[Grey | None]:
        for number, grey in enumerate(pictures):
            if grey is not None and grey.shape != expected:
                height, width = grey.shape[:2]
                owner = "the layout's camera" if layout.mirrors else "others"
                raise InputError(f"frame {number} is {width}x{height} px, {owner} {expected[1]}x{expected[0]}")
            yield grey

    detected: list[DetectedFrame] = []
    for frame in _in_order(detect, checked(), workers):
        detected.append(frame)
        on_frame(detected)
    return detected


def _in_order(
    detect: Callable[[Grey | None], DetectedFrame], pictures: Iterator[Grey | None], workers: int
) -> Iterator[DetectedFrame]:
    if workers == 1:
        yield from map(detect, pictures)
        return
    with ThreadPoolExecutor(workers) as pool:
        pending: deque[Future[DetectedFrame]] = deque()
        for picture in pictures:
            pending.append(pool.submit(detect, picture))
            if len(pending) >= 2 * workers:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
