"""What makes a calibration wrong or unsure, told from its corners and fits: refused in one line, or noted.

A refusal is an InputError that says what was seen, where, and what to do. All else comes back as notes, for the user.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.detection.checkerboard import cell_px
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, IntArray, Observations
from mirrorcam.optics.geometry.camera import INTRINSIC_NAMES, Camera
from mirrorcam.optics.geometry.layout import Layout

MIN_CORNERS_PER_MIRROR = 20
ELSEWHERE_CELLS = 0.5  # a corner seen farther than this from its prediction is nearer to another corner's
MOST_ELSEWHERE = 0.2  # of all views, or of a mirror's, before the pictures as a whole are not believed
MOST_ODD_CORNERS = 0.1  # of all corners, alike
SAME_CAMERA = 5.0  # sigmas, rms over the intrinsics, between frames with and without mirrors
# Sigmas between them past which error bounds widen, which chance makes once in 1,000 times, and past which it is said:
# errors of corners in one view are alike, so that up to about 2.5 is seen of good sets.
DRIFT_WIDENS, DRIFT_NOTED = 1.8, 3.0
# How far a device strays from its layout before its pictures are doubted, as standard deviations.
PLACED_MM, TILTED_DEG, CAMERA_MM, CAMERA_DEG = 0.5, 0.5, 1.0, 1.0
SCALE_SIGMAS, SCALE_REFUSED, SCALE_NOTED = 4.0, 0.03, 0.01
WIDEST_NORMAL_DEG, WIDEST_DISTANCE = 1.0, 0.05  # sigmas past which a linear error bound says nothing
PARALLEL_DEG = 5.0
OTHER_FOCAL = 0.05  # relative


def enough_mirrors(layout: Layout) -> None:
    """Raise InputError for mirrors whose planes meet in one line, as any two do.

    Turned together about that line, with the boards, they show the very same pictures: with virtual images S_i B of
    boards B, S_i Q is a reflection for every turn Q about a line in plane i, and (S_i Q)(Q^-1 B) = S_i B.
    """
    if len(layout.mirrors) < 3:
        raise InputError(
            f"{len(layout.mirrors)} mirrors without a direct view of the board, expected 3 or more: no picture tells "
            "how they are turned about the line where their planes meet"
        )


def every_mirror_shown(mirrored: Observations, frames: int, mirrors: int) -> None:
    """Raise InputError for a mirror in which `frames` frames show too few corners, or none, of the board."""
    if not len(mirrored):
        raise InputError(f"no corner of the board found in any of {frames} frames")
    counts = np.bincount(mirrored.view, minlength=mirrors)
    worst = int(counts.argmin())
    if counts[worst] < MIN_CORNERS_PER_MIRROR:
        raise InputError(
            f"mirror {worst} shows {counts[worst]} corners in {frames} frames, expected {MIN_CORNERS_PER_MIRROR}"
        )


def repeats(frames: Sequence[Observations]) -> dict[int, int]:
    """Which frames show corners that an earlier one shows at the very same pixels, and which one.

    Two pictures never agree to the last digit: it is one picture given twice, and counting it twice would make the
    error bounds too narrow.
    """
    first: dict[bytes, int] = {}
    found = {}
    for number, o in enumerate(frames):
        if not len(o):
            continue
        key = o.view.tobytes() + o.corner.tobytes() + o.pixels.tobytes()
        if key in first:
            found[number] = first[key]
        first.setdefault(key, number)
    return found


def odd_corners(observations: Observations, camera: Camera, corners_in_board_mm: FloatArray) -> BoolArray:
    """Rows (n,) that do not lie where their own view's others put them: a flat board's picture is a homography.

    This asks neither where the mirrors nor where the board are. A view in which fewer than half of the corners agree is
    odd as a whole.
    """
    normalized = camera.normalized_from_pixels(observations.pixels)
    ideal = normalized * [camera.fx_px, camera.fy_px]
    odd: BoolArray = np.isnan(ideal[:, 0])
    for rows in _by_view(observations):
        rows = rows[~odd[rows]]
        if len(rows) < MIN_CORNERS:
            odd[rows] = True
            continue
        board = corners_in_board_mm[observations.corner[rows], :2]
        reach = ELSEWHERE_CELLS * float(np.median(cell_px(ideal[rows])))
        matrix, fitting = cv2.findHomography(board, ideal[rows], cv2.RANSAC, reach)
        fits = np.zeros(len(rows), dtype=bool) if matrix is None else fitting.ravel().astype(bool)
        odd[rows] = ~fits if fits.mean() > 0.5 else True
    return odd


def board_fits(observations: Observations, odd: BoolArray, names: Sequence[str]) -> tuple[str, ...]:
    """Notes on the odd corners of `odd_corners`; `names` are those of the frames.

    Raises InputError where there are too many for the board to be the one in the pictures.
    """
    if len(odd) and odd.mean() > MOST_ODD_CORNERS:
        raise InputError(
            f"{odd.mean():.0%} of the corners lie where no flat board of this drawing has them, expected under "
            f"{MOST_ODD_CORNERS:.0%}: are rows, columns and markers those of board.toml, and is one board in view?"
        )
    notes = []
    for rows in _by_view(observations):
        if odd[rows].any():
            where = _place(observations, rows, names)
            notes.append(f"{where}: {int(odd[rows].sum())} of {len(rows)} corners off the board's plane, not used")
    return tuple(notes)


def agreeing_views(
    observations: Observations, residuals_px: FloatArray, names: Sequence[str]
) -> tuple[BoolArray, tuple[str, ...]]:
    """Rows (n,) of the views that show the board where the others of their frame do, and notes on those that do not.

    `residuals_px` (n, 2) are those of a robust fit. A frame in which half of the views or more disagree is left out as
    a whole. Raises InputError where many views of all, or of one mirror, disagree.
    """
    groups = _by_view(observations)
    if not groups:
        return np.ones(0, dtype=bool), ()
    shift = np.array([_shift_in_cells(observations.pixels[rows], residuals_px[rows]) for rows in groups])
    frame = np.array([observations.frame[rows[0]] for rows in groups])
    view = np.array([observations.view[rows[0]] for rows in groups])
    elsewhere = shift > ELSEWHERE_CELLS
    torn = [number for number in np.unique(frame[elsewhere]) if elsewhere[frame == number].mean() >= 0.5]
    elsewhere |= np.isin(frame, torn)
    cause = "two boards in view, a board that moved, or pictures of another device?"
    if elsewhere.mean() > MOST_ELSEWHERE:
        raise InputError(
            f"{int(elsewhere.sum())} of {len(groups)} views show the board elsewhere than the others of their frames, "
            f"by {np.median(shift[elsewhere]):.1f} squares: {cause}"
        )
    for mirror in np.unique(view[elsewhere]):
        of = view == mirror
        if elsewhere[of].mean() > max(MOST_ELSEWHERE, 0.5):
            raise InputError(
                f"mirror {mirror} shows the board elsewhere than the other views in {int(elsewhere[of].sum())} of "
                f"{int(of.sum())} frames: {cause}"
            )
    notes = [f"{names[number]}: its views do not agree on one place of the board, not used" for number in torn]
    kept = np.ones(len(observations), dtype=bool)
    for rows, away, by in zip(groups, elsewhere, shift, strict=True):
        if away:
            kept[rows] = False
            if observations.frame[rows[0]] not in torn:
                where = _place(observations, rows, names)
                notes.append(f"{where}: shows the board elsewhere than other views ({by:.1f} squares), not used")
    return kept, tuple(notes)


def _by_view(observations: Observations) -> list[IntArray]:
    """The rows of each view of each frame, by frame and view."""
    order = np.lexsort((observations.view, observations.frame))
    changes = np.flatnonzero(np.diff(observations.frame[order]) | np.diff(observations.view[order])) + 1
    return [rows for rows in np.split(order, changes) if len(rows)]


def _shift_in_cells(pixels: FloatArray, residuals_px: FloatArray) -> float:
    if len(pixels) < 2:
        return 0.0
    size = np.median(np.linalg.norm(residuals_px, axis=1))
    return float(size / np.median(cell_px(pixels))) if np.isfinite(size) else float("inf")


def _place(observations: Observations, rows: IntArray, names: Sequence[str]) -> str:
    view = observations.view[rows[0]]
    name = names[observations.frame[rows[0]]]
    return name if view == DIRECT else f"{name}, mirror {view}"


def camera_disagreement(apart: Sequence[FloatArray], together: FloatArray, *, unknowns: int) -> float:
    """How much worse one camera explains frames with and without mirrors than a camera each, in sigmas (1 expected).

    `apart` are the residuals (n, 2) of a fit to either kind alone, `together` (n, 2) those of a common fit to the same
    corners, `unknowns` how many parameters the fits apart had. The square is the F of G. C. Chow's test (Econometrica
    28, 591, 1960).
    """
    separate = np.concatenate([r.ravel() for r in apart])
    noise = float(separate @ separate) / max(separate.size - unknowns, 1)
    worse = float(np.sum(together**2)) - float(separate @ separate)
    return float(np.sqrt(max(worse, 0.0) / len(INTRINSIC_NAMES) / noise))


def drift_note(disagreement: float, focal_px: tuple[float, float]) -> tuple[str, ...]:
    """A note where frames with and without mirrors disagree about the camera by more sigmas than chance makes it.

    `focal_px` is what either kind says. Raises InputError where it cannot be one camera.
    """
    if disagreement > SAME_CAMERA:
        raise InputError(
            f"frames with mirrors show a focal length of {focal_px[0]:.1f} px, frames without {focal_px[1]:.1f} px: "
            f"one camera does not explain both ({disagreement:.0f} sigmas); take both with one camera, focus and zoom "
            "fixed"
        )
    if disagreement <= DRIFT_NOTED:
        return ()
    return (
        f"frames with and without mirrors disagree about the camera by {disagreement:.1f} sigmas, as if its focus had "
        "changed between them: all error bounds are that much wider",
    )


def common_scale(layout: Layout, virtual_centres: FloatArray) -> tuple[float, float]:
    """How much larger all lengths are than in the nominal layout, as a factor, and its standard deviation.

    Virtual centres (m, 3) against nominal ones, by least squares over one factor, a shifted and turned camera, and each
    mirror set and tilted on its own, with what a device strays by as a prior. Where it strays more, the standard
    deviation grows with it.
    """
    nominal = layout.virtual_centres_in_rig_mm
    count = len(nominal)
    normals = -nominal / np.linalg.norm(nominal, axis=1, keepdims=True)
    lengths = np.linalg.norm(nominal, axis=1)
    factor = nominal.reshape(-1, 1)
    # A pupil that sits t away from where it should sees each plane n.t nearer, so its virtual centre moves 2 (n.t) n.
    camera_shift = (2.0 * normals[:, :, None] * normals[:, None, :]).reshape(-1, 3)
    camera_turn = np.array([np.cross(axis, nominal).ravel() for axis in np.eye(3)]).T
    design = np.concatenate([factor, camera_shift, camera_turn], axis=1)
    spread = np.zeros((count, 3, 3))
    for m, (normal, length) in enumerate(zip(normals, lengths, strict=True)):
        along = np.outer(normal, normal)
        spread[m] = (2.0 * PLACED_MM) ** 2 * along + (np.radians(TILTED_DEG) * length) ** 2 * (np.eye(3) - along)
    whiten = np.linalg.inv(np.linalg.cholesky(spread))
    rows = np.einsum("mij,mjk->mik", whiten, design.reshape(count, 3, -1)).reshape(3 * count, -1)
    seen = np.einsum("mij,mj->mi", whiten, virtual_centres - nominal).ravel()
    prior = np.concatenate([[0.0], np.full(3, 1.0 / CAMERA_MM), np.full(3, 1.0 / np.radians(CAMERA_DEG))])
    rows, seen = np.concatenate([rows, np.diag(prior)[1:]]), np.concatenate([seen, np.zeros(6)])
    solution = np.linalg.lstsq(rows, seen, rcond=None)[0]
    misfit = rows @ solution - seen
    strays = max(1.0, float(np.sqrt(misfit @ misfit / max(3 * count - 1, 1))))
    sigma = strays * float(np.sqrt(np.linalg.inv(rows.T @ rows)[0, 0]))
    return 1.0 + float(solution[0]), sigma


def scale_note(layout: Layout, virtual_centres: FloatArray) -> tuple[str, ...]:
    """A note where all lengths seem to be off alike; raises InputError where the board's square size must be wrong."""
    factor, sigma = common_scale(layout, virtual_centres)
    off = abs(factor - 1.0)
    told = (
        f"all lengths come out {factor:.3f} (+-{sigma:.3f}) times those of the nominal layout: measure the board, "
        f"square_mm may have to be {1.0 / factor:.3f} times what it says"
    )
    if off > max(SCALE_REFUSED, SCALE_SIGMAS * sigma):
        raise InputError(told)
    return (told,) if off > max(SCALE_NOTED, 2.0 * sigma) else ()


