"""Maps from a mirror's view to the print on a board, and the print at several scales.

A map gives the texel that the ray of each subpixel meets; the scale is chosen by the size of footprints.
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
    """The print at scales of 1, 1/2, 1/4, ...; a footprint uses a level where it is at most one texel wide."""

    texels: NDArray[np.float32]
    levels: tuple[MipLevel, ...]


def build_mipmap(radiance: FloatArray) -> Mipmap:
    """Build the mipmap of a print (rows, columns); each texel is the mean of four texels of the finer level."""
    images = [radiance]
    while min(images[-1].shape) >= 4:
        rows, columns = images[-1].shape
        padded = np.pad(images[-1], ((0, rows % 2), (0, columns % 2)))
        images.append(padded.reshape((rows + 1) // 2, 2, (columns + 1) // 2, 2).mean(axis=(1, 3)))
    bordered = [np.pad(image, 1) for image in images]
    begins = np.cumsum([0, *(image.size for image in bordered)]).tolist()
    levels = tuple(MipLevel(begin, *image.shape[::-1]) for begin, image in zip(begins, bordered, strict=False))
    return Mipmap(np.concatenate([image.ravel() for image in bordered]).astype(np.float32), levels)


@dataclass(frozen=True)
class VirtualView:
    """Light along (x, y, 1) in the camera appears to come from `centre_in_rig_mm` along `orientation` @ (x, y, 1).

    These are the virtual centre (3,) and the reflection (3, 3) of a mirror's front, or 0 and I for the bare camera.
    The centre is shifted along -`normal_in_rig` (3,) by `PixelFootprints.centre_shift_mm`.
    """

    centre_in_rig_mm: FloatArray
    orientation: FloatArray
    normal_in_rig: FloatArray


@dataclass(frozen=True)
class PrintMap:
    """Projective map from a view to the print, which the ray r = (x, y, 1) meets at (print - s shift) r / (depth r).

    s is the shift of the view's centre, mm. `print` (2, 3) and `shift` (2, 3) are in texels; `depth` (3,) r is positive
    for rays that meet the printed side. A ray from the point (p, q) of the pupil, mm, adds p d_print[0] + q d_print[1]
    to `print` and p d_depth[0] + q d_depth[1] to depth r: `d_print` is (2, 2, 3), `d_depth` (2,).
    `inverse_depth` (3,) r is the reciprocal of the depth along the axis, 1/mm.
    """

    print: FloatArray
    depth: FloatArray
    shift: FloatArray
    d_print: FloatArray
    d_depth: FloatArray
    inverse_depth: FloatArray


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
    """Return the map from a view to the print of a board at a rigid pose (4, 4), mm, in the rig frame.

    `texels_from_board` (3, 3) maps to texels of the print. The rays of a pixel meet in the plane of focus.
    """
    board_from_rig = rig_from_board[:3, :3].T
    centre = board_from_rig @ (view.centre_in_rig_mm - rig_from_board[:3, 3])
    orientation, normal = board_from_rig @ view.orientation, board_from_rig @ view.normal_in_rig
    texels_per_mm, origin = texels_from_board[:2, :2], texels_from_board[:2, 2]

    def board_map(start: FloatArray) -> FloatArray:
        """Return rows (2, 3); divided by `orientation[2]`, they give the ray's intersection with z = 0, in texels."""
        return texels_per_mm @ (np.outer(start[:2], orientation[2]) - start[2] * orientation[:2])

    # If only the unprinted side is visible, or none, the depth is never positive.
    is_printed_side = centre[2] < 0.0
    depth = orientation[2] if is_printed_side else np.array([0.0, 0.0, -1.0])
    from_centre = board_map(centre)
    # From the point a of the pupil, the ray starts at centre + orientation a, along orientation (r - a / focus);
    # terms of second order in a cancel.
    d_depth = -orientation[2, :2] / pupil.focus_mm if is_printed_side else np.zeros(2)
    axis = np.array([0.0, 0.0, 1.0])
    d_print = [
        board_map(orientation[:, k]) + np.outer(origin * d_depth[k] - from_centre[:, k] / pupil.focus_mm, axis)
        for k in range(2)
    ]
    inverse_depth = -orientation[2] / centre[2] if is_printed_side else np.zeros(3)
    mean_ray = _mean_ray(inverse_depth, pupil)
    return PrintMap(
        (from_centre + np.outer(origin, orientation[2])) @ mean_ray,
        depth @ mean_ray,
        board_map(normal) @ mean_ray,
        np.stack(d_print) @ mean_ray,
        d_depth,
        inverse_depth,
    )


def _mean_ray(inverse_depth: FloatArray, pupil: Pupil) -> FloatArray:
    """Matrix (3, 3) from the chief ray (3,) of a pixel to the mean of its rays through the pupil, seen from the centre.

    From the pupil point a, the ray of a pixel r meets the board where the ray r + a (n - 1 / focus) from the
    centre does; n is the board's inverse depth there, 1/mm. Over a pupil of diameter A, the mean square of a along an
    axis is A^2 / 16.
    """
    gain = pupil.aperture_mm**2 / 16.0 * np.append(inverse_depth[:2], 0.0)
    return np.eye(3) + np.outer(gain, inverse_depth - np.array([0.0, 0.0, 1.0 / pupil.focus_mm]))


def coefficients(to_print: PrintMap, steps: FloatArray, scale: float) -> list[float]:
    """The 35 coefficients of a map to a mipmap level, whose texels are counted from the corner of the border.

    `steps` (2, 2) are those of `PixelFootprints`, `scale` is the width of a texel of the print in texels of the level.
    """
    numerator = scale * to_print.print + to_print.depth
    d_print = scale * to_print.d_print
    d_print[:, :, 2] += to_print.d_depth[:, None]
    parts = (
        numerator,
        to_print.depth,
        scale * to_print.shift,
        numerator[:, :2] @ steps,
        to_print.depth[:2] @ steps,
        d_print,
        to_print.d_depth,
    )
    return [float(number) for part in parts for number in part.ravel()]
