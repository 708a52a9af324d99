"""Maps from a mirror's view to the print on a board, and the print at several scales.

A map gives the texel at the ray of each subpixel; the scale depends on the size of footprints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil


@dataclass(frozen=True)
class MipLevel:
    """One level of a mipmap: `columns` x `rows` texels with a black border, starting at `begin` in `Mipmap.texels`."""

    begin: int
    columns: int
    rows: int


@dataclass(frozen=True)
class Mipmap:
    """The print at scales of 1, 1/2, 1/4, ...; a footprint is at most one texel wide on its level."""

    texels: NDArray[np.float32]
    levels: tuple[MipLevel, ...]


def build_mipmap(radiance: FloatArray) -> Mipmap:
    """Build the mipmap of a print (rows, columns); each texel is the mean of four texels of the finer level."""
    images = [radiance]
    while min(images[-1].shape) >= 4:
        rows, columns = images[-1].shape
        padded = np.pad(images[-1], ((0, rows % 2), (0, columns % 2)))
        images.append(padded.reshape((rows + 1) // 2, 2, (columns + 1) // 2, 2).mean(axis=(1, 3)))
    rimmed = [np.pad(image, 1) for image in images]
    begins = np.cumsum([0, *(image.size for image in rimmed)]).tolist()
    levels = tuple(MipLevel(begin, *image.shape[::-1]) for begin, image in zip(begins, rimmed, strict=False))
    return Mipmap(np.concatenate([image.ravel() for image in rimmed]).astype(np.float32), levels)


@dataclass(frozen=True)
class VirtualView:
    """Light along (x, y, 1) in the camera appears to come from `centre_in_rig_mm` (3,) along `turn` (3, 3) @ (x, y, 1).

    These are the virtual centre and the reflection of a mirror's front, or zero and identity for the bare camera.
    The centre is shifted along -`normal_in_rig` (3,) by `PixelFootprints.centre_shift_mm`.
    """

    centre_in_rig_mm: FloatArray
    turn: FloatArray
    normal_in_rig: FloatArray


@dataclass(frozen=True)
class PrintMap:
    """Projective map from a view to the print: the ray r = (x, y, 1) meets it at (print - s shift) r / (depth r).

    s is the shift of the view's centre. `print` (2, 3) and `shift` (2, 3) are in texels; `depth` (3,) r is positive for
    rays that meet the printed side. A ray from the point (p, q) of the pupil, mm, adds p across[0] + q across[1] to
    `print` and p stretch[0] + q stretch[1] to depth r: `across` is (2, 2, 3), `stretch` (2,). `nearness` (3,) r is the
    reciprocal of the distance, mm, along the axis.
    """

    print: FloatArray
    depth: FloatArray
    shift: FloatArray
    across: FloatArray
    stretch: FloatArray
    nearness: FloatArray


def virtual_views(mirrors: tuple[Mirror, ...]) -> tuple[VirtualView, ...]:
    """Return the view of each mirror; without mirrors, the view of the bare camera."""
    if not mirrors:
        return (VirtualView(np.zeros(3), np.eye(3), np.zeros(3)),)
    return tuple(
        VirtualView(-2.0 * front_distance_mm(mirror) * mirror.normal_in_rig, mirror.reflection, mirror.normal_in_rig)
        for mirror in mirrors
    )


def front_distance_mm(mirror: Mirror) -> float:
    """Return the distance of the front of a mirror from the pupil."""
    return mirror.distance_mm - mirror.front_mm


def map_to_print(
    view: VirtualView, rig_from_board: FloatArray, texels_from_board: FloatArray, pupil: Pupil
) -> PrintMap:
    """Return the map from a view to the print (3x3 `texels_from_board`) of a board at a rigid pose (4, 4) in rig, mm.

    The rays of the pupil meet in its plane of focus.
    """
    board_from_rig = rig_from_board[:3, :3].T
    centre = board_from_rig @ (view.centre_in_rig_mm - rig_from_board[:3, 3])
    turn, normal = board_from_rig @ view.turn, board_from_rig @ view.normal_in_rig
    flat, origin = texels_from_board[:2, :2], texels_from_board[:2, 2]

    def meets_board(start: FloatArray) -> FloatArray:
        """Return rows (2, 3); divided by `turn[2]`, they give the ray's intersection with z = 0, in texels."""
        return flat @ (np.outer(start[:2], turn[2]) - start[2] * turn[:2])

    # Seen from the unprinted side, or looking away: a depth that is never positive.
    shown = centre[2] < 0.0
    depth = turn[2] if shown else np.array([0.0, 0.0, -1.0])
    from_centre = meets_board(centre)
    # From the point a of the pupil, the ray starts at centre + turn a along turn (r - a / focus); terms of second order
    # in a cancel.
    stretch = -turn[2, :2] / pupil.focus_mm if shown else np.zeros(2)
    upright = np.array([0.0, 0.0, 1.0])
    across = [
        meets_board(turn[:, k]) + np.outer(origin * stretch[k] - from_centre[:, k] / pupil.focus_mm, upright)
        for k in range(2)
    ]
    nearness = -turn[2] / centre[2] if shown else np.zeros(3)
    middle = _mean_ray(nearness, pupil)
    return PrintMap(
        (from_centre + np.outer(origin, turn[2])) @ middle,
        depth @ middle,
        meets_board(normal) @ middle,
        np.stack(across) @ middle,
        stretch,
        nearness,
    )


def _mean_ray(nearness: FloatArray, pupil: Pupil) -> FloatArray:
    """Matrix (3, 3) from the chief ray (3,) of a pixel to the mean of its rays through the pupil, seen from the centre.

    From the pupil point a, the ray of a pixel r meets the board where r + a (n - 1 / focus) from the centre does;
    n is the board's nearness there. Over a pupil of diameter A, the mean of the square of a along an axis is A^2 / 16.
    """
    along = pupil.aperture_mm**2 / 16.0 * np.append(nearness[:2], 0.0)
    return np.eye(3) + np.outer(along, nearness - np.array([0.0, 0.0, 1.0 / pupil.focus_mm]))


def coefficients(to_print: PrintMap, steps: FloatArray, scale: float) -> list[float]:
    """The 35 coefficients of a map to a mipmap level, whose texels are counted from the corner of the border.

    `steps` (2, 2) are those of `PixelFootprints`, `scale` is the width of the print's texels in those of the level.
    """
    at = scale * to_print.print + to_print.depth
    across = scale * to_print.across
    across[:, :, 2] += to_print.stretch[:, None]
    parts = (
        at,
        to_print.depth,
        scale * to_print.shift,
        at[:, :2] @ steps,
        to_print.depth[:2] @ steps,
        across,
        to_print.stretch,
    )
    return [float(number) for part in parts for number in part.ravel()]
