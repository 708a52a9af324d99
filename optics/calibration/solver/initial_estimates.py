"""Initial estimates from single views: intrinsics, board poses and mirror planes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import cv2
import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, Corners, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, reflect
from mirrorcam.optics.geometry.nearest_lens import nearest_lens
from mirrorcam.optics.geometry.transforms import rigid, transform

MIN_VIEWS = 3
MAX_FOCAL_RATIO = 1.5  # of fitted to nominal focal length, or its inverse


@contextmanager
def _one_thread() -> Iterator[None]:
    """Run OpenCV on one thread: calibrateCamera's sums depend on the order of threads, in their last digits."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def intrinsics(
    views: Sequence[Corners],
    corners_in_board_mm: FloatArray,
    *,
    width_px: int,
    height_px: int,
    full_distortion: bool,
) -> Camera:
    """Calibrate a camera from views of a flat board, with OpenCV.

    Mirrored views serve as well as direct ones: a mirrored flat board is still a flat board.

    Parameters
    ----------
    views
        Corners of each view.
    corners_in_board_mm
        The board's corners (c, 3), mm.
    width_px, height_px
        Size of the sensor.
    full_distortion
        Whether k1 k2 p1 p2 k3 are free; otherwise only k1 and k2, which a few views determine.

    Raises
    ------
    InputError
        If there are fewer than three views, or they do not determine the camera.
    """
    if len(views) < MIN_VIEWS:
        raise InputError(
            f"the board is seen in {count_text(len(views), 'different view')}, expected {MIN_VIEWS} or more to "
            "estimate the camera"
        )
    flags = 0 if full_distortion else cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    objects = [corners_in_board_mm[view.ids].astype(np.float32) for view in views]
    images = [view.pixels.astype(np.float32)[:, None] for view in views]
    with _one_thread():
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            objects, images, (width_px, height_px), None, None, flags=flags
        )
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise InputError("the views of the board do not determine the camera, expected boards at several tilts")
    return Camera(
        width_px=width_px,
        height_px=height_px,
        fx_px=matrix[0, 0],
        fy_px=matrix[1, 1],
        cx_px=matrix[0, 2],
        cy_px=matrix[1, 2],
        distortion=np.asarray(distortion).ravel()[:5],
    )


