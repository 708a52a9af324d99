"""Consistency of the observed corners before a calibration, and plausibility of the finished fit.

A refusal is an InputError that states the observation, where it was made, and a remedy. Anything else is a note.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import cell_px
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, IntArray, Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

MIN_CORNERS_PER_MIRROR = 20
MAX_LISTED = 8  # frames that notes name one by one
MAX_SHIFT_CELLS = 0.5  # a corner farther from its prediction is closer to another corner's prediction
MAX_SHIFTED_VIEWS = 0.2  # fraction of all views above which all pictures are refused
MAX_SHIFTED_IN_MIRROR = 0.5  # the same for the views of one mirror
MAX_OFF_PLANE = 0.1  # the same for corners
MAX_FOCAL_CHANGE = 0.003  # relative, between frames with and without mirrors
PLAIN_INTRINSICS = 9  # of a Brown-Conrady lens
MAX_OUTLIERS = 0.1  # fraction of all corners
MAX_NORMAL_DEG, MAX_DISTANCE = 1.0, 0.05  # sigmas above which linear error bounds are invalid
MIN_TILT_DEG = 5.0
MAX_FOCAL_DIFFERENCE = 0.05  # relative
MAX_FOCAL_SIGMA = 0.05  # relative, of a bare camera, above which linear error bounds are invalid


def check_mirror_counts(mirrored: Observations, frames: int, mirrors: Sequence[str]) -> None:
    """Raise InputError if a named mirror shows too few corners in all `frames` frames together."""
    if not len(mirrored):
        raise InputError(f"no corner of the board found in any of {frames} frames")
    counts = np.bincount(mirrored.view[mirrored.view != DIRECT], minlength=len(mirrors))
    worst = int(counts.argmin())
    if counts[worst] < MIN_CORNERS_PER_MIRROR:
        raise InputError(
            f"mirror {mirrors[worst]} shows {counts[worst]} corners in {frames} frames, expected "
            f"{MIN_CORNERS_PER_MIRROR}"
        )


def missing_views(
    mirrored: Sequence[Observations], base: Sequence[Observations], names: Sequence[str], mirrors: Sequence[str]
) -> tuple[str, ...]:
    """Note frames without a board, and views of the others that show none.

    `names` are the names of all frames, `mirrored` first. Of a view that shows none in more than `MAX_LISTED` frames,
    only their number is noted.
    """
    notes = [
        f"{name}: no board found, not used" for name, o in zip(names, (*mirrored, *base), strict=True) if not len(o)
    ]
    used = {name: o.view for name, o in zip(names, mirrored, strict=False) if len(o)}
    expected = [DIRECT] * any(DIRECT in view for view in used.values()) + list(range(len(mirrors)))
    missing = {view: [name for name, shown in used.items() if view not in shown] for view in expected}
    for view, absent in missing.items():
        if len(absent) > MAX_LISTED:
            where = "the direct view" if view == DIRECT else f"mirror {mirrors[view]}"
            notes.append(f"no board found in {where} in {len(absent)} of {len(used)} frames")
    for name in used:
        listed = [view for view, absent in missing.items() if name in absent and len(absent) <= MAX_LISTED]
        in_mirrors = ", ".join(mirrors[view] for view in listed if view != DIRECT)
        places = ["the direct view"] * (DIRECT in listed) + [f"mirror {in_mirrors}"] * bool(in_mirrors)
        if places:
            notes.append(f"{name}: no board found in {' and '.join(places)}")
    return tuple(notes)


def unobserved_rows(frames: Sequence[Observations], corners_in_board_mm: FloatArray) -> tuple[str, ...]:
    """Note rows at the end of the board that no picture shows: the board may be shorter and otherwise the same.

    For a board of tags, which are numbered from below, these are the first rows.
    """
    heights = np.unique(corners_in_board_mm[:, 1])
    observed = np.concatenate([corners_in_board_mm[o.corner, 1] for o in frames])
    if not len(observed):
        return ()
    if np.allclose(np.diff(heights), heights[1] - heights[0]):
        missing, rows = int((heights > observed.max()).sum()), len(heights) + 1
        end, part, cells = "last", f"{rows - 1} rows of corners", "squares"
    else:
        missing, rows = int((heights < observed.min()).sum()) // 2, len(heights) // 2
        end, part, cells = "first", f"{rows} rows of tags", "tags"
    if not missing:
        return ()
    ends = end if missing == 1 else f"{end} {missing}"
    return (
        f"no picture shows the {ends} of the board's {part}: does it have {rows - missing} rows of {cells}, "
        f"not {rows}?",
    )


def repeated_frames(frames: Sequence[Observations]) -> dict[int, int]:
    """Map each frame that repeats an earlier one to the first frame with the same corners at the same pixels.

    Noise makes two pictures differ, so a repeated frame is one picture given twice, which would make the error bounds
    too narrow.
    """
    first: dict[bytes, int] = {}
    repeats = {}
    for number, o in enumerate(frames):
        if not len(o):
            continue
        key = o.view.tobytes() + o.corner.tobytes() + o.pixels.tobytes()
        if key in first:
            repeats[number] = first[key]
        first.setdefault(key, number)
    return repeats


def off_plane_corners(observations: Observations, camera: Camera, corners_in_board_mm: FloatArray) -> BoolArray:
    """Mask (n,) of corners that contradict the homography through the other corners of their view.

    An undistorted picture of a flat board is a homography of it, in any mirror. In a view where at most half of the
    corners agree, all are marked.
    """
    normalized = camera.normalized_from_pixels(observations.pixels)
    ideal = normalized * [camera.fx_px, camera.fy_px]
    off_plane: BoolArray = np.isnan(ideal[:, 0])
    for rows in _view_rows(observations):
        rows = rows[~off_plane[rows]]
        if len(rows) < MIN_CORNERS:
            off_plane[rows] = True
            continue
        board = corners_in_board_mm[observations.corner[rows], :2]
        max_distance = MAX_SHIFT_CELLS * float(np.median(cell_px(ideal[rows])))
        matrix, fitting = cv2.findHomography(board, ideal[rows], cv2.RANSAC, max_distance)
        fits = np.zeros(len(rows), dtype=bool) if matrix is None else fitting.ravel().astype(bool)
        off_plane[rows] = ~fits if fits.mean() > 0.5 else True
    return off_plane


def board_notes(
    observations: Observations, off_plane: BoolArray, names: Sequence[str], mirrors: Sequence[str]
) -> tuple[str, ...]:
    """Return notes on the corners marked by `off_plane_corners`; `names` are the frames' names.

    Raises InputError if there are so many that the pictures must show a different board.
    """
    if len(off_plane) and off_plane.mean() > MAX_OFF_PLANE:
        raise InputError(
            f"{off_plane.mean():.0%} of the corners lie where a flat board of this drawing has none, expected under "
            f"{MAX_OFF_PLANE:.0%}: are rows, columns and markers as in board, and is one board in view?"
        )
    notes = []
    for rows in _view_rows(observations):
        if off_plane[rows].any():
            where = _view_name(observations, rows, names, mirrors)
            notes.append(
                f"{where}: {int(off_plane[rows].sum())} of {len(rows)} corners off the board's plane, not used"
            )
    return tuple(notes)


def consistent_views(
    observations: Observations, residuals_px: FloatArray, names: Sequence[str], mirrors: Sequence[str]
) -> tuple[BoolArray, tuple[str, ...]]:
    """Keep the views that agree with the other views of their frame on the board's pose.

    A frame is dropped if half of its views or more disagree.

    Parameters
    ----------
    observations
        The corners (n).
    residuals_px
        Their residuals (n, 2) to a robust fit.
    names, mirrors
        Names of the frames and of the mirrors.

    Returns
    -------
    consistent, notes
        Mask (n,) of the rows to keep, and a note on each dropped view or frame.

    Raises
    ------
    InputError
        If many views, or most views of one mirror, disagree.
    """
    groups = _view_rows(observations)
    if not groups:
        return np.ones(0, dtype=bool), ()
    shift = np.array([_shift_in_cells(observations.pixels[rows], residuals_px[rows]) for rows in groups])
    frame = np.array([observations.frame[rows[0]] for rows in groups])
    view = np.array([observations.view[rows[0]] for rows in groups])
    shifted = shift > MAX_SHIFT_CELLS
    contradictory = [number for number in np.unique(frame[shifted]) if shifted[frame == number].mean() >= 0.5]
    shifted |= np.isin(frame, contradictory)
    _refuse_many_shifted(shifted, shift, view, mirrors)
    notes = [f"{names[number]}: its views disagree on the board's pose, not used" for number in contradictory]
    consistent = np.ones(len(observations), dtype=bool)
    for rows, is_shifted, cells in zip(groups, shifted, shift, strict=True):
        if is_shifted:
            consistent[rows] = False
            if observations.frame[rows[0]] not in contradictory:
                where = _view_name(observations, rows, names, mirrors)
                notes.append(f"{where}: shows the board elsewhere than other views ({cells:.1f} squares), not used")
    return consistent, tuple(notes)


def _refuse_many_shifted(shifted: BoolArray, shift: FloatArray, view: IntArray, mirrors: Sequence[str]) -> None:
    """Raise InputError if too many of all views (k,), or of one mirror's views, show the board `shifted`."""
    cause = "two boards in view, a board that moved, or pictures of a different device?"
    if shifted.mean() > MAX_SHIFTED_VIEWS:
        raise InputError(
            f"{int(shifted.sum())} of {len(view)} views disagree with others of their frames on the board's position "
            f"by {np.median(shift[shifted]):.1f} squares: {cause}"
        )
    for mirror in np.unique(view[shifted]):
        in_mirror = view == mirror
        if shifted[in_mirror].mean() > MAX_SHIFTED_IN_MIRROR:
            name = "the direct view" if mirror == DIRECT else f"mirror {mirrors[mirror]}"
            raise InputError(
                f"{name} disagrees with the other views on the board's position in "
                f"{int(shifted[in_mirror].sum())} of {int(in_mirror.sum())} frames: {cause}"
            )


