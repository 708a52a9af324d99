"""Ground truth of corners: the pixel of every corner of a board in a frame, and its visibility, in float64.

Corners are projected by the layout's methods; renderers share no code with them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.boards import poses_at
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.truth.light_rays import Obstacles, image_px, trace_via_mirror

BoolArray = NDArray[np.bool_]
READOUT_STEPS = 12  # iterations that find the readout time of a corner; each divides its error by about ten
VISIBLE_MARGIN_PX = 2.0  # a corner nearer to the edge of its sub-image, or of the sensor, counts as not seen


def _on_sensor(camera: Camera, px: FloatArray) -> BoolArray:
    """Return the mask of pixels (..., 2) at least the margin inside the sensor; False at NaN."""
    far_edge = np.array([camera.width_px, camera.height_px]) - 1.0 - VISIBLE_MARGIN_PX
    return np.all((px >= VISIBLE_MARGIN_PX) & (px <= far_edge), axis=-1)


def _is_facing(centre_in_rig: FloatArray, rig_from_board: FloatArray) -> bool:
    """Return whether the printed side (the board's -z) faces a point (3,) in the rig frame, mm."""
    return bool((centre_in_rig - rig_from_board[:3, 3]) @ rig_from_board[:3, 2] < 0)


def _is_unoccluded(layout: Layout, index: int, points: FloatArray) -> BoolArray:
    """Return the mask of points (n, 3) in the rig frame whose rays from mirror `index` miss all other mirrors."""
    mirror = layout.mirrors[index]
    virtual = mirror.reflect(points)
    at_mirror = mirror.intersect(virtual[:, :2] / virtual[:, 2:])
    clear = np.ones(len(points), dtype=np.bool_)
    for other_index, other in enumerate(layout.mirrors):
        start, end = (p @ other.normal_in_rig + other.distance_mm for p in (at_mirror, points))
        crosses = (start > 0) != (end > 0)
        if other_index == index or not crosses.any():
            continue
        fraction = start[crosses] / (start - end)[crosses]
        crossing = at_mirror[crosses] + fraction[:, None] * (points - at_mirror)[crosses]
        frame = other.rig_from_plane
        x, y = ((crossing - frame[:3, 3]) @ frame[:3, :2]).T
        clear[crosses] &= ~shapely.contains_xy(shapely.Polygon(other.outline_in_plane_mm), x, y)
    return clear


def _leaves_by_front(camera: Camera, mirror: Mirror, px: FloatArray, finish: MirrorFinish | None) -> BoolArray:
    """Return the mask of pixels (n, 2) whose rays within `VISIBLE_MARGIN_PX` all leave a mirror through its front."""
    length = trace_via_mirror(mirror, _unit_rays_around(camera, px), finish)[3]
    return np.asarray(np.isfinite(length).all(axis=1))


def _unit_rays_around(camera: Camera, px: FloatArray) -> FloatArray:
    """Return unit rays (n, 4, 3) at a distance of `VISIBLE_MARGIN_PX` from pixels (n, 2)."""
    margin = VISIBLE_MARGIN_PX * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    rays = camera.unproject(px[:, None] + margin)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def sub_image(layout: Layout, index: int) -> shapely.Polygon:
    """Return the outline of a sub-image in pixels, clipped to the domain of the lens model."""
    outline = layout.outline_px(index)
    inside = outline[np.isfinite(outline).all(axis=1)]
    return shapely.Polygon(inside) if len(inside) >= 3 else shapely.Polygon()


class CornerProjector:
    """Projection of a board via every mirror of a layout, with the visibility of its corners.

    Parameters
    ----------
    layout
        The device as built.
    board
        The board.
    finishes
        Surface finishes of the mirrors; by default they are flat.
    obstacles
        Bodies around the mirrors, if any.
    """

    def __init__(
        self,
        layout: Layout,
        board: CalibrationBoard,
        finishes: Sequence[MirrorFinish] = (),
        obstacles: Obstacles | None = None,
    ) -> None:
        self.layout, self.board, self._obstacles = layout, board, obstacles
        self._finishes = finishes or (None,) * len(layout.mirrors)
        self._windows = [sub_image(layout, index).buffer(-VISIBLE_MARGIN_PX) for index in range(len(layout.mirrors))]
        shapely.prepare(self._windows)

    def via_mirrors(self, rig_from_board: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project the corners of a board via each mirror.

        A corner is visible if it lies in front of the mirror and at least `VISIBLE_MARGIN_PX` inside the sub-image and
        the sensor, if its light is not clipped by the rim of a second-surface mirror, if the printed side faces the
        virtual camera, and if no other mirror or obstacle occludes it.

        Parameters
        ----------
        rig_from_board
            Rigid pose (4, 4) of the board, mm.

        Returns
        -------
        px
            Pixels (mirrors, corners, 2); NaN where a corner has no image.
        visible
            Mask (mirrors, corners).
        """
        points = transform(rig_from_board, self.board.corners_in_board_mm)
        px = np.empty((len(self.layout.mirrors), len(points), 2))
        visible = np.empty(px.shape[:2], dtype=np.bool_)
        for index, mirror in enumerate(self.layout.mirrors):
            px[index] = self._image(index, points)
            visible[index] = self._is_visible(index, points, px[index])
            visible[index] &= _is_facing(mirror.virtual_centre_in_rig_mm, rig_from_board)
        return px, visible

    def during_readout(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project the corners via each mirror with a rolling shutter, for poses (3, 4, 4) as in `boards.poses_at`.

        Each corner is projected at the board's pose while its row is read out.
        """
        corners = np.column_stack([self.board.corners_in_board_mm, np.ones(len(self.board.corners_in_board_mm))])
        px = np.empty((len(self.layout.mirrors), len(corners), 2))
        visible = np.empty(px.shape[:2], dtype=np.bool_)
        for index, mirror in enumerate(self.layout.mirrors):
            px[index] = self._image(index, transform(poses[1], self.board.corners_in_board_mm))
            for _ in range(READOUT_STEPS):
                fractions = np.nan_to_num(px[index, :, 1] / (self.layout.camera.height_px - 1), nan=0.5)
                points = (poses_at(poses, np.clip(fractions, 0.0, 1.0)) @ corners[..., None])[:, :3, 0]
                px[index] = self._image(index, points)
            visible[index] = self._is_visible(index, points, px[index])
            visible[index] &= _is_facing(mirror.virtual_centre_in_rig_mm, poses[1])
        return px, visible

    def _image(self, index: int, points: FloatArray) -> FloatArray:
        """Project points (n, 3) in the rig frame via a mirror to pixels (n, 2); NaN without an image."""
        return image_px(self.layout.camera, self.layout.mirrors[index], points, self._finishes[index])

    def _is_visible(self, index: int, points: FloatArray, px: FloatArray) -> BoolArray:
        """Return the visibility of points (n, 3) imaged at pixels (n, 2), whichever side the board shows."""
        mirror = self.layout.mirrors[index]
        visible = _on_sensor(self.layout.camera, px)
        visible &= points @ mirror.normal_in_rig + mirror.distance_mm > 0
        visible &= shapely.contains_xy(self._windows[index], *np.nan_to_num(px, nan=-1e9).T)
        finish = self._finishes[index]
        if mirror.is_second_surface or (finish is not None and not finish.flat):
            visible[visible] = _leaves_by_front(self.layout.camera, mirror, px[visible], finish)
        visible[visible] = _is_unoccluded(self.layout, index, points[visible])
        if self._obstacles is not None:
            visible[visible] = self._is_obstacle_free(self._obstacles, index, points[visible], px[visible])
        return visible

    def _is_obstacle_free(self, obstacles: Obstacles, index: int, points: FloatArray, px: FloatArray) -> BoolArray:
        """Return the mask of pixels (n, 2) without an obstacle between the pupil, the mirror and points (n, 3)."""
        rays = _unit_rays_around(self.layout.camera, px)
        entry_mm, start, direction, _ = trace_via_mirror(self.layout.mirrors[index], rays, self._finishes[index])
        clear = obstacles.distance_from_pupil_mm(rays) > entry_mm
        clear &= obstacles.distance_to_body_mm(start, direction) > np.linalg.norm(points[:, None] - start, axis=-1)
        return np.asarray(clear.all(axis=1))

    def direct(self, rig_from_board: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project the corners without mirrors: pixels (corners, 2) and visibility (corners,)."""
        points = transform(rig_from_board, self.board.corners_in_board_mm)
        px = image_px(self.layout.camera, None, points)
        return px, _on_sensor(self.layout.camera, px) & _is_facing(np.zeros(3), rig_from_board)

    def all_via_mirrors(self, readouts: Sequence[FloatArray]) -> tuple[FloatArray, BoolArray]:
        """Stack the results of `via_mirrors` or `during_readout` for frames of 1 or 3 poses (1 or 3, 4, 4).

        The shapes are (frames, mirrors, corners, 2) and (frames, mirrors, corners).
        """
        corners = len(self.board.corners_in_board_mm)
        px = np.empty((len(readouts), len(self.layout.mirrors), corners, 2))
        visible = np.empty(px.shape[:3], dtype=np.bool_)
        for frame, poses in enumerate(readouts):
            px[frame], visible[frame] = self.during_readout(poses) if len(poses) == 3 else self.via_mirrors(poses[0])
        return px, visible

    def all_direct(self, poses: Sequence[FloatArray]) -> tuple[FloatArray, BoolArray]:
        """Stack the results of `direct` for poses: (poses, corners, 2) and (poses, corners)."""
        px = np.empty((len(poses), len(self.board.corners_in_board_mm), 2))
        visible = np.empty(px.shape[:2], dtype=np.bool_)
        for frame, pose in enumerate(poses):
            px[frame], visible[frame] = self.direct(pose)
        return px, visible
