"""Next best view: the pose of the board that most reduces the uncertainty of the least certain mirrors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.normal_equations import Grouped, normal_equations
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, Corners, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model, pair_prior
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid, transform

TILT_DEG = 30.0
TILTS = ((0.0, 0.0), (TILT_DEG, 0.0), (-TILT_DEG, 0.0), (0.0, TILT_DEG), (0.0, -TILT_DEG))
SHIFTS = (-0.6, 0.0, 0.6)  # relative to half the board's size
NOISE_PX = 0.1  # standard deviation of a corner in frames of a webcam
CENTRE_SIGMA_MM = 3.5  # prior sigma of a virtual centre: an error of the mirror of 2 degrees or 2 mm
INTRINSIC_SIGMAS = 0.02, 0.02, 0.2  # prior: focal length and centre, relative; distortion coefficients
ENOUGH_DEG, ENOUGH_PICTURES = 0.01, 8  # sigma of every mirror's normal; number of pictures, to allow hold-out tests
COMMON_ROTATION_DEG = 1e-3  # prior sigma of two mirrors' common rotation, which no picture determines
P_NORM = 8  # p-norm instead of the maximum, so that a picture that helps the second least certain mirror counts as well


@dataclass(frozen=True)
class NextPose:
    """The recommended pose of the board for the next picture.

    Attributes
    ----------
    sentence
        The recommendation as text.
    rig_from_board
        Pose (4, 4) of the board in the rig frame, mm.
    depth_mm
        Depth of the board's centre, mm.
    tilt_deg
        Tilts about the view's x and y axes, degrees.
    mirror
        Index of the least certain mirror.
    sigma_deg
        Standard deviations (mirrors,) of the normals along their weakest directions, from the pictures so far.
    predicted_deg
        The same after the next picture.
    enough
        Whether every normal is known to `ENOUGH_DEG` from at least `ENOUGH_PICTURES` pictures.
    """

    sentence: str
    rig_from_board: FloatArray
    depth_mm: float
    tilt_deg: tuple[float, float]
    mirror: int
    sigma_deg: FloatArray
    predicted_deg: FloatArray
    enough: bool


@dataclass(frozen=True)
class Placement:
    """A candidate pose of the board for the next picture.

    Attributes
    ----------
    rig_from_board
        Pose (4, 4) of the board in the rig frame, mm.
    depth_mm
        Depth of the board's centre, mm.
    tilt_deg
        Tilts about the view's x and y axes, degrees.
    description
        The pose as text.
    observations
        The corners that a picture would show, as frame 0.
    """

    rig_from_board: FloatArray
    depth_mm: float
    tilt_deg: tuple[float, float]
    description: str
    observations: Observations


class NextPosePlanner:
    """Plans the next pose of the board while pictures are taken one by one.

    Among candidate poses, the planner picks the one that most reduces the standard deviations of the mirrors' normals,
    chiefly the largest. They are predicted for a joint fit of intrinsics, mirrors and poses to corners with noise
    `NOISE_PX`, starting from prior standard deviations of the device.

    Parameters
    ----------
    estimate
        Approximate camera and mirrors.
    model
        Model to be estimated.
    sigmas
        Standard deviations of the model's global parameters before the first picture.
    mirrors
        Names of the mirrors for messages.
    placements
        The candidate poses.
    """

    def __init__(
        self,
        estimate: Estimate,
        model: Model,
        sigmas: Sequence[float],
        mirrors: Sequence[str],
        placements: Iterable[Placement],
    ) -> None:
        self._estimate, self._model, self._mirrors = estimate, model, mirrors
        self._information = np.diag(np.square(sigmas) ** -1.0)
        self._placements = list(placements)
        self._added = np.array(
            [self._information_in(pose.rig_from_board, pose.observations) for pose in self._placements]
        )
        self._pictures = 0
        if not self._placements:
            raise InputError(
                "no mirror shows the board in any pose, expected mirrors whose sub-images lie on the sensor"
            )

    @classmethod
    def for_layout(cls, layout: Layout, board: CalibrationBoard) -> Self:
        """Return a planner for a device built to a layout within `CENTRE_SIGMA_MM`."""
        camera, (focal, centre, distortion) = layout.camera, INTRINSIC_SIGMAS
        intrinsics = [focal * camera.fx_px, focal * camera.fy_px, centre * camera.width_px, centre * camera.width_px]
        return cls(
            Estimate.of(camera, layout.mirrors, np.zeros((0, 4, 4))),
            replace(
                planning_model(camera.intrinsic_names, board), centres_prior=pair_prior(layout, COMMON_ROTATION_DEG)
            ),
            [*intrinsics, *[distortion] * (len(camera.intrinsics) - 4), *[CENTRE_SIGMA_MM] * (3 * len(layout.mirrors))],
            [
                f"mirror {name} ({position_in_words(camera, np.nanmean(layout.outline_px(index), axis=0))})"
                for index, name in enumerate(layout.mirror_names)
            ],
            _placements(layout, board),
        )

    def add(self, rig_from_board: FloatArray, picture: Observations) -> None:
        """Add the information of a picture at about this pose, with corners given as frame 0."""
        self._information = self._information + self._information_in(rig_from_board, picture)
        self._pictures += bool((picture.view != DIRECT).any())

    def next(self) -> NextPose:
        """Return the recommendation after the pictures so far."""
        sigma_deg = self._sigma_deg(self._information)
        predicted = self._sigma_deg(self._information + self._added)
        best = int(np.argmin(np.sum(predicted**P_NORM, axis=1)))
        chosen, mirror = self._placements[best], int(np.argmax(sigma_deg))
        change = f"±{sigma_deg[mirror]:.2g}° to ±{predicted[best, mirror]:.2g}°"
        enough = bool(sigma_deg[mirror] <= ENOUGH_DEG and self._pictures >= ENOUGH_PICTURES)
        if enough:
            sentence = (
                f"enough: every mirror within ±{sigma_deg[mirror]:.2g}°; "
                f"the most useful further pose is {chosen.description}"
            )
        elif not self._pictures:
            sentence = f"next: {chosen.description}"
        else:
            sentence = (
                f"next: {chosen.description}; it would improve {self._mirrors[mirror]}, the least certain one, "
                f"from {change}"
            )
        return NextPose(
            sentence,
            chosen.rig_from_board,
            chosen.depth_mm,
            chosen.tilt_deg,
            mirror,
            sigma_deg,
            predicted[best],
            enough,
        )

    def _information_in(self, pose: FloatArray, picture: Observations) -> FloatArray:
        """Fisher information (g, g) about the global parameters from a picture at about this pose, itself unknown."""
        noisy = replace(picture, sigma_px=np.full(len(picture), NOISE_PX))
        estimate = self._estimate.with_poses(pose[None])
        return normal_equations(estimate, Grouped.of(noisy, self._model), self._model).reduced(0.0)[0]

    def _sigma_deg(self, information: FloatArray) -> FloatArray:
        """Standard deviations (..., mirrors) of the normals in their weakest directions, from information (..., g, g).

        A normal n = -c / |c| rotates by the displacement of the virtual centre c perpendicular to it, divided by |c|.
        """
        covariance, sigma = np.linalg.inv(information), []
        for index, centre in enumerate(self._estimate.virtual_centres_in_rig_mm):
            length, first = float(np.linalg.norm(centre)), len(self._model.intrinsics) + 3 * index
            tangents = np.linalg.svd(centre[None])[2][1:].T
            block = tangents.T @ covariance[..., first : first + 3, first : first + 3] @ tangents
            sigma.append(np.sqrt(np.linalg.eigvalsh(block)[..., -1]) / length)
        return np.degrees(np.stack(sigma, axis=-1))


def planning_model(intrinsics: Sequence[str], board: CalibrationBoard) -> Model:
    """Return the model of planes, intrinsics and poses of a board as drawn."""
    flat = Board.rigid(board.corners_in_board_mm)
    return Model(tuple(intrinsics), thickness=False, curvature=False, board=flat)


def board_pose(layout: Layout, board: CalibrationBoard, picture: Observations) -> FloatArray | None:
    """Return the board's pose (4, 4) in a picture; None if no view shows enough corners."""
    views = []
    for mirror in np.unique(picture.view).tolist():
        rows = picture.view == mirror
        if rows.sum() >= MIN_CORNERS:
            corners = Corners(picture.corner[rows], picture.pixels[rows])
            views.append((layout.mirrors[mirror].apparent, corners))
    if not views:
        return None
    return initial_estimates.best_pose(layout.camera, views, board.corners_in_board_mm)


