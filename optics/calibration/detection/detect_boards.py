"""Observations of frames: the bare camera's view of the target, or every sub-image of a mirror camera."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.calibration.detection import charuco, detection_cache
from mirrorcam.optics.calibration.detection.assignment import assign
from mirrorcam.optics.calibration.detection.board_growing import corner_places, grow
from mirrorcam.optics.calibration.detection.checkerboard import Grey, find_checkerboards, orderings, spread_out
from mirrorcam.optics.calibration.detection.ghost_images import refine_with_ghost_images
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco, Target


def find_boards(grey: Grey, target: Target, *, mirrored: bool, most: int) -> list[tuple[Corners, ...]]:
    """Up to `most` boards in a picture (h, w), the largest first, each in all of its possible numberings.

    `mirrored` where the picture shows them by way of mirrors. Boards whose corners are few or near one line are left
    out: they do not tell where they stand.
    """
    if isinstance(target, Charuco):
        found: list[tuple[Corners, ...]] = [
            (board,) for board in charuco.find_boards(grey, target, mirrored=mirrored, most=most)
        ]
    else:
        picture, places = np.asarray(grey, dtype=np.float32), corner_places(target)
        found = [
            tuple(
                grow(picture, places, ordering, target, mirrored=mirrored)
                for ordering in orderings(grey, board, target, mirrored=mirrored)
            )
            for board in find_checkerboards(grey, target, most=most)
        ]
    return [board for board in found if board and all(len(spread_out(corners)) for corners in board)]


def direct_view(grey: Grey, target: Target) -> Observations:
    """Corners that the bare camera sees, as frame 0; of several boards, those of the largest."""
    for numberings in find_boards(grey, target, mirrored=False, most=1):
        return Observations.of_view(0, DIRECT, numberings[0].ids, numberings[0].pixels)
    return Observations.none()


def sub_images(grey: Grey, layout: Layout, target: Target) -> Observations:
    """Corners in every mirror of a frame (h, w), as frame 0; a view that shows no board adds no rows."""
    # A few more boards than there are mirrors, for what proves to be none's.
    boards = find_boards(grey, target, mirrored=True, most=2 * len(layout.mirrors))
    picture = np.asarray(grey, dtype=np.float32)
    views = []
    for index, corners in assign(boards, layout, target):
        seen = refine_with_ghost_images(picture, corners, layout.camera, layout.mirrors[index], target)
        views.append(Observations.of_view(0, index, seen.ids, seen.pixels))
    return Observations.join(views)


def detect_frames(
    pictures: Iterable[Grey],
    layout: Layout,
    target: Target,
    *,
    mirrored: bool,
    folder: Path | None = None,
    workers: int = 1,
    on_frame: Callable[[Sequence[Observations]], None] = lambda found: None,
) -> list[Observations]:
    """`sub_images` of every frame, or where they are not `mirrored` `direct_view`, in their order, each as frame 0.

    Pictures are taken as they are needed, at most two for each of the `workers` at a time. What is found in them is
    kept in `folder` and taken from there the next time; `on_frame` hears after each frame what was found so far.
    Raises InputError where a picture has not the size of the layout's camera.
    """
    expected = (layout.camera.height_px, layout.camera.width_px)

    def find(grey: Grey) -> Observations:
        return sub_images(grey, layout, target) if mirrored else direct_view(grey, target)

    def look(grey: Grey) -> Observations:
        if folder is None:
            return find(grey)
        name = detection_cache.key(grey, target, layout if mirrored else None)
        seen = detection_cache.load(folder, name)
        if seen is None:
            seen = find(grey)
            detection_cache.save(folder, name, seen)
        return seen

    def sized() -> Iterator[Grey]:
        for number, grey in enumerate(pictures):
            if grey.shape != expected:
                height, width = grey.shape[:2]
                camera = f"the layout's camera {expected[1]}x{expected[0]}"
                raise InputError(f"frame {number} is {width}x{height} px, {camera}")
            yield grey

    observations: list[Observations] = []
    for seen in _in_order(look, sized(), workers):
        observations.append(seen)
        on_frame(observations)
    return observations


def _in_order(look: Callable[[Grey], Observations], pictures: Iterator[Grey], workers: int) -> Iterator[Observations]:
    if workers == 1:
        yield from map(look, pictures)
        return
    with ThreadPoolExecutor(workers) as pool:
        waiting: deque[Future[Observations]] = deque()
        for picture in pictures:
            waiting.append(pool.submit(look, picture))
            if len(waiting) >= 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