def camera_from_flat_board(camera: Camera, view: Corners, corners_in_board_mm: FloatArray) -> FloatArray | None:
    """Return the pose (4, 4) of a flat board that fits a view, mirrored or not; None if there is none.

    For a mirrored view, it is the pose of the board's *image*, in which the sign of the board's z axis is lost.
    """
    normalized = camera.normalized_from_pixels(view.pixels)
    found, rotation, translation = cv2.solvePnP(
        corners_in_board_mm[view.ids], normalized[:, None], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        return None
    rotation, translation = cv2.solvePnPRefineLM(
        corners_in_board_mm[view.ids], normalized[:, None], np.eye(3), None, rotation, translation
    )
    return rigid(cv2.Rodrigues(rotation)[0], np.ravel(translation))


def rig_from_board(
    camera: Camera, view: Corners, corners_in_board_mm: FloatArray, virtual_centre: FloatArray | None
) -> FloatArray | None:
    """Return the pose (4, 4) of the board from a mirrored view; from a direct view if `virtual_centre` is None.

    None if no pose fits the view.
    """
    matrix = camera_from_flat_board(camera, view, corners_in_board_mm)
    return matrix if virtual_centre is None or matrix is None else pose_from_image(matrix, virtual_centre)


def pose_from_image(image_pose: FloatArray, virtual_centre: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a flat board from the pose (4, 4) of its image in a mirror.

    With F = diag(1, 1, -1), which leaves a flat board unchanged, and the mirror's reflection S, the image of the board
    has the rotation S R F. So R = S (S R F) F.
    """
    unit = virtual_centre / np.linalg.norm(virtual_centre)
    pose = image_pose.copy()
    pose[:3, :3] = (np.eye(3) - 2.0 * np.outer(unit, unit)) @ image_pose[:3, :3] @ np.diag([1.0, 1.0, -1.0])
    pose[:3, 3] = reflect(image_pose[:3, 3], virtual_centre)
    return pose


def virtual_centre_between(points_in_rig: FloatArray, image_in_rig: FloatArray) -> tuple[FloatArray, float]:
    """Return the virtual centre (3,) of the mirror that maps points (n, 3) to `image_in_rig`, and the rms misfit, mm.

    The differences between points and their images are all parallel to the normal, and the plane bisects them.
    """
    differences = image_in_rig - points_in_rig
    normal = np.linalg.svd(differences)[2][0]
    distance = float(np.mean((points_in_rig + image_in_rig) / 2.0 @ normal))
    centre = 2.0 * distance * normal
    if abs(distance) < 1e-9:
        return centre, float("inf")
    misfit = reflect(points_in_rig, centre) - image_in_rig
    return centre, float(np.sqrt(np.mean(np.sum(misfit**2, axis=1))))


def is_behind(points_in_rig: FloatArray, virtual_centre: FloatArray) -> bool:
    """Return whether points (n, 3) lie, on average, behind the mirror's plane, as the mirror's images do."""
    return bool(np.mean(points_in_rig @ virtual_centre) > virtual_centre @ virtual_centre / 2.0)


def best_pose(
    camera: Camera,
    views: Sequence[tuple[Mirror | None, Corners]],
    corners_in_board_mm: FloatArray,
) -> FloatArray:
    """Return the board pose (4, 4) of a frame from the view whose pose best predicts all views.

    Raises InputError if no view gives a pose.
    """
    best, best_cost = None, np.inf
    for mirror, view in views:
        centre = None if mirror is None else mirror.virtual_centre_in_rig_mm
        pose = rig_from_board(camera, view, corners_in_board_mm, centre)
        if pose is None:
            continue
        errors = []
        for other, corners in views:
            points = transform(pose, corners_in_board_mm[corners.ids])
            predicted = camera.project(points if other is None else other.reflect(points))
            errors.append(np.linalg.norm(predicted - corners.pixels, axis=1))
        cost = float(np.median(np.nan_to_num(np.concatenate(errors), nan=1e9)))
        if cost < best_cost:
            best, best_cost = pose, cost
    if best is None:
        raise InputError(f"no board pose fits any of the {len(views)} views of a frame")
    return best


def _sensor_corner_radius(camera: Camera) -> float:
    """Normalized radius of the sensor's farthest corner."""
    x = max(camera.cx_px, camera.width_px - 1 - camera.cx_px) / camera.fx_px
    y = max(camera.cy_px, camera.height_px - 1 - camera.cy_px) / camera.fy_px
    return float(np.hypot(x, y))


def base_camera(direct: Observations, nominal: Camera, corners_in_board_mm: FloatArray) -> Camera:
    """Return the initial camera: estimated from the frames without mirrors if they determine it, else the nominal one.

    Boards that all face the camera do not determine its focal length, although the fit converges: a focal length far
    from the nominal one is rejected.
    """
    if not len(direct):
        return nominal
    views = [
        Corners(direct.corner[rows], direct.pixels[rows])
        for frame in np.unique(direct.frame)
        if (rows := direct.frame == frame).sum() >= MIN_CORNERS
    ]
    if len(views) < MIN_VIEWS:
        return nominal
    camera = intrinsics(
        views, corners_in_board_mm, width_px=nominal.width_px, height_px=nominal.height_px, full_distortion=True
    )
    ratio = camera.fx_px / nominal.fx_px
    plausible = 1.0 / MAX_FOCAL_RATIO < ratio < MAX_FOCAL_RATIO and camera.valid_radius > _sensor_corner_radius(camera)
    if not plausible:
        return nominal
    camera, _ = nearest_lens(camera, nominal.lens_model)
    # Keep the nominal size, name and pupil.
    return nominal.with_intrinsics(camera.intrinsics)


def first_estimate(
    observations: Observations, camera: Camera, layout: Layout, corners_in_board_mm: FloatArray
) -> Estimate:
    """Return camera and nominal mirrors, and for each frame the pose from the view that predicts the frame best."""
    poses = []
    for frame in range(int(observations.frame[-1]) + 1):
        rows = observations.where(observations.frame == frame)
        views = []
        for view in np.unique(rows.view):
            in_view = rows.view == view
            mirror = None if view == DIRECT else layout.mirrors[view]
            views.append((mirror, Corners(rows.corner[in_view], rows.pixels[in_view])))
        poses.append(best_pose(camera, views, corners_in_board_mm))
    return Estimate.of(camera, layout.mirrors, np.array(poses))
