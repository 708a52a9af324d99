"""First estimate of camera, planes and poses from pictures of a board directly and in mirrors, without a layout.

Each plane bisects a board and its image; planes on which pictures agree are kept. Then every detected board is assigned
to the direct view or to one of the mirrors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy.optimize import linear_sum_assignment

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, UndeterminedError, start_robustly
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.calibration.solver.parameterisation import FrameTerms, Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.transforms import transform

PAIR_MISFIT = 0.15  # in board diagonals: a pose from a single view is rough
MAX_DISAGREEMENT = 0.5  # between the centroids of a board from several views, in board diagonals
NO_IMAGE_DISTANCE = 10.0  # distance, in board diagonals, assigned to boards that cannot be the image
MAX_COMBINATIONS = 500
SPARE_PLANES = 3  # besides those of the mirrors, for coincidences and double reflections
SAME_PLANE = 0.1  # relative to the distance of the virtual centre
FOCAL = ("fx_px", "fy_px")
FOCAL_LENGTHS = (0.6, 0.8, 1.1, 1.5, 2.2)  # of common cameras, in widths of the picture
LIKELY_BOW = 0.02  # prior sigma, relative to the board's longer side, for corner errors of 1 px
GOOD_ERROR = 2e-4  # rms error, in picture diagonals, below which no other camera is tried
ERROR_CAP = 0.01  # maximum error counted for a corner, in picture diagonals


@dataclass(frozen=True)
class NumberedBoard:
    """A board detected in a picture, with its numberings (possible assignments of corner ids), as a direct view and as
    an image in a mirror.

    For a board with even numbers of rows and columns of squares, the colours determine which of the two it is.
    """

    direct: list[Corners]
    image: list[Corners]


@dataclass(frozen=True)
class Start:
    """A first estimate, the corners by view with frames numbered from 0, and the picture number of each frame.

    `error_px` is the rms error of all detected corners, capped at `ERROR_CAP` each.
    """

    estimate: Estimate
    observations: Observations
    pictures: list[int]
    error_px: float


@dataclass(frozen=True)
class _PosedCorners:
    """A numbering of a detected board, the pose (4, 4) that fits it, and its corners (n, 3) in the camera frame, mm."""

    corners: Corners
    pose: FloatArray
    points: FloatArray


@dataclass(frozen=True)
class _PosedBoard:
    """A detected board in each of its numberings, as a direct view and as an image in a mirror."""

    direct: list[_PosedCorners]
    image: list[_PosedCorners]

    @property
    def points(self) -> FloatArray:
        """Apparent positions (n, 3) of its corners, which do not depend on the numbering."""
        return (self.direct or self.image)[0].points


def first_direct_estimate(
    detected: Sequence[Sequence[NumberedBoard]],
    corners_in_board_mm: FloatArray,
    *,
    mirrors: int,
    width_px: int,
    height_px: int,
) -> Start:
    """Estimate camera, planes and poses from the boards detected in each picture.

    Bowed boards, or boards at similar tilts, give a wrong camera or none. So several cameras are tried, and the one
    whose mirrors and boards fit the corners best is used.

    Raises InputError if the boards do not determine the camera, or show too few mirrors.
    """
    views = [(board.direct or board.image)[0] for boards_in_picture in detected for board in boards_in_picture]
    size_px = float(np.hypot(width_px, height_px))
    best, refusals = None, []
    for camera in _cameras(views, corners_in_board_mm, width_px, height_px):
        try:
            start = _start_with(camera, detected, corners_in_board_mm, mirrors, cap_px=ERROR_CAP * size_px)
        except InputError as error:
            refusals.append(str(error))
            continue
        if best is None or start.error_px < best.error_px:
            best = start
        if best.error_px < GOOD_ERROR * size_px:
            break
    if best is None:
        raise InputError(refusals[0])
    return best


def _cameras(
    views: Sequence[Corners], corners_in_board_mm: FloatArray, width_px: int, height_px: int
) -> Iterator[Camera]:
    """Yield cameras to try: the one that fits the views, then centred ones with the focal lengths of common cameras."""
    size = {"width_px": width_px, "height_px": height_px}
    yield initial_estimates.intrinsics(views, corners_in_board_mm, **size, full_distortion=False)
    centre = {"cx_px": (width_px - 1) / 2.0, "cy_px": (height_px - 1) / 2.0}
    for focal in FOCAL_LENGTHS:
        yield Camera(**size, **centre, fx_px=focal * width_px, fy_px=focal * width_px)


def _start_with(
    camera: Camera,
    detected: Sequence[Sequence[NumberedBoard]],
    corners_in_board_mm: FloatArray,
    mirrors: int,
    *,
    cap_px: float,
) -> Start:
    """Return the first estimate of a camera, after a robust fit of its focal lengths, planes, poses and bows."""
    boards = []
    for boards_in_picture in detected:
        candidates = [_located(camera, board, corners_in_board_mm) for board in boards_in_picture]
        boards.append([board for board in candidates if board.direct or board.image])
    size_mm = float(np.linalg.norm(np.ptp(corners_in_board_mm, axis=0)))
    centres = _seed_mirrors(boards, mirrors, size_mm=size_mm)
    observations, pictures, poses = _assign(boards, centres, size_mm=size_mm)
    estimate = Estimate(camera, centres, poses)
    board = Board.rigid(corners_in_board_mm)
    bows = FrameTerms(bow_per_mm=1.0 / (LIKELY_BOW * float(np.ptp(corners_in_board_mm, axis=0).max())))
    model = Model(FOCAL, thickness=False, curvature=False, board=board, frame_terms=bows)
    try:
        estimate, _ = start_robustly(estimate, observations, model)
    except UndeterminedError as error:
        raise InputError(f"the pictures do not determine camera and mirrors: {error}") from None
    errors = np.linalg.norm(residuals(estimate, observations, board), axis=1)
    # A board assigned to no view counts as a large error, so a start that explains only a few boards is rejected.
    corner_count = sum(
        len((item.direct or item.image)[0]) for boards_in_picture in detected for item in boards_in_picture
    )
    squares = float(np.sum(np.minimum(errors, cap_px) ** 2)) + (corner_count - len(observations)) * cap_px**2
    return Start(estimate, observations, pictures, float(np.sqrt(squares / corner_count)))


def _located(camera: Camera, board: NumberedBoard, corners_in_board_mm: FloatArray) -> _PosedBoard:
    """Locate a board in space, without the numberings for which no pose fits."""

    def locate(numberings: list[Corners]) -> list[_PosedCorners]:
        located = []
        for view in numberings:
            pose = initial_estimates.camera_from_flat_board(camera, view, corners_in_board_mm)
            if pose is not None:
                located.append(_PosedCorners(view, pose, transform(pose, corners_in_board_mm)))
        return located

    return _PosedBoard(locate(board.direct), locate(board.image))


def _seed_mirrors(boards: list[list[_PosedBoard]], mirrors: int, *, size_mm: float) -> FloatArray:
    """Return the virtual centres (m, 3), left to right, of the planes on which most pictures agree.

    Every ordered pair of boards in a picture proposes the plane in which one would be the other's image. True planes
    recur from picture to picture, coincidences rarely do. Among the most frequent planes, those under which most views
    agree on the board's position are chosen.
    """
    proposals: list[tuple[int, FloatArray, float]] = []
    for number, boards_in_picture in enumerate(boards):
        for a in boards_in_picture:
            for b in boards_in_picture:
                if a is b:
                    continue
                for direct in a.direct:
                    for image in b.image:
                        centre, misfit = initial_estimates.virtual_centre_between(direct.points, image.points)
                        in_front = not initial_estimates.is_behind(direct.points, centre)
                        if misfit < PAIR_MISFIT * size_mm and in_front:
                            proposals.append((number, centre, misfit))
    planes: list[FloatArray] = []
    while len(planes) < mirrors + SPARE_PLANES and proposals:
        numbers = np.array([number for number, _, _ in proposals])
        centres = np.array([centre for _, centre, _ in proposals])
        support = [len(np.unique(numbers[_same_plane(centre, centres)])) for centre in centres]
        best = min(range(len(proposals)), key=lambda i: (-support[i], proposals[i][2]))
        same = _same_plane(centres[best], centres)
        planes.append(np.median(centres[same], axis=0))
        proposals = [proposal for proposal, used in zip(proposals, same, strict=True) if not used]
    if len(planes) < mirrors:
        raise InputError(
            f"the pictures show {len(planes)} mirrors, expected {mirrors}: the board must be visible directly and in "
            "each mirror in at least one picture"
        )
    if comb(len(planes), mirrors) > MAX_COMBINATIONS:
        planes = planes[:mirrors]  # the most frequent ones
    selections = [np.array(sorted(chosen, key=lambda centre: centre[0])) for chosen in combinations(planes, mirrors)]
    return max(selections, key=lambda centres: _count_agreeing(boards, centres, size_mm=size_mm))


def _count_agreeing(boards: list[list[_PosedBoard]], centres: FloatArray, *, size_mm: float) -> int:
    """Number of views that agree with another view of their picture on the board's position."""
    count = 0
    for boards_in_picture in boards:
        views = _views(boards_in_picture, centres, size_mm=size_mm)
        centroids = np.array([_in_rig(options[0], view, centres).mean(axis=0) for view, options in views.items()])
        for row, centroid in enumerate(centroids):
            others = np.delete(centroids, row, axis=0)
            count += bool((np.linalg.norm(others - centroid, axis=1) < MAX_DISAGREEMENT * size_mm).any())
    return count