def _placements(layout: Layout, board: CalibrationBoard) -> Iterator[Placement]:
    """Yield the poses, at three depths, five tilts and nine positions, in which a mirror shows enough of the board."""
    corners = board.corners_in_board_mm
    sensor = shapely.box(0.0, 0.0, layout.camera.width_px - 1.0, layout.camera.height_px - 1.0)
    regions = []
    for index in range(len(layout.mirrors)):
        outline = layout.outline_px(index, usable=True)
        regions.append(shapely.Polygon(outline[np.isfinite(outline).all(axis=1)]).intersection(sensor))
    for pose, depth_mm, tilt_deg in poses_of(layout, board):
        points, views = transform(pose, corners), []
        for index, region in enumerate(regions):
            pixels = layout.project(points, index)
            ids = indices_inside(region, pixels)
            if len(ids) >= MIN_CORNERS:
                views.append(Observations.of_view(0, index, ids, pixels[ids]))
        if views:
            description = f"the board at about {round(depth_mm, -1):.0f} mm, {_in_words(layout, board, pose, tilt_deg)}"
            yield Placement(pose, depth_mm, tilt_deg, description, Observations.join(views))


def indices_inside(region: shapely.Geometry, pixels: FloatArray) -> IntArray:
    """Indices of the pixels (n, 2) inside a region of the sensor; NaN pixels are outside."""
    return np.flatnonzero(shapely.contains_xy(region, *np.nan_to_num(pixels, nan=-1e9).T))


