"""The size of the board that the distances between a layout's mirrors imply, where pictures do not fit the layout.

Each mirror shows the middle of the board at a distance in proportion to the board's size. Reflected back, all of them
show one point, which holds only at one size. A size that was stated in another unit is recognised by its ratio.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.assignment import likely_mirror
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import find_boards
from mirrorcam.optics.calibration.solver.initial_estimates import camera_from_flat_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import AprilGrid, Target
from mirrorcam.optics.geometry.transforms import transform

UNITS = ((10.0, "cm"), (25.4, "inches"), (1000.0, "m"))
SAME_UNIT = 1.15  # ratio of the sizes, to that of two units
OTHER_SIZE = 1.5  # ratio of the sizes, from which they do not differ by a print's scale
AGREEING = 0.9  # correlation of where mirrors show the board with where they are


def other_size(pictures: Sequence[Grey], layout: Layout, target: Target) -> str | None:
    """Say that pictures through the mirrors of a layout fit a board of another size; None where they do not."""
    ratio = size_ratio(pictures, layout, target)
    if ratio is None or 1.0 / OTHER_SIZE < ratio < OTHER_SIZE:
        return None
    side, what = (target.tag_mm, "tags") if isinstance(target, AprilGrid) else (target.square_mm, "squares")
    said = f"board.toml says {what} of {side:g} mm, the pictures fit about"
    for factor, unit in UNITS:
        if max(ratio / factor, factor / ratio) < SAME_UNIT:
            return f"{said} {side * factor:.3g} mm: were they measured in {unit}?"
    return f"{said} {side * ratio:.2g} mm in this layout: is either of them of another device?"


def size_ratio(pictures: Sequence[Grey], layout: Layout, target: Target) -> float | None:
    """Size of the board that pictures imply by the stated one; None where they do not agree on any."""
    shown, places = [], []
    for picture in pictures:
        middles = _middles(picture, layout, target)
        if len(middles) < 2:
            continue
        centres = np.array([layout.mirrors[mirror].apparent.virtual_centre_in_rig_mm for mirror in middles])
        points = np.array(list(middles.values()))
        normals = centres / np.linalg.norm(centres, axis=1, keepdims=True)
        turned = points - 2.0 * np.sum(points * normals, axis=1, keepdims=True) * normals
        shown.append(turned - turned.mean(axis=0))
        places.append(centres.mean(axis=0) - centres)
    if not shown:
        return None
    a, b = np.concatenate(shown), np.concatenate(places)
    agreement = float(np.sum(a * b) / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-12))
    return float(np.linalg.norm(b) / np.linalg.norm(a)) if agreement > AGREEING else None


def _middles(picture: Grey, layout: Layout, target: Target) -> dict[int, FloatArray]:
    """Where the largest board in each mirror has its middle (3,), as it is seen and of the stated size."""
    found: dict[int, FloatArray] = {}
    middle = target.corners_in_board_mm.mean(axis=0, keepdims=True)
    for board, *_ in find_boards(picture, target, mirrored=True, most=2 * len(layout.mirrors)):
        mirror = likely_mirror(board, layout)
        if mirror is None or mirror in found:
            continue
        pose = camera_from_flat_board(layout.camera, board, target.corners_in_board_mm)
        if pose is not None:
            found[mirror] = transform(pose, middle)[0]
    return found