def _same_plane(centre: FloatArray, others: FloatArray) -> BoolArray:
    """Mask (n,) of other virtual centres (n, 3) that belong to the same plane."""
    return np.asarray(np.linalg.norm(others - centre, axis=1) < SAME_PLANE * np.linalg.norm(centre))


def _views(
    boards_in_picture: list[_PosedBoard], centres: FloatArray, *, size_mm: float
) -> dict[int, list[_PosedCorners]]:
    """Return the numberings of the boards by view.

    The direct view is the board with the most images at the positions predicted by the mirrors. Otherwise, a
    board behind no plane is the direct view, and a board behind a single plane its image; boards behind several planes
    may have been reflected more than once and are left out.
    """
    interpretations = [
        _images_of(board, boards_in_picture, centres, size_mm=size_mm) for board in boards_in_picture if board.direct
    ]
    views, score = max(interpretations, key=lambda pair: pair[1], default=({}, 0.0))
    if score > 0.0:
        return views
    views = {}
    for board in boards_in_picture:
        hidden_by = [m for m, centre in enumerate(centres) if initial_estimates.is_behind(board.points, centre)]
        if len(hidden_by) == 0 and board.direct:
            views.setdefault(DIRECT, board.direct)
        elif len(hidden_by) == 1 and board.image:
            views.setdefault(hidden_by[0], board.image)
    return views


