"""Reprojection residuals of corners observed directly or through one mirror, and their exact derivatives.

In frame f, a corner X_b of the board is at X = P + t_f in the rig frame, with P = R_f (X_b + sum_k a_k B_k + sum_k b_fk
C_k), where a deforms the board in all frames and b_f bows it in this frame. Observed directly, it projects from X;
through a mirror, from its image (`geometry.mirror_imaging`). The camera's rotation exp(w_f) in frame f, if any, applies
to both.

A rolling shutter reads the rows of a picture one after the other. If the board moves meanwhile, a corner is at
exp(s u_f + s^2/2 u'_f) P + t_f + s v_f + s^2/2 v'_f, where s is the time at which its row is read, from -1/2 at the top
to 1/2 at the bottom. The velocities u_f and v_f and the accelerations u'_f and v'_f are per readout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_arrays import ImageDerivatives, MirrorArrays
from mirrorcam.optics.geometry.mirror_imaging import images

FRAME_PARAMETERS = 24
"""Parameters of a frame: pose, rotation of the camera, bow, velocity and acceleration (`Estimate.moved`)."""
MAX_FREE_CORNERS = 120
DEGREE = 5


def global_names(intrinsics: Sequence[str], mirrors: int, modes: int) -> tuple[str, ...]:
    """Names of all global parameters of a calibration, those common to its frames, in the order of `Estimate.moved`.

    `intrinsics` are `Camera.intrinsic_names`.
    """
    return (
        *intrinsics,
        *(f"mirror {m} {axis}_mm" for m in range(mirrors) for axis in "xyz"),
        *(f"mirror {m} curvature_{axes}_per_m" for m in range(mirrors) for axes in ("xx", "yy", "xy")),
        "sheet_mm",
        *(f"board mode {k}_mm" for k in range(modes)),
    )


@dataclass(frozen=True)
class Board:
    """The corners (c, 3), mm, as drawn, and the modes (k, c, 3) by which the real board may deviate."""

    corners_in_board_mm: FloatArray
    modes: FloatArray

    @classmethod
    def rigid(cls, corners_in_board_mm: FloatArray) -> Board:
        """Return a board exactly as drawn."""
        return cls(corners_in_board_mm, np.zeros((0, *corners_in_board_mm.shape)))

    @classmethod
    def warped(cls, corners_in_board_mm: FloatArray) -> Board:
        """Return a board with two parabolic bows, along x and along y; a coefficient is the sag in mm at its edge."""
        modes = np.zeros((2, *corners_in_board_mm.shape))
        modes[:, :, 2] = cls.rigid(corners_in_board_mm).bows[:2]
        return cls(corners_in_board_mm, modes)

    @classmethod
    def free(cls, corners_in_board_mm: FloatArray) -> Board:
        """Return a board with every corner free in x, y and z, except for the board's six rigid motions and its scale.

        After Strobl and Hirzinger, "More accurate pinhole camera calibration with imperfect planar target" (2011). A
        board of more than `MAX_FREE_CORNERS` deforms smoothly, as polynomials of `DEGREE`: the time of a fit grows with
        the square of the number of modes.
        """
        count = len(corners_in_board_mm)
        centred = corners_in_board_mm - corners_in_board_mm.mean(axis=0)
        axes = np.eye(3)
        gauge = [np.tile(axis, (count, 1)) for axis in axes]
        gauge += [np.cross(axis, centred) for axis in axes]
        gauge += [centred]
        directions = np.array(gauge).reshape(7, -1)
        if count <= MAX_FREE_CORNERS:
            _, _, rows = np.linalg.svd(directions)
            return cls(corners_in_board_mm, rows[7:].reshape(-1, count, 3))
        x, y = cls.rigid(corners_in_board_mm).corners_from_centre.T
        terms = [x**power * y ** (total - power) for total in range(DEGREE + 1) for power in range(total + 1)]
        smooth = np.einsum("tc,ij->ticj", np.array(terms), axes).reshape(-1, 3 * count)
        gauge_basis = np.linalg.qr(directions.T)[0]
        smooth = smooth - (smooth @ gauge_basis) @ gauge_basis.T
        _, _, rows = np.linalg.svd(smooth, full_matrices=False)
        return cls(corners_in_board_mm, rows[: len(smooth) - 7].reshape(-1, count, 3))

    @cached_property
    def bows(self) -> FloatArray:
        """Heights (3, c) of the corners of boards bowed as x^2, y^2 and xy, with x and y from -1 to 1."""
        x, y = self.corners_from_centre.T
        return np.stack([x * x, y * y, x * y])

    @property
    def corners_from_centre(self) -> FloatArray:
        """Positions (c, 2) of the corners relative to the drawing's centre, divided by the largest x and y."""
        flat = self.corners_in_board_mm[:, :2]
        centred = flat - (flat.min(axis=0) + flat.max(axis=0)) / 2.0
        return np.asarray(centred / np.maximum(np.abs(centred).max(axis=0), 1e-9))

    def shaped(self, shape: FloatArray) -> FloatArray:
        """Return the corners (c, 3), mm, deformed by coefficients (k,) of the modes."""
        return self.corners_in_board_mm + np.tensordot(shape, self.modes, axes=1)