def _in_words(layout: Layout, board: CalibrationBoard, pose: FloatArray, tilt_deg: tuple[float, float]) -> str:
    """Describe tilt and position, as seen by the camera."""
    half = np.array([*board.size_mm, 0.0])[None] / 2.0
    centre = layout.view_from_rig @ transform(pose, half)[0]
    x, y = (centre - layout.virtual_centres_in_view_mm.reshape(-1, 3).mean(axis=0))[:2]
    tilt = tilt_in_words(tilt_deg, "the mirrors") or "facing the mirrors"
    shift = shift_in_words(x if abs(x) > 1.0 else 0.0, y if abs(y) > 1.0 else 0.0)
    return tilt + (f", {shift}" if shift else "")


def shift_in_words(x: float, y: float) -> str:
    """Describe a shift to the right and down; empty without a shift."""
    column = "left" if x < 0.0 else "right" if x > 0.0 else ""
    row = "up" if y < 0.0 else "down" if y > 0.0 else ""
    direction = " and ".join(word for word in (row, column) if word)
    return f"moved {direction}" if direction else ""


def poses_of(layout: Layout, board: CalibrationBoard) -> Iterator[tuple[FloatArray, float, tuple[float, float]]]:
    """Yield poses rig_from_board (4, 4), with the depth of the board's centre in mm and the tilts in degrees."""
    depths = (300.0, 500.0) if layout.spec is None else (min(layout.spec.depths_mm), max(layout.spec.depths_mm))
    half = np.array([*board.size_mm, 0.0]) / 2.0
    view_centre = layout.virtual_centres_in_view_mm.reshape(-1, 3).mean(axis=0)
    for depth_mm in np.geomspace(0.95 * depths[0], 1.1 * depths[1], 3).tolist():
        for tilt in TILTS:
            rotation = Rotation.from_euler("xy", tilt, degrees=True).as_matrix()
            for x in SHIFTS:
                for y in SHIFTS:
                    centre = np.array([view_centre[0] + x * half[0], view_centre[1] + y * half[1], depth_mm])
                    pose = rigid(layout.view_from_rig.T @ rotation, layout.view_from_rig.T @ (centre - rotation @ half))
                    yield pose, depth_mm, tilt


def tilt_in_words(tilt_deg: tuple[float, float], target_name: str) -> str:
    """Describe a tilt about x or y towards the mirrors or the camera; empty without a tilt."""
    about_x, about_y = tilt_deg
    if about_x == about_y == 0.0:
        return ""
    edges = ("upper", "lower") if about_x else ("right", "left")
    edge = edges[0 if about_x + about_y > 0 else 1]
    return (
        f"its {edge} edge (as the camera sees it) tilted {max(abs(about_x), abs(about_y)):.0f}° towards {target_name}"
    )


def position_in_words(camera: Camera, pixel: FloatArray) -> str:
    """Describe the position of a pixel (2,), such as "upper left of the picture" or "top of the picture"."""
    x, y = pixel / [camera.width_px, camera.height_px]
    row = -1 if y < 0.38 else 1 if y > 0.62 else 0
    column = "left" if x < 0.38 else "right" if x > 0.62 else ""
    position = ("upper ", "", "lower ")[row + 1] + column if column else ("top", "middle", "bottom")[row + 1]
    return f"{position} of the picture"