def _view_rows(observations: Observations) -> list[IntArray]:
    """Row indices of each view of each frame, ordered by frame and view."""
    order = np.lexsort((observations.view, observations.frame))
    changes = np.flatnonzero(np.diff(observations.frame[order]) | np.diff(observations.view[order])) + 1
    return [rows for rows in np.split(order, changes) if len(rows)]


def _shift_in_cells(pixels: FloatArray, residuals_px: FloatArray) -> float:
    if len(pixels) < 2:
        return 0.0
    size = np.median(np.linalg.norm(residuals_px, axis=1))
    return float(size / np.median(cell_px(pixels))) if np.isfinite(size) else float("inf")


def _view_name(observations: Observations, rows: IntArray, names: Sequence[str], mirrors: Sequence[str]) -> str:
    view = observations.view[rows[0]]
    name = names[observations.frame[rows[0]]]
    return name if view == DIRECT else f"{name}, mirror {mirrors[view]}"


def camera_disagreement(
    separate_residuals: Sequence[FloatArray], common_residuals: FloatArray, *, unknowns: int, common: int
) -> float:
    """Disagreement of two sets of frames on the camera, in sigmas (about 1 if they agree).

    The square is the F statistic of G. C. Chow's test (Econometrica 28, 591, 1960) for nine intrinsics. For more
    intrinsics, the excess over its expectation is treated as if there were nine.

    Parameters
    ----------
    separate_residuals
        Residuals (n, 2) of a fit to each set alone.
    common_residuals
        Residuals (n, 2) of a common fit to the same corners.
    unknowns
        Number of parameters of the separate fits.
    common
        Number of parameters shared in the common fit: the intrinsics.
    """
    separate = np.concatenate([r.ravel() for r in separate_residuals])
    noise = float(separate @ separate) / max(separate.size - unknowns, 1)
    increase = float(np.sum(common_residuals**2)) - float(separate @ separate)
    # Otherwise, for a lens with many parameters, those that agree would hide the few that disagree.
    excess = increase / noise - common
    return float(np.sqrt(max(1.0 + excess / PLAIN_INTRINSICS, 0.0)))


