"""Corners of a rendered board, located to a few ten-thousandths of a pixel, against a projection in float64.

The localiser knows nothing of the truth but where to start: it fits two curved edges, blurred, to the picture.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import erf

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.truth.corners import CornerProjector

BLUR_PX = 0.8
HALF_PX = 7  # of the localiser's window
MARGIN_PX = 20  # around a window, so that the blur has what it needs
TARGET = Checkerboard(cols=20, rows=14, square_mm=12.0)
CROP = (180, 130)

Crop = tuple[int, int, int, int]


def tilted_board(layout: Layout) -> FloatArray:
    """A pose, rig_from_board (4, 4) in mm, of a tilted and turned board whose squares span about 35 px."""
    turn = layout.view_from_rig.T @ Rotation.from_euler("xyz", [12, -9, 7], degrees=True).as_matrix()
    middle = layout.view_from_rig.T @ np.array([3.0, -60.0, 400.0])
    return rigid(turn, middle - turn @ np.array([*TARGET.size_mm, 0.0]) / 2.0)


def windows(layout: Layout) -> list[Crop]:
    """A window, x, y, width, height in pixels, in the middle of each sub-image."""
    middles = [layout.outline_px(index).mean(axis=0).astype(int) for index in range(len(layout.mirrors))]
    return [(int(x) - CROP[0] // 2, int(y) - CROP[1] // 2, *CROP) for x, y in middles]


def photographed(radiance: NDArray[np.float32], cut: int) -> FloatArray:
    """The picture of radiance whose pixels are cut into `cut` x `cut`: blurred at subpixels, then averaged."""
    blurred = cv2.GaussianBlur(radiance.astype(np.float64), (0, 0), BLUR_PX * cut)
    height, width = (length // cut for length in radiance.shape)
    return np.asarray(blurred.reshape(height, cut, width, cut).mean(axis=(1, 3)))


def locate(
    picture: FloatArray, start: FloatArray, tangents: FloatArray, dark_first: bool, *, misfit_allowed: float = 0.02
) -> FloatArray:
    """Where two blurred edges cross, to a few ten-thousandths of a pixel; faint ghosts next to them misfit.

    Fits point (2), directions (2), curvatures (2), mean, contrast and blur, from the directions of `tangents` (2, 2).
    """
    x0, y0 = np.round(start).astype(int)
    window = picture[y0 - HALF_PX : y0 + HALF_PX + 1, x0 - HALF_PX : x0 + HALF_PX + 1].ravel()
    y, x = np.mgrid[-HALF_PX : HALF_PX + 1, -HALF_PX : HALF_PX + 1].reshape(2, -1)

    def misfit(p: FloatArray) -> FloatArray:
        product = np.ones(len(window))
        for angle, curvature in ((p[2], p[4]), (p[3], p[5])):
            dx, dy = x - p[0], y - p[1]
            along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
            product *= erf((across + curvature * along**2) / (np.sqrt(2.0) * p[8]))
        return p[6] + p[7] * product - window

    angles = np.arctan2(tangents[:, 1], tangents[:, 0])
    turn = np.sign(np.sin(angles[1] - angles[0]))  # the product is positive between the two directions, or beside
    contrast = np.ptp(window) / 2.0 * (turn if dark_first else -turn)
    guess = [*(start - [x0, y0]), *angles, 0.0, 0.0, window.min() + np.ptp(window) / 2.0, contrast, BLUR_PX]
    found = least_squares(misfit, guess, method="lm")
    assert np.sqrt(np.mean(found.fun**2)) < misfit_allowed * np.ptp(window)
    return np.array([found.x[0] + x0, found.x[1] + y0])


def errors_by_mirror(
    pictures: dict[int, FloatArray],
    crops: list[Crop],
    layout: Layout,
    rig_from_board: FloatArray,
    *,
    misfit_allowed: float = 0.02,
) -> dict[int, FloatArray]:
    """Located minus projected corners (n, 2) in each mirror's window, px."""
    projector = CornerProjector(layout, TARGET)
    px, visible = projector.via_mirrors(rig_from_board)
    steps = []
    for axis in (0, 1):
        moved = rigid(np.eye(3), 0.1 * np.eye(3)[axis])
        steps.append(projector.via_mirrors(rig_from_board @ moved)[0] - px)
    random = np.random.default_rng(0)
    errors = {}
    for index, picture in pictures.items():
        crop, found = crops[index], []
        for corner in np.flatnonzero(visible[index]):
            expected = px[index, corner] - crop[:2]
            if (expected < HALF_PX + 4).any() or (expected > np.array(CROP) - HALF_PX - 5).any():
                continue
            row, col = divmod(int(corner), TARGET.cols - 1)
            tangents = np.stack([step[index, corner] for step in steps])
            start = expected + random.normal(0.0, 0.2, 2)
            dark_first = (row + col) % 2 == 0
            at = locate(picture, start, tangents, dark_first, misfit_allowed=misfit_allowed)
            found.append(at - expected)
        errors[index] = np.array(found)
    return errors
