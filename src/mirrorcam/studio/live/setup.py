"""Alignment of mirrors and hints for calibration pictures of a live session, in its own process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.alignment.alignment import Alignment, EdgeAligner, SceneAligner
from mirrorcam.optics.calibration.detection.detect_boards import detect_sub_images
from mirrorcam.optics.calibration.detection.next_pose import NextPosePlanner, board_pose
from mirrorcam.optics.drift.drift import MIN_MIRRORS
from mirrorcam.optics.geometry.boards import load_board
from mirrorcam.optics.geometry.layout import Layout

Aligning = Literal["off", "waiting", "measuring"]
"""State of the comparison with the layout: off, waiting for frames, or measuring in them."""
FRAMES = 3
"""Number of frames in which points of the scene are matched."""


@dataclass(frozen=True)
class TiltWords:
    """The tilt of a mirror by one source in words, and its standard deviations to the right and down."""

    words: str
    sigma_deg: tuple[float, float]


@dataclass(frozen=True)
class AlignmentReport:
    """Alignment of the mirrors by some frames.

    Attributes
    ----------
    names
        Names of the mirrors.
    edges, scene
        Tilts by edges of sub-images, and by points of the scene, empty if those are not matched.
    camera
        Orientation of the camera, in words.
    designed_px, seen_px
        Points of edges as designed, and as detected; only detected ones.
    points
        Number of points of the scene.
    """

    names: tuple[str, ...]
    edges: tuple[TiltWords, ...]
    scene: tuple[TiltWords, ...]
    camera: str
    designed_px: tuple[tuple[float, float], ...]
    seen_px: tuple[tuple[float, float], ...]
    points: int


@dataclass(frozen=True)
class PoseHint:
    """The board in a calibration picture, and the recommendation for the next.

    Attributes
    ----------
    picture
        Its name.
    views, corners
        Numbers of mirrors that show the board, and of corners.
    sentence
        The pose of the board in the next picture, in words.
    sigma_deg
        Standard deviation of the least certain mirror's normal so far.
    """

    picture: str
    views: int
    corners: int
    sentence: str
    sigma_deg: float


class LiveSetup:
    """Aligns mirrors, and plans calibration pictures of one layout with a board.

    Raises InputError for files that cannot be read.
    """

    def __init__(self, layout: Path, board: Path | None) -> None:
        cv2.setNumThreads(1)
        self.layout = Layout.load(layout)
        self._previous: Alignment | None = None
        self._board = None if board is None else load_board(board)

    @cached_property
    def _edges(self) -> EdgeAligner:
        return EdgeAligner(self.layout)

    @cached_property
    def _scene(self) -> SceneAligner | None:
        return SceneAligner(self.layout) if len(self.layout.mirrors) >= MIN_MIRRORS else None

    @cached_property
    def _planner(self) -> NextPosePlanner:
        assert self._board is not None
        return NextPosePlanner.for_layout(self.layout, self._board)

    def align(self, frames: tuple[NDArray[np.uint8], ...], restart: bool) -> AlignmentReport:
        """Measure the alignment in frames (h, w); `restart` ignores earlier results."""
        edges = self._previous = self._edges.align(frames, None if restart else self._previous)
        scene = None if self._scene is None else self._scene.align(frames[-FRAMES:])
        assert edges.edges is not None
        designed, detected = edges.edges.edge_positions
        return AlignmentReport(
            names=self.layout.mirror_names,
            edges=_words(edges),
            scene=() if scene is None else _words(scene),
            camera=camera_words(edges),
            designed_px=tuple(map(tuple, designed.round(1).tolist())),
            seen_px=tuple(map(tuple, detected.round(1).tolist())),
            points=0 if scene is None else scene.points,
        )

    def add_picture(self, path: Path) -> PoseHint:
        """Find the board in a picture, and recommend its pose for the next one."""
        assert self._board is not None
        corners = detect_sub_images(read_image(path, grey=True), self.layout, self._board).corners
        pose = board_pose(self.layout, self._board, corners) if len(corners) else None
        if pose is not None:
            self._planner.add(pose, corners)
        next_pose = self._planner.next()
        return PoseHint(
            picture=path.name,
            views=len(np.unique(corners.view)),
            corners=len(corners),
            sentence=next_pose.sentence,
            sigma_deg=float(next_pose.sigma_deg.max()),
        )


def _words(alignment: Alignment) -> tuple[TiltWords, ...]:
    return tuple(TiltWords(tilt.words, tilt.sigma_deg) for tilt in alignment.mirrors)


def camera_words(alignment: Alignment) -> str:
    """Orientation of the camera: "camera turned 0.4° right, 0.1° up, rolled 0.2°"; axes of the picture."""
    rotation, sigma = alignment.camera_rotation_deg, alignment.camera_rotation_sigma_deg
    if not np.isfinite(rotation).all():
        return "camera orientation not determined"
    right, up, roll = rotation[1], rotation[0], rotation[2]
    sideways = f"{abs(right):.1f}° {'right' if right >= 0 else 'left'} (±{sigma[1]:.1f}°)"
    upwards = f"{abs(up):.1f}° {'up' if up >= 0 else 'down'} (±{sigma[0]:.1f}°)"
    rolled = f"{abs(roll):.1f}° {'clockwise' if roll >= 0 else 'anticlockwise'} (±{sigma[2]:.1f}°)"
    return f"camera turned {sideways}, {upwards}, rolled {rolled}"