def drift_note(disagreement: float, focal_px: tuple[float, float]) -> tuple[str, ...]:
    """Note a disagreement about the camera between frames with and without mirrors, if it is more than 1 sigma.

    `focal_px` are the focal lengths with and without mirrors. Raises InputError if they differ too much for one camera.
    """
    if disagreement <= 1.0:
        return ()
    if abs(focal_px[0] / focal_px[1] - 1.0) > MAX_FOCAL_CHANGE:
        raise InputError(
            f"frames with mirrors show a focal length of {focal_px[0]:.1f} px, frames without {focal_px[1]:.1f} px, "
            f"expected within {MAX_FOCAL_CHANGE:.1%}; take both with one camera, focus and zoom fixed"
        )
    return (
        f"frames with and without mirrors disagree about the camera by {disagreement:.1f} sigmas, as if its focus had "
        "changed between them: all error bounds are widened by this factor",
    )


def pose_notes(rig_from_board: FloatArray) -> tuple[str, ...]:
    """Return notes on poses (f, 4, 4) of the board that make the error bounds wider than necessary."""
    if len(rig_from_board) == 1:
        return ("one picture through the mirrors: it cannot be checked against another, take more",)
    normals = rig_from_board[:, :3, 2]
    cosines = normals @ np.linalg.svd(normals)[2][0]
    widest = float(np.degrees(np.arccos(np.clip(np.abs(cosines).min(), 0.0, 1.0))))
    if widest < MIN_TILT_DEG:
        return (f"all boards are parallel to within {widest:.1f} deg: tilt some by 20 deg or more for tighter bounds",)
    return ()