@dataclass(frozen=True)
class Estimate:
    """All values that a calibration estimates, and fixed values of the mirrors.

    Attributes
    ----------
    camera
        Intrinsics and distortion.
    virtual_centres_in_rig_mm
        Virtual centres (m, 3).
    rig_from_board
        Board poses (f, 4, 4), mm.
    shape
        Coefficients (k,) of the board's modes, mm.
    thickness_mm
        Thickness (m,) of the plate in front of the reflecting surface; 0 for a first-surface mirror. Default: 0.
    refractive_index
        Refractive indices (m,) of the plates. Default: 1.
    curvature_per_m
        Curvatures (m, 3), as `Mirror.curvature_per_m`. Default: flat.
    centroids_in_rig_mm
        Centroids (m, 3) of the outlines as designed; their feet on the planes are the origins of the mirrors' own
        frames. Default: the feet of the pupil.
    camera_rotation
        Rotation vectors (f, 3), rad, of the camera in each frame, from rig to camera axes. Default: none.
    bow_mm
        Coefficients (f, 3) of `Board.bows` in each frame. Default: none.
    motion
        Motion (f, 12) of the board in each frame while its rows are read: velocity and acceleration at the middle row,
        per readout. Each is a rotation vector about the board's origin in rig axes, rad, and a translation, mm.
        Default: none.
    """

    camera: Camera
    virtual_centres_in_rig_mm: FloatArray
    rig_from_board: FloatArray
    shape: FloatArray = field(default_factory=lambda: np.zeros(0))
    thickness_mm: FloatArray = field(default_factory=lambda: np.zeros(0))
    refractive_index: FloatArray = field(default_factory=lambda: np.zeros(0))
    curvature_per_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    centroids_in_rig_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    camera_rotation: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    bow_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    motion: FloatArray = field(default_factory=lambda: np.zeros((0, 12)))

    def __post_init__(self) -> None:
        mirrors = len(self.virtual_centres_in_rig_mm)
        defaults = {
            "camera_rotation": np.zeros((len(self.rig_from_board), 3)),
            "bow_mm": np.zeros((len(self.rig_from_board), 3)),
            "motion": np.zeros((len(self.rig_from_board), 12)),
            "thickness_mm": np.zeros(mirrors),
            "refractive_index": np.ones(mirrors),
            "curvature_per_m": np.zeros((mirrors, 3)),
            "centroids_in_rig_mm": self.virtual_centres_in_rig_mm / 2.0,
        }
        for name, default in defaults.items():
            if getattr(self, name).size == 0:
                object.__setattr__(self, name, default)
            elif getattr(self, name).shape != default.shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {default.shape}")

    @classmethod
    def of(cls, camera: Camera, mirrors: tuple[Mirror, ...], rig_from_board: FloatArray) -> Self:
        """Build the estimate of a camera, a layout's mirrors, and board poses (f, 4, 4)."""
        return cls(
            camera,
            np.array([mirror.virtual_centre_in_rig_mm for mirror in mirrors]).reshape(-1, 3),
            rig_from_board,
            thickness_mm=np.array([mirror.front_mm for mirror in mirrors]),
            refractive_index=np.array([mirror.refractive_index for mirror in mirrors]),
            curvature_per_m=np.array([mirror.curvature_per_m for mirror in mirrors]),
            centroids_in_rig_mm=np.array([mirror.outline_in_rig_mm.mean(axis=0) for mirror in mirrors]),
        )

    def with_poses(self, rig_from_board: FloatArray) -> Self:
        """Return camera and mirrors with new board poses (f, 4, 4), without other per-frame parameters."""
        empty = np.zeros((0, 3))
        motion = np.zeros((0, 12))
        return replace(self, rig_from_board=rig_from_board, camera_rotation=empty, bow_mm=empty, motion=motion)

    def of_frames(self, frames: NDArray[np.bool_] | IntArray) -> Self:
        """Select some frames."""
        return replace(
            self,
            rig_from_board=self.rig_from_board[frames],
            camera_rotation=self.camera_rotation[frames],
            bow_mm=self.bow_mm[frames],
            motion=self.motion[frames],
        )

    def moved(self, step_global: FloatArray, step_frames: FloatArray) -> Estimate:
        """Apply a step of all global parameters, in the order of `global_names`, and of each frame's parameters.

        `step_frames` is (f, 6), a twist of rotation and translation, or (f, 24), followed by the camera's rotation, the
        bow and the motion. A rotation vector w rotates the board about its origin, R <- exp(w) R; the translation is
        added. The thickness correction applies to every plate.
        """
        step_poses, step_rotation, step_bow, step_motion = np.split(step_frames, [6, 9, 12], axis=1)
        poses = self.rig_from_board.copy()
        poses[:, :3, :3] = Rotation.from_rotvec(step_poses[:, :3]).as_matrix() @ poses[:, :3, :3]
        poses[:, :3, 3] += step_poses[:, 3:]
        count = self.virtual_centres_in_rig_mm.size
        intrinsics, centres, curvatures, thickness, shape = np.split(
            step_global, np.cumsum([self.camera.intrinsics.size, count, count, 1])
        )
        return replace(
            self,
            camera=self.camera.with_intrinsics(self.camera.intrinsics + intrinsics),
            virtual_centres_in_rig_mm=self.virtual_centres_in_rig_mm + centres.reshape(-1, 3),
            rig_from_board=poses,
            shape=self.shape + shape,
            thickness_mm=np.where(self.thickness_mm > 0.0, self.thickness_mm + thickness, 0.0),
            curvature_per_m=self.curvature_per_m + curvatures.reshape(-1, 3),
            camera_rotation=_rotated_by(self.camera_rotation, step_rotation),
            bow_mm=self.bow_mm + step_bow if step_bow.size else self.bow_mm,
            motion=self.motion + step_motion if step_motion.size else self.motion,
        )


