"""Next best view: the pose of the board that most reduces the uncertainty of the least certain mirrors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.normal_equations import Grouped, normal_equations
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import rigid, transform

TILT_DEG = 30.0
TILTS = ((0.0, 0.0), (TILT_DEG, 0.0), (-TILT_DEG, 0.0), (0.0, TILT_DEG), (0.0, -TILT_DEG))
SHIFTS = (-0.6, 0.0, 0.6)  # of half the board's size
NOISE_PX = 0.1  # of a corner, in frames of a webcam
BUILT_MM = 3.5  # prior sigma of a virtual centre about the nominal one: 2 degrees or 2 mm of the mirror
PRIOR = 0.02, 0.02, 0.2  # sigmas of the intrinsics: relative focal length and centre, distortion coefficients
ENOUGH_DEG, ENOUGH_PICTURES = 0.01, 8  # of every mirror's normal; and so that frames can be held out
NORM = 8  # p-norm in place of the maximum, so that a picture that helps the second worst mirror counts, too


@dataclass(frozen=True)
class NextPose:
    """The recommended pose of the board for the next picture.

    Attributes
    ----------
    sentence
        The recommendation in words.
    rig_from_board
        The pose (4, 4), mm.
    depth_mm
        Depth of the board's middle.
    tilt_deg
        Tilts about the view's x and y.
    mirror
        The least certain mirror.
    sigma_deg
        Standard deviations (mirrors,) of the normals, each along its weakest direction, from the pictures so far.
    predicted_deg
        The same after the next picture.
    enough
        Whether every normal is known to `ENOUGH_DEG`, from at least `ENOUGH_PICTURES` pictures.
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
class _Candidate:
    """A pose of the board, and the information (g, g) on the globals of a picture of it, with the pose unknown."""

    rig_from_board: FloatArray
    depth_mm: float
    tilt_deg: tuple[float, float]
    information: FloatArray


class NextPosePlanner:
    """Plan the next pose of the board while pictures are taken, one after the other, with an exact or nominal layout.

    Among poses at three depths, five tilts and nine places, the planner picks the one that most lowers the standard
    deviations of the mirrors' normals, the largest first. The deviations are those of a joint fit of intrinsics,
    mirrors and poses to corners with noise `NOISE_PX`, for a device built as designed within `BUILT_MM`.
    """

    def __init__(self, layout: Layout, target: Target) -> None:
        self._layout, self._target = layout, target
        self._model = Model(
            layout.camera.intrinsic_names,
            thickness=False,
            curvature=False,
            board=Board.rigid(target.corners_in_board_mm),
        )
        self._pictures = 0
        camera, (focal, centre, distortion) = layout.camera, PRIOR
        intrinsics = [focal * camera.fx_px, focal * camera.fy_px, centre * camera.width_px, centre * camera.width_px]
        before = [*intrinsics, *[distortion] * (len(camera.intrinsics) - 4), *[BUILT_MM] * (3 * len(layout.mirrors))]
        self._information = np.diag(np.square(before) ** -1.0)
        self._candidates = list(self._prepared())
        if not self._candidates:
            raise InputError("the layout's mirrors show the board in no pose, expected mirrors on the sensor")

    def after(self, picture: Observations) -> NextPose:
        """The recommendation after another picture, whose corners are given as frame 0."""
        pose = self._pose(picture)
        if pose is not None:
            self._pictures += 1
            self._information = self._information + self._information_in(pose, picture)
        return self.next()

    def next(self) -> NextPose:
        """The recommendation after the pictures so far."""
        now = self._sigma_deg(self._information)
        added = np.array([candidate.information for candidate in self._candidates])
        predicted = self._sigma_deg(self._information + added)
        best = int(np.argmin(np.sum(predicted**NORM, axis=1)))
        chosen, mirror = self._candidates[best], int(np.argmax(now))
        pose = f"the board at about {round(chosen.depth_mm, -1):.0f} mm, {self._in_words(chosen)}"
        worst = f"mirror {self._layout.mirror_names[mirror]} ({_place_in_words(self._layout, mirror)} of the picture)"
        change = f"±{now[mirror]:.2g}° to ±{predicted[best, mirror]:.2g}°"
        enough = bool(now[mirror] <= ENOUGH_DEG and self._pictures >= ENOUGH_PICTURES)
        if enough:
            sentence = f"enough: every mirror within ±{now[mirror]:.2g}°; the most useful further pose is {pose}"
        elif not self._pictures:
            sentence = f"next: {pose}"
        else:
            sentence = f"next: {pose}; it would improve {worst}, the least certain one, from {change}"
        return NextPose(
            sentence, chosen.rig_from_board, chosen.depth_mm, chosen.tilt_deg, mirror, now, predicted[best], enough
        )

    def _prepared(self) -> Iterator[_Candidate]:
        """The poses in which a mirror shows enough of the board, each with its information."""
        layout, corners = self._layout, self._target.corners_in_board_mm
        sensor = shapely.box(0.0, 0.0, layout.camera.width_px - 1.0, layout.camera.height_px - 1.0)
        regions = []
        for index in range(len(layout.mirrors)):
            outline = layout.outline_px(index, usable=True)
            regions.append(shapely.Polygon(outline[np.isfinite(outline).all(axis=1)]).intersection(sensor))
        for pose, depth_mm, tilt_deg in poses_of(layout, self._target):
            points, views = transform(pose, corners), []
            for index, region in enumerate(regions):
                pixels = layout.project(points, index)
                ids = np.flatnonzero(shapely.contains_xy(region, *np.nan_to_num(pixels, nan=-1e9).T))
                if len(ids) >= MIN_CORNERS:
                    views.append(Observations.of_view(0, index, ids, pixels[ids]))
            if views:
                yield _Candidate(pose, depth_mm, tilt_deg, self._information_in(pose, Observations.join(views)))

    def _information_in(self, pose: FloatArray, picture: Observations) -> FloatArray:
        """Fisher information (g, g) on the globals in a picture at about this pose, with the pose itself unknown."""
        estimate = Estimate.of(self._layout.camera, self._layout.mirrors, pose[None])
        noisy = replace(picture, sigma_px=np.full(len(picture), NOISE_PX))
        return normal_equations(estimate, Grouped.of(noisy, self._model), self._model).reduced(0.0)[0]

    def _pose(self, picture: Observations) -> FloatArray | None:
        """The board's pose by the layout; None where no view shows enough corners."""
        views = []
        for mirror in np.unique(picture.view).tolist():
            of_view = picture.view == mirror
            if of_view.sum() >= MIN_CORNERS:
                corners = Corners(picture.corner[of_view], picture.pixels[of_view])
                views.append((self._layout.mirrors[mirror].apparent, corners))
        if not views:
            return None
        return initial_estimates.best_pose(self._layout.camera, views, self._target.corners_in_board_mm)

    def _sigma_deg(self, information: FloatArray) -> FloatArray:
        """Standard deviations (..., mirrors) of the normals in their weakest directions, from information (..., g, g).

        A normal n = -c / |c| rotates by the displacement of the virtual centre c across it, over |c|.
        """
        covariance, sigma = np.linalg.inv(information), []
        for index, mirror in enumerate(self._layout.mirrors):
            at, across = len(self._layout.camera.intrinsics) + 3 * index, mirror.rig_from_plane[:3, :2]
            block = across.T @ covariance[..., at : at + 3, at : at + 3] @ across
            sigma.append(np.sqrt(np.linalg.eigvalsh(block)[..., -1]) / (2.0 * mirror.distance_mm))
        return np.degrees(np.stack(sigma, axis=-1))

    def _in_words(self, candidate: _Candidate) -> str:
        """Tilt and place, as the camera sees the board in its middle."""
        layout = self._layout
        half = np.array([*self._target.size_mm, 0.0])[None] / 2.0
        centre = layout.view_from_rig @ transform(candidate.rig_from_board, half)[0]
        x, y = (centre - layout.virtual_centres_in_view_mm.reshape(-1, 3).mean(axis=0))[:2]
        column = "left" if x < -1.0 else "right" if x > 1.0 else ""
        row = "up" if y < -1.0 else "down" if y > 1.0 else ""
        place = " and ".join(word for word in (row, column) if word)
        return _tilt_in_words(candidate.tilt_deg) + (f", moved {place}" if place else "")