def camera_note(layout: Layout, camera: Camera) -> tuple[str, ...]:
    """Note a focal length that differs from the layout's."""
    ratio = camera.fx_px / layout.camera.fx_px
    if abs(ratio - 1.0) < MAX_FOCAL_DIFFERENCE:
        return ()
    return (
        f"focal length {camera.fx_px:.1f} px, {ratio - 1.0:+.0%} from the layout's {layout.camera.fx_px:.1f}: "
        "a different camera, zoom or crop from the one that the layout was designed for",
    )


def refuse_implausible(solution: Solution, mirrors: Sequence[str]) -> None:
    """Raise InputError if too many corners are outliers, or a mirror is too uncertain for linear error bounds."""
    outliers = float((~solution.inliers).mean())
    if outliers > MAX_OUTLIERS:
        raise InputError(
            f"{outliers:.0%} of the corners fit {'neither mirrors nor' if mirrors else 'no'} camera, expected under "
            f"{MAX_OUTLIERS:.0%}: are all pictures of one {'device, one ' if mirrors else ''}camera and one board?"
        )
    for m, centre in enumerate(solution.estimate.virtual_centres_in_rig_mm):
        rows = [
            index for index, name in enumerate(solution.parameters) if name in {f"mirror {m} {a}_mm" for a in "xyz"}
        ]
        length = float(np.linalg.norm(centre))
        unit, block = centre / length, solution.covariance[np.ix_(rows, rows)]
        distance_sigma = np.sqrt(max(float(unit @ block @ unit), 0.0)) / length
        normal_deg = np.degrees(
            np.sqrt(max(float(np.trace(block)) - (distance_sigma * length) ** 2, 0.0) / 2.0) / length
        )
        if not (normal_deg < MAX_NORMAL_DEG and distance_sigma < MAX_DISTANCE):
            raise InputError(
                f"the pictures determine mirror {mirrors[m]} only to {normal_deg:.2g} deg and {distance_sigma:.2g} "
                f"of its distance, expected under {MAX_NORMAL_DEG:g} deg and {MAX_DISTANCE:g}: show it the board "
                "tilted and nearer"
            )


def _refuse_unknown_focal_length(solution: Solution) -> None:
    """Raise InputError if the focal length of a bare camera is too uncertain for linear error bounds."""
    index = solution.parameters.index("fx_px")
    sigma = float(np.sqrt(solution.covariance[index, index])) / solution.estimate.camera.fx_px
    if not sigma < MAX_FOCAL_SIGMA:
        raise InputError(
            f"the pictures determine the focal length only to {sigma:.0%}, expected under {MAX_FOCAL_SIGMA:.0%}: take "
            "more of the board, tilted by 30 deg about both axes"
        )


def check_plausible(solution: Solution, layout: Layout, *, mirrored_frames: int) -> tuple[str, ...]:
    """Check a finished fit against its layout.

    Parameters
    ----------
    solution
        The fit, with mirrored frames first.
    layout
        The nominal layout.
    mirrored_frames
        Number of frames with mirrors.

    Returns
    -------
    notes
        Doubts about the fit, one sentence each.

    Raises
    ------
    InputError
        If the fit is implausible.
    """
    refuse_implausible(solution, layout.mirror_names)
    estimate = solution.estimate
    if not layout.mirrors:
        _refuse_unknown_focal_length(solution)
    return (
        *pose_notes(estimate.rig_from_board[:mirrored_frames]),
        *camera_note(layout, estimate.camera),
    )