def _images_of(
    direct: _PosedBoard, boards_in_picture: list[_PosedBoard], centres: FloatArray, *, size_mm: float
) -> tuple[dict[int, list[_PosedCorners]], float]:
    """Return the views of a board assumed to be the direct view, and their score, at most 1 per mirror.

    The views are the board itself and, for each mirror that it is in front of, the board nearest to its image.
    """
    views, score = {DIRECT: direct.direct}, 0.0
    images = [board for board in boards_in_picture if board.image and board is not direct]
    distances = np.full((len(centres), len(images)), NO_IMAGE_DISTANCE)
    for mirror, centre in enumerate(centres):
        if initial_estimates.is_behind(direct.points, centre):
            continue
        expected = reflect(direct.points, centre).mean(axis=0)
        for column, board in enumerate(images):
            if initial_estimates.is_behind(board.points, centre):
                centroids = np.array([option.points.mean(axis=0) for option in board.image])
                distances[mirror, column] = np.linalg.norm(centroids - expected, axis=1).min() / size_mm
    for mirror, column in zip(*linear_sum_assignment(np.minimum(distances, NO_IMAGE_DISTANCE)), strict=True):
        if distances[mirror, column] < MAX_DISAGREEMENT:
            views[int(mirror)] = images[column].image
            score += 1.0 - distances[mirror, column] / MAX_DISAGREEMENT
    return views, float(score)


def _in_rig(board: _PosedCorners, view: int, centres: FloatArray) -> FloatArray:
    """Corners (n, 3) of the board itself from a view of it."""
    return board.points if view == DIRECT else reflect(board.points, centres[view])


def _assign(
    boards: list[list[_PosedBoard]], centres: FloatArray, *, size_mm: float
) -> tuple[Observations, list[int], FloatArray]:
    """Return observations with frames numbered from 0, and the picture number and pose (4, 4) of each frame."""
    parts: list[Observations] = []
    frames: list[int] = []
    poses: list[FloatArray] = []
    for picture, boards_in_picture in enumerate(boards):
        views = _views(boards_in_picture, centres, size_mm=size_mm)
        if not views:
            continue
        first = min(views, key=lambda view: (len(views[view]), view))
        reference = views[first][0]
        reference_points = _in_rig(reference, first, centres)
        for view, options in views.items():
            # A board that looks the same upside down has two numberings, a part of a board even more; the view with the
            # fewest decides.
            points_in_rig = [_in_rig(option, view, centres) for option in options]
            best = min(range(len(options)), key=lambda i: float(np.abs(points_in_rig[i] - reference_points).sum()))
            corners = options[best].corners
            parts.append(Observations.of_view(len(frames), view, corners.ids, corners.pixels, corners.sigma_px))
        poses.append(
            reference.pose if first == DIRECT else initial_estimates.pose_from_image(reference.pose, centres[first])
        )
        frames.append(picture)
    return Observations.join(parts), frames, np.array(poses)