def poses_of(layout: Layout, target: Target) -> Iterator[tuple[FloatArray, float, tuple[float, float]]]:
    """Poses, rig_from_board (4, 4), with the depth of their middle in mm and their tilts in degrees."""
    depths = (300.0, 500.0) if layout.spec is None else (min(layout.spec.depths_mm), max(layout.spec.depths_mm))
    half = np.array([*target.size_mm, 0.0]) / 2.0
    middle = layout.virtual_centres_in_view_mm.reshape(-1, 3).mean(axis=0)
    for depth_mm in np.geomspace(0.95 * depths[0], 1.1 * depths[1], 3).tolist():
        for tilt in TILTS:
            turn = Rotation.from_euler("xy", tilt, degrees=True).as_matrix()
            for x in SHIFTS:
                for y in SHIFTS:
                    centre = np.array([middle[0] + x * half[0], middle[1] + y * half[1], depth_mm])
                    pose = rigid(layout.view_from_rig.T @ turn, layout.view_from_rig.T @ (centre - turn @ half))
                    yield pose, depth_mm, tilt


def _tilt_in_words(tilt_deg: tuple[float, float]) -> str:
    about_x, about_y = tilt_deg
    if about_x == about_y == 0.0:
        return "facing the mirrors"
    edges = ("upper", "lower") if about_x else ("right", "left")
    edge = edges[0 if about_x + about_y > 0 else 1]
    return f"its {edge} edge (as the camera sees it) tilted {max(abs(about_x), abs(about_y)):.0f}° towards the mirrors"


def _place_in_words(layout: Layout, mirror: int) -> str:
    middles = np.array([np.nanmean(layout.outline_px(i), axis=0) for i in range(len(layout.mirrors))])
    size = np.array([layout.camera.width_px, layout.camera.height_px])
    x, y = middles[mirror] / size
    row = "upper" if y < 0.38 else "lower" if y > 0.62 else ""
    column = "left" if x < 0.38 else "right" if x > 0.62 else ""
    return f"{row} {column}".strip() or "middle"
