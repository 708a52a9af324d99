"""Calibration of a camera that sees a board both directly and in its mirrors, with no layout to start from.

Each plane is seeded from the direct view: where the board stands and where its image stands tell the mirror between
them. Then one camera, 3 numbers per mirror and one pose per picture are solved jointly, first with the board as it was
drawn, then with its corners free: paper is printed and glued less exactly than its corners are seen here. A camera that
turned between the pictures is turned back by what stands still in them; mirrors are coated in front, or behind glass of
one thickness, as the corners tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull
from scipy.stats import f as f_distribution

from optics.calibration import bootstrap
from optics.calibration.detection.corners import Corners, Grey, confirm, find_checkerboards, orderings
from optics.calibration.evidence.uncertainty import mirror_covariance
from optics.calibration.observations import DIRECT, Observations
from optics.calibration.result import (
    Calibration,
    angle_between_mirrors,
    fit_metrics,
    uncertainty,
)
from optics.calibration.solver.model import Model
from optics.calibration.solver.residuals import Board, Estimate
from optics.calibration.solver.solve import BoolArray, Solution, UndeterminedError, fit
from optics.calibration.steadiness import camera_turns, steadied
from optics.camera import Camera
from optics.layout import Layout
from optics.mirror import Mirror, cut, reflect
from optics.targets import Checkerboard
from optics.transforms import transform
from optics.values import FloatArray, InputError, Metric

INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")
PAIR_MISFIT = 0.1  # of the board's diagonal: pose from one view is rough
SAME_PLANE = 0.1  # of the distance of the virtual centre
SHEET_START, GLASS_INDEX = 0.01, 1.52  # thickness in distances of the mirrors; soda-lime glass
GLASS_CHANCE = 1e-6


@dataclass(frozen=True)
class _Placed:
    """A numbering of a found board, the rigid 4x4 that puts it where it looks so, and its points (n, 3) there."""

    corners: Corners
    matrix: FloatArray
    points: FloatArray


@dataclass(frozen=True)
class _Board:
    """One found board, for each numbering as a direct view, and as an image in a mirror."""

    direct: list[_Placed]
    image: list[_Placed]


def calibrate_with_direct_view(
    pictures: Sequence[Grey],
    target: Checkerboard,
    *,
    mirrors: int,
    names: Sequence[str],
    on_picture: Callable[[int, int], None] | None = None,
) -> Calibration:
    """One camera and `mirrors` planes from pictures (h, w) that show a board directly and in the mirrors.

    Lengths come in the unit of `target.square_mm`; `names` are those of the pictures, for the notes. Raises InputError
    where the pictures do not suffice.
    """
    if not isinstance(target, Checkerboard):
        raise InputError("a direct view needs a plain checkerboard, got a ChArUco board")
    sizes = {picture.shape for picture in pictures}
    if len(sizes) != 1:
        raise InputError(f"pictures of {len(sizes)} sizes, expected pictures of one camera and size")
    found = []
    for number, picture in enumerate(pictures):
        found.append(find_checkerboards(picture, target, most=mirrors + 1))
        if on_picture is not None:
            on_picture(number + 1, len(pictures))
    if not any(found):
        raise InputError(f"no {target.cols} x {target.rows} checkerboard found in any of {len(pictures)} pictures")

    corners_mm = target.corners_in_board_mm
    camera = _first_camera(pictures, found, target)
    boards = [
        [board for grid in grids if (board := _placed(camera, picture, grid, target)) is not None]
        for picture, grids in zip(pictures, found, strict=True)
    ]
    centres = _seed_mirrors(boards, mirrors, size_mm=float(np.hypot(*target.size_mm)))
    observations, frames, poses = _assign(boards, centres)
    drawn, free_board = Board.rigid(corners_mm), Board.free(corners_mm)
    try:
        rigid = Model(INTRINSICS, sheet=False, bend=False, board=drawn)
        flat = fit(Estimate(camera, centres, poses), observations, rigid)
        observations = _confirmed(pictures, frames, flat, corners_mm, target, mirrors)
        flat = fit(flat.estimate, observations, rigid)
        turns = camera_turns([pictures[number] for number in frames], flat.estimate.camera)
        if turns is not None:
            still = steadied(observations, flat.estimate.camera, turns)
            again = fit(flat.estimate, still, rigid)
            if _squares(again) < _squares(flat):
                observations, flat = still, again
            else:
                turns = None
        flat = _behind_glass(flat, observations, rigid)
        start = replace(flat.estimate, shape=np.zeros(len(free_board.modes)))
        loose = Model(INTRINSICS, sheet=False, bend=False, board=free_board)
        if "sheet_mm" in flat.parameters:
            solution = fit(start, observations, replace(loose, sheet=True))
        else:
            solution = _behind_glass(fit(start, observations, loose), observations, loose)
    except UndeterminedError as error:
        raise InputError(f"the pictures do not determine camera and mirrors: {error}") from None
    return _result(solution, flat, free_board, observations, frames, names, turns)


def _squares(solution: Solution) -> float:
    return float(np.sum(solution.residuals**2))


def _behind_glass(plain: Solution, observations: Observations, model: Model) -> Solution:
    """The fit with mirrors coated behind one kind of glass where the corners leave no doubt of it, else `plain`."""
    estimate = plain.estimate
    distances = np.linalg.norm(estimate.virtual_centres_in_rig_mm, axis=1) / 2.0
    count = len(distances)
    start = replace(
        estimate,
        thickness_mm=np.full(count, SHEET_START * distances.mean()),
        refractive_index=np.full(count, GLASS_INDEX),
    )
    glass = fit(start, observations, replace(model, sheet=True))
    spare = 2 * int(glass.inliers.sum()) - len(glass.parameters) - 6 * len(estimate.rig_from_board)
    larger = _squares(glass)
    ratio = (_squares(plain) - larger) / (larger / spare)
    supported = f_distribution.sf(ratio, 1, spare) < GLASS_CHANCE and glass.estimate.thickness_mm[0] > 0.0
    return glass if supported else plain


def _first_camera(pictures: Sequence[Grey], found: list[list[FloatArray]], target: Checkerboard) -> Camera:
    views = [
        Corners(np.arange(len(target.corners_in_board_mm)), ordering)
        for picture, grids in zip(pictures, found, strict=True)
        for grid in grids
        for ordering in orderings(picture, grid, target, mirrored=False)[:1]
    ]
    height, width = pictures[0].shape
    return bootstrap.intrinsics(
        views, target.corners_in_board_mm, width_px=width, height_px=height, full_distortion=False
    )


def _placed(camera: Camera, picture: Grey, grid: FloatArray, target: Checkerboard) -> _Board | None:
    """The board in space, or None where its squares or its corners are not those of the target."""
    corners_mm = target.corners_in_board_mm

    def place(mirrored: bool) -> list[_Placed]:
        placed = []
        for ordering in orderings(picture, grid, target, mirrored=mirrored):
            view = Corners(np.arange(len(corners_mm)), ordering)
            matrix = bootstrap.camera_from_flat_board(camera, view, corners_mm)
            if matrix is not None:
                placed.append(_Placed(view, matrix, transform(matrix, corners_mm)))
        return placed

    direct, image = place(False), place(True)
    return _Board(direct, image) if direct and image else None


def _seed_mirrors(boards: list[list[_Board]], mirrors: int, *, size_mm: float) -> FloatArray:
    """Virtual centres (m, 3), left to right: the planes that most pictures agree on.

    Every ordered pair of boards in a picture proposes the plane that would show one as the other's image. True planes
    recur from picture to picture, chance ones do not.
    """
    proposals: list[tuple[int, FloatArray, float]] = []
    for number, in_picture in enumerate(boards):
        for a in in_picture:
            for b in in_picture:
                if a is b:
                    continue
                for direct in a.direct:
                    for image in b.image:
                        centre, misfit = bootstrap.virtual_centre_between(direct.points, image.points)
                        in_front = not bootstrap.behind(direct.points, centre)
                        if misfit < PAIR_MISFIT * size_mm and in_front:
                            proposals.append((number, centre, misfit))
    chosen: list[FloatArray] = []
    while len(chosen) < mirrors and proposals:
        support = [len({n for n, other, _ in proposals if _same_plane(centre, other)}) for _, centre, _ in proposals]
        best = min(range(len(proposals)), key=lambda i: (-support[i], proposals[i][2]))
        members = [centre for _, centre, _ in proposals if _same_plane(proposals[best][1], centre)]
        chosen.append(np.median(members, axis=0))
        proposals = [p for p in proposals if not _same_plane(proposals[best][1], p[1])]
    if len(chosen) < mirrors:
        raise InputError(
            f"the pictures show {len(chosen)} mirrors, expected {mirrors}: the board must be seen directly and in each "
            "mirror in at least one picture"
        )
    return np.array(sorted(chosen, key=lambda centre: centre[0]))


def _same_plane(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.linalg.norm(a - b) < SAME_PLANE * np.linalg.norm(a))


def _assign(boards: list[list[_Board]], centres: FloatArray) -> tuple[Observations, list[int], FloatArray]:
    """Which board is which view. A board behind no plane is the direct view, behind one plane the image in it.

    Boards behind several planes were reflected more than once and are left out. Returns observations with frames
    numbered from 0, the picture number of each frame, and a pose (4, 4) per frame.
    """
    parts: list[Observations] = []
    frames: list[int] = []
    poses: list[FloatArray] = []
    for number, in_picture in enumerate(boards):
        views: dict[int, list[_Placed]] = {}
        for board in in_picture:
            hidden_by = [m for m, centre in enumerate(centres) if bootstrap.behind(board.direct[0].points, centre)]
            if len(hidden_by) == 0:
                views.setdefault(DIRECT, board.direct)
            elif len(hidden_by) == 1:
                views.setdefault(hidden_by[0], board.image)
        if not views:
            continue
        first = min(views)
        reference = views[first][0]
        reference_points = reference.points if first == DIRECT else reflect(reference.points, centres[first])
        for view, options in views.items():
            # A board that looks the same upside down has two numberings; the one that agrees with the first view is it.
            places = [p.points if view == DIRECT else reflect(p.points, centres[view]) for p in options]
            best = min(range(len(options)), key=lambda i: float(np.abs(places[i] - reference_points).sum()))
            corners = options[best].corners
            parts.append(Observations.of_view(len(frames), view, corners.ids, corners.pixels))
        poses.append(reference.matrix if first == DIRECT else bootstrap.before_mirror(reference.matrix, centres[first]))
        frames.append(number)
    return Observations.join(parts), frames, np.array(poses)


def _confirmed(
    pictures: Sequence[Grey],
    frames: list[int],
    solution: Solution,
    corners_mm: FloatArray,
    target: Checkerboard,
    mirrors: int,
) -> Observations:
    """All corners of all views, found again where the first fit predicts them: completes partly hidden boards."""
    parts = []
    for frame, number in enumerate(frames):
        pose = solution.estimate.rig_from_board[frame]
        points = transform(pose, corners_mm)
        for view in range(DIRECT, mirrors):
            seen = points if view == DIRECT else reflect(points, solution.estimate.virtual_centres_in_rig_mm[view])
            predicted = solution.estimate.camera.project(seen)
            if not np.isfinite(predicted).all():
                continue
            corners = confirm(pictures[number], predicted, target)
            if len(corners):
                parts.append(Observations.of_view(frame, view, corners.ids, corners.pixels))
    return Observations.join(parts)


def _result(
    solution: Solution,
    flat: Solution,
    board: Board,
    observations: Observations,
    frames: list[int],
    names: Sequence[str],
    turns: FloatArray | None,
) -> Calibration:
    estimate = solution.estimate
    mirrors, corners_mm = len(estimate.virtual_centres_in_rig_mm), board.corners_in_board_mm
    metrics = fit_metrics(observations, solution)
    for axis, rms in zip("xy", flat.rms_px, strict=True):
        metrics[f"flat_board_rms_{axis}_px"] = Metric(value=rms, unit="px")
    shift = board.shaped(estimate.shape) - corners_mm
    metrics["board_shift_in_plane_rms_mm"] = Metric(
        value=np.sqrt(np.mean(np.sum(shift[:, :2] ** 2, axis=1))), unit="mm"
    )
    metrics["board_warp_rms_mm"] = Metric(value=np.sqrt(np.mean(shift[:, 2] ** 2)), unit="mm")
    if turns is not None:
        farthest = estimate.camera.fx_px * float(np.linalg.norm(turns - turns[0], axis=1).max())
        metrics["camera_turned_px"] = Metric(value=farthest, unit="px")
    if "sheet_mm" in solution.parameters:
        place = solution.parameters.index("sheet_mm")
        metrics["sheet_mm"] = Metric(value=estimate.thickness_mm[0], unit="mm")
        metrics["sheet_sigma_mm"] = Metric(value=np.sqrt(solution.covariance[place, place]), unit="mm")
    known = uncertainty(solution)
    covariance = mirror_covariance(known)
    for a in range(mirrors):
        for b in range(a + 1, mirrors):
            rows = [*range(3 * a, 3 * a + 3), *range(3 * b, 3 * b + 3)]
            angle, sigma = angle_between_mirrors(
                estimate.virtual_centres_in_rig_mm[a],
                estimate.virtual_centres_in_rig_mm[b],
                covariance[np.ix_(rows, rows)],
            )
            metrics[f"mirrors_{a}_{b}_angle_deg"] = Metric(value=np.degrees(angle), unit="deg")
            metrics[f"mirrors_{a}_{b}_angle_sigma_deg"] = Metric(value=np.degrees(sigma), unit="deg")
    notes = []
    used = 0
    for number, picture in enumerate(names):
        if number not in frames:
            notes.append(f"{picture}: no board found, not used")
            continue
        in_picture = observations.where(observations.frame == frames.index(number))
        for view in range(DIRECT, mirrors):
            name = "direct view" if view == DIRECT else f"mirror {view}"
            count = int((in_picture.view == view).sum())
            used += count > 0
            if count == 0:
                notes.append(f"{picture}: {name} not found")
            elif count < len(corners_mm):
                notes.append(f"{picture}: {name} shows {count} of {len(corners_mm)} corners")
    metrics["views"] = Metric(value=used, unit="1")
    layout = Layout(
        kind="calibrated",
        rows=1,
        cols=mirrors,
        camera=estimate.camera,
        mirrors=tuple(_seen_mirror(estimate, observations, solution.inliers, m) for m in range(mirrors)),
        view_from_rig=np.eye(3),
        metrics=metrics,
        provenance={"source": "pictures of a checkerboard seen directly and in the mirrors"},
        uncertainty=known,
    )
    return Calibration(
        layout=layout,
        rig_from_board=estimate.rig_from_board,
        observations=observations,
        residuals_px=solution.residuals,
        inliers=solution.inliers,
        metrics=metrics,
        notes=tuple(notes),
    )


def _seen_mirror(estimate: Estimate, observations: Observations, inliers: BoolArray, mirror: int) -> Mirror:
    """The mirror, cut to the convex hull of where corners were seen in it: nothing is known beyond."""
    centre = estimate.virtual_centres_in_rig_mm[mirror]
    pixels = observations.pixels[inliers & (observations.view == mirror)]
    normalized = estimate.camera.normalized_from_pixels(pixels)
    hull = normalized[ConvexHull(normalized).vertices]
    glass = estimate.thickness_mm[mirror] > 0.0
    sheet = {"surface": "second", "thickness_mm": estimate.thickness_mm[mirror]} if glass else {}
    index = {"refractive_index": estimate.refractive_index[mirror]} if glass else {}
    return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=cut(hull, centre), **sheet, **index)