def pose_notes(rig_from_board: FloatArray) -> tuple[str, ...]:
    """Notes on poses (f, 4, 4) of the board that leave the error bounds looser than they could be."""
    if len(rig_from_board) == 1:
        return ("one picture through the mirrors: nothing tells how well another would fit, take more",)
    normals = rig_from_board[:, :3, 2]
    along = normals @ np.linalg.svd(normals)[2][0]
    widest = float(np.degrees(np.arccos(np.clip(np.abs(along).min(), 0.0, 1.0))))
    if widest < PARALLEL_DEG:
        return (f"all boards are parallel to {widest:.1f} deg: tilt some by 20 deg or more for tighter bounds",)
    return ()


def camera_note(layout: Layout, camera: Camera) -> tuple[str, ...]:
    """A note where the camera is not the one of the layout."""
    ratio = camera.fx_px / layout.camera.fx_px
    if abs(ratio - 1.0) < OTHER_FOCAL:
        return ()
    return (
        f"focal length {camera.fx_px:.1f} px, {ratio - 1.0:+.0%} from the layout's {layout.camera.fx_px:.1f}: "
        "another camera, zoom or crop than the layout was designed for",
    )


def believable(solution: Solution) -> None:
    """Raise InputError where corners misfit, or leave a mirror so open that its error bound is no bound."""
    misfits = float((~solution.inliers).mean())
    if misfits > MOST_ODD_CORNERS:
        raise InputError(
            f"{misfits:.0%} of the corners fit neither mirrors nor camera, expected under {MOST_ODD_CORNERS:.0%}: are "
            "all pictures of one device, one camera and one board?"
        )
    for m, centre in enumerate(solution.estimate.virtual_centres_in_rig_mm):
        rows = [
            place for place, name in enumerate(solution.parameters) if name in {f"mirror {m} {a}_mm" for a in "xyz"}
        ]
        length = float(np.linalg.norm(centre))
        unit, block = centre / length, solution.covariance[np.ix_(rows, rows)]
        along = np.sqrt(max(float(unit @ block @ unit), 0.0)) / length
        across = np.degrees(np.sqrt(max(float(np.trace(block)) - (along * length) ** 2, 0.0) / 2.0) / length)
        if not (across < WIDEST_NORMAL_DEG and along < WIDEST_DISTANCE):
            raise InputError(
                f"the pictures leave mirror {m} open by {across:.2g} deg and {along:.2g} of its distance, expected "
                f"under {WIDEST_NORMAL_DEG:g} deg and {WIDEST_DISTANCE:g}: show it the board tilted and nearer"
            )


def check_solution(solution: Solution, layout: Layout, *, mirrored_frames: int) -> tuple[str, ...]:
    """Notes on a finished fit whose first frames are those with mirrors; raises InputError where it is not believed."""
    believable(solution)
    estimate = solution.estimate
    return (
        *scale_note(layout, estimate.virtual_centres_in_rig_mm),
        *pose_notes(estimate.rig_from_board[:mirrored_frames]),
        *camera_note(layout, estimate.camera),
    )