def _rotated_by(rotation: FloatArray, step: FloatArray) -> FloatArray:
    """Rotation vectors (f, 3) of rotations followed by steps (f, 3), if any."""
    if not step.size:
        return rotation
    return np.asarray((Rotation.from_rotvec(step) * Rotation.from_rotvec(rotation)).as_rotvec())


def points_at_camera(
    estimate: Estimate, observations: Observations, board: Board
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions of the observed corners relative to the base camera.

    Returns
    -------
    about_origin
        The corners about their board's origin, in rig axes (n, 3), mm.
    in_rig
        The corners in the rig frame (n, 3), mm.
    image
        Their images in the mirrors of their views (n, 3), mm, exact in direction; `in_rig` for direct views. In camera
        axes if the camera is rotated.
    """
    poses = estimate.rig_from_board[observations.frame]
    in_board = board.shaped(estimate.shape)[observations.corner]
    in_board[:, 2] += np.einsum("nk,kn->n", estimate.bow_mm[observations.frame], board.bows[:, observations.corner])
    about_origin = np.einsum("nij,nj->ni", poses[:, :3, :3], in_board)
    in_rig = about_origin + poses[:, :3, 3]
    if estimate.motion.any():
        time = row_times(estimate.camera, observations.pixels[:, 1])
        turn, shift = moved_since_middle_row(estimate.motion[observations.frame].T, time)
        in_rig = (turned(about_origin.T, turn) + shift).T + poses[:, :3, 3]
    image = in_rig.copy()
    mirrored = observations.view != DIRECT
    mirrors = mirrors_of_views(estimate, observations.view[mirrored])
    image[mirrored] = images(in_rig[mirrored].T, mirrors).image_mm.T
    if estimate.camera_rotation.any():
        camera_rotations = Rotation.from_rotvec(estimate.camera_rotation).as_matrix()
        image = np.einsum("nij,nj->ni", camera_rotations[observations.frame], image)
    return about_origin, in_rig, image


def row_times(camera: Camera, row_px: FloatArray) -> FloatArray:
    """Times (n,) at which a rolling shutter reads rows (n,), from -1/2 at the top to 1/2 at the bottom."""
    return np.asarray(row_px / (camera.height_px - 1) - 0.5)


def moved_since_middle_row(motion: FloatArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation vectors, rad, and shifts, mm, each (3, n), of boards with `motion` (12, n) at the times (n,) of rows."""
    moved = time * motion[:6] + time**2 / 2.0 * motion[6:]
    return moved[:3], moved[3:]


def turned(points: FloatArray, turn: FloatArray) -> FloatArray:
    """Rotate points (3, n) by rotation vectors (3, n), rad."""
    sine, versine, _ = _rotation_series(turn)
    across = np.cross(turn, points, axis=0)
    return np.asarray(points + sine * across + versine * np.cross(turn, across, axis=0))


def _rotation_series(turn: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients (n,) sin(a) / a, (1 - cos(a)) / a^2 and (1 - sin(a) / a) / a^2 of rotations (3, n) by angles a."""
    angle = np.linalg.norm(turn, axis=0)
    sine, half = np.sinc(angle / np.pi), np.sinc(angle / (2.0 * np.pi))
    rest = np.divide(1.0 - sine, angle**2, where=angle > 1e-3, out=np.full_like(angle, 1.0 / 6.0))
    return sine, half**2 / 2.0, rest


def mirrors_of_views(estimate: Estimate, view: IntArray) -> MirrorArrays:
    """Gather the mirrors of views (n,)."""
    return MirrorArrays(
        centre_mm=estimate.virtual_centres_in_rig_mm.T[:, view],
        centroid_mm=estimate.centroids_in_rig_mm.T[:, view],
        thickness_mm=estimate.thickness_mm[view],
        refractive_index=estimate.refractive_index[view],
        curvature_per_m=estimate.curvature_per_m.T[:, view],
    )


def residuals(estimate: Estimate, observations: Observations, board: Board) -> FloatArray:
    """Predicted minus observed pixels (n, 2); NaN if a corner is predicted behind the camera or a mirror."""
    _, _, image = points_at_camera(estimate, observations, board)
    return estimate.camera.project(image) - observations.pixels


@dataclass(frozen=True)
class LinearizedResiduals:
    """Predicted pixels (2, n) and their derivatives, component first.

    The derivatives are with respect to the intrinsics (2, k, n), the mirror's virtual centre (2, 3, n), thickness
    (2, n) and curvature (2, 3 or 0, n), the corner in the rig frame (2, 3, n), the corner on the board in rig axes
    (2, 3, n), which differs if the board rotates, the rotation of the board about its origin (2, 3, n), the rotation of
    the camera (2, 3, n), and the motion of the board during a readout (2, 12, n).
    """

    pixels: FloatArray
    intrinsics: FloatArray
    centre: FloatArray
    thickness: FloatArray
    curvature: FloatArray
    corner: FloatArray
    corner_on_board: FloatArray
    board_rotation: FloatArray
    camera_rotation: FloatArray
    motion: FloatArray


def linearized(
    camera: Camera,
    about_origin: FloatArray,
    in_rig: FloatArray,
    mirrors: MirrorArrays | None,
    *,
    bent: bool,
    row_time: FloatArray | float = 0.0,
    camera_from_rig: FloatArray | None = None,
    board_turn: FloatArray | None = None,
) -> LinearizedResiduals:
    """Linearise the projection of corners through mirrors, or directly.

    Parameters
    ----------
    camera
        The base camera.
    about_origin, in_rig
        The corners (3, n), mm: about their board's origin in rig axes, and in the rig frame.
    mirrors
        The mirror of each corner; None for direct views.
    bent
        Whether derivatives with respect to curvature are needed.
    row_time
        Times (n,) at which the corners' rows are read; 0 if nothing moves.
    camera_from_rig
        Rotations (3, 3, n) of the camera at each corner; None if it is not rotated.
    board_turn
        Rotation vectors (3, n) of the board since the middle row was read; None if it does not turn.
    """
    mirrored = None if mirrors is None else images(in_rig, mirrors, bent=bent)
    image = in_rig if mirrored is None else mirrored.image_mm
    if camera_from_rig is not None:
        image = np.einsum("ijn,jn->in", camera_from_rig, image)
    pixels, d_image, d_intrinsics = camera.project_with_jacobians(image.T)
    rows, empty = d_image.transpose(1, 2, 0), np.empty((2, 0, in_rig.shape[1]))
    camera_rotation = _d_rotation(image, rows)
    if camera_from_rig is not None:
        rows = np.einsum("pin,ijn->pjn", rows, camera_from_rig)
    change = ImageDerivatives(rows, empty, empty, empty) if mirrored is None else mirrored.vjp(rows)
    on_board, d_turn = change.point, _d_rotation(about_origin, change.point)
    if board_turn is not None:
        # J (w x p) = (J x w) p; a change of the rotation vector rotates the board by the left Jacobian of SO(3).
        sine, versine, rest = _rotation_series(board_turn)
        across = np.cross(on_board, board_turn[None], axis=1)
        on_board = on_board + sine * across + versine * np.cross(across, board_turn[None], axis=1)
        d_turn = _d_rotation(turned(about_origin, board_turn), change.point)
        across = np.cross(d_turn, board_turn[None], axis=1)
        d_turn = d_turn + versine * across + rest * np.cross(across, board_turn[None], axis=1)
    d_moved = np.concatenate([d_turn, change.point], axis=1)
    return LinearizedResiduals(
        pixels.T,
        d_intrinsics.transpose(1, 2, 0),
        change.centre,
        change.thickness,
        change.curvature,
        change.point,
        on_board,
        _d_rotation(about_origin, on_board),
        camera_rotation,
        np.concatenate([row_time * d_moved, row_time**2 / 2.0 * d_moved], axis=1),
    )


def _d_rotation(points: FloatArray, d_point: FloatArray) -> FloatArray:
    """Derivatives (2, 3, n) for a rotation of points (3, n), from those for the points: J (w x p) = w . (p x J)."""
    x, y, z = d_point[:, 0], d_point[:, 1], d_point[:, 2]
    return np.stack(
        [points[1] * z - points[2] * y, points[2] * x - points[0] * z, points[0] * y - points[1] * x], axis=1
    )


def residuals_with_jacobians(
    estimate: Estimate, observations: Observations, board: Board
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, 2) and their derivatives (n, 2, g) and (n, 2, 24): global parameters and the frame's parameters.

    Global parameters are ordered as in `global_names`, the frame's as in `Estimate.moved`. The result is dense and
    mostly zeros; the solver sums the same blocks by groups (`normal_equations`).
    """
    about_origin, in_rig, _ = points_at_camera(estimate, observations, board)
    count = len(estimate.virtual_centres_in_rig_mm)
    lens = estimate.camera.intrinsics.size
    thickness = lens + 6 * count
    r = np.empty((len(observations), 2))
    d_global = np.zeros((len(observations), 2, thickness + 1 + estimate.shape.size))
    d_frame = np.empty((len(observations), 2, FRAME_PARAMETERS))
    camera_rotations = Rotation.from_rotvec(estimate.camera_rotation).as_matrix()
    for is_direct in (True, False):
        rows = np.flatnonzero((observations.view == DIRECT) == is_direct)
        view = observations.view[rows]
        mirrors = None if is_direct else mirrors_of_views(estimate, view)
        frame, corner = observations.frame[rows], observations.corner[rows]
        rotations = camera_rotations[frame].transpose(1, 2, 0)
        time = row_times(estimate.camera, observations.pixels[rows, 1])
        linear = linearized(
            estimate.camera,
            about_origin[rows].T,
            in_rig[rows].T,
            mirrors,
            bent=True,
            row_time=time,
            camera_from_rig=rotations,
            board_turn=moved_since_middle_row(estimate.motion[frame].T, time)[0],
        )
        r[rows] = linear.pixels.T - observations.pixels[rows]
        d_global[rows, :, :lens] = linear.intrinsics.transpose(2, 0, 1)
        d_corner = np.einsum("ijn,njk->nik", linear.corner_on_board, estimate.rig_from_board[frame, :3, :3])
        d_global[rows, :, thickness + 1 :] = np.einsum("nij,knj->nik", d_corner, board.modes[:, corner])
        d_frame[rows, :, :9] = np.concatenate(
            [linear.board_rotation, linear.corner, linear.camera_rotation], axis=1
        ).transpose(2, 0, 1)
        d_frame[rows, :, 12:] = linear.motion.transpose(2, 0, 1)
        d_frame[rows, :, 9:12] = np.einsum("ni,kn->nik", d_corner[:, :, 2], board.bows[:, corner])
        if mirrors is not None:
            for k in range(3):
                d_global[rows, :, lens + 3 * view + k] = linear.centre[:, k].T
                d_global[rows, :, lens + 3 * (count + view) + k] = linear.curvature[:, k].T
            d_global[rows, :, thickness] = np.where(mirrors.thickness_mm > 0.0, linear.thickness, 0.0).T
    return r, d_global, d_frame
