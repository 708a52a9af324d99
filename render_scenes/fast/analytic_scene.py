"""Analytic renderer of a board seen via mirrors, for large sets.

The virtual origin of the light of every subpixel is computed once per device (`fast.pixel_footprints`). A frame needs,
for each mirror, a projective map to the print, made in float64, and for each subpixel the mean of the print over its
footprint: a box along the axes of the print with the second moments of the footprint, exact for the 2 x 2 texels that
it meets. There is no light of more than one reflection, and nothing but mirrors occludes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.render_scenes.boards.printed_board import board_from_texels, printed_radiance
from mirrorcam.render_scenes.fast.arithmetic import Arithmetic, DrJitArithmetic, NumpyArithmetic
from mirrorcam.render_scenes.fast.pixel_footprints import PixelFootprints, VirtualView, pixel_footprints, virtual_views
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, uniform_finishes
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.variant import SCALAR, use_variant

SAMPLED = 64  # footprints of a view that choose its mipmap level


@dataclass(frozen=True)
class MipLevel:
    """One level of a mipmap: `columns` x `rows` texels, with a black border, from `begin` on in `Mipmap.texels`."""

    begin: int
    columns: int
    rows: int


@dataclass(frozen=True)
class Mipmap:
    """The print at scales of 1, 1/2, 1/4, ...; on the level that is used, a footprint is at most a texel wide."""

    texels: NDArray[np.float32]
    levels: tuple[MipLevel, ...]


@dataclass(frozen=True)
class PrintMap:
    """Projective map from a view to the print: the ray r = (x, y, 1) meets it at (print - s slide) r / (depth r).

    s is the shift of the view's centre. `print` (2, 3) and `slide` (2, 3) are in texels; `depth` (3,) r is positive for
    rays that meet the printed side.
    """

    print: FloatArray
    depth: FloatArray
    slide: FloatArray


@dataclass(frozen=True)
class _LoadedFootprints:
    """Footprints as arrays of the arithmetic, and the normalized coordinates (m, 2) of a sample of them."""

    view: int
    steps: FloatArray
    some: FloatArray
    square: Any
    x: Any
    y: Any
    slide_mm: Any
    weight: Any


def build_mipmap(radiance: FloatArray) -> Mipmap:
    """Build the mipmap of a print (rows, columns); each texel is the mean of four of the level before."""
    images = [radiance]
    while min(images[-1].shape) >= 4:
        rows, columns = images[-1].shape
        padded = np.pad(images[-1], ((0, rows % 2), (0, columns % 2)))
        images.append(padded.reshape((rows + 1) // 2, 2, (columns + 1) // 2, 2).mean(axis=(1, 3)))
    rimmed = [np.pad(image, 1) for image in images]
    begins = np.cumsum([0, *(image.size for image in rimmed)]).tolist()
    levels = tuple(MipLevel(begin, *image.shape[::-1]) for begin, image in zip(begins, rimmed, strict=False))
    return Mipmap(np.concatenate([image.ravel() for image in rimmed]).astype(np.float32), levels)


class FastScene:
    """A movable board, seen by a camera via flat mirrors or, without any, directly.

    Moving the board costs no compilation. Where neither a GPU nor an LLVM compiles, NumPy computes the same.

    Parameters
    ----------
    camera
        The camera, at the origin of the frame rig.
    mirrors
        The mirrors; none for the bare camera.
    target
        The board.
    settings
        Light, reflectance and subpixels.
    finishes
        Surface finishes, of which only the reflectance is used; without them, uniform mirrors.
    variant
        Mitsuba's variant; by default the fastest that this machine can run.
    """

    def __init__(
        self,
        camera: Camera,
        mirrors: tuple[Mirror, ...],
        target: Target,
        settings: RenderSettings,
        *,
        finishes: Sequence[MirrorFinish] = (),
        variant: str | None = None,
    ) -> None:
        self.variant = use_variant(variant)
        self._xp: Arithmetic = NumpyArithmetic() if self.variant == SCALAR else DrJitArithmetic()
        self._shape = camera.height_px * settings.subpixels, camera.width_px * settings.subpixels
        self._mipmap = build_mipmap(printed_radiance(target, settings))
        self._texels = self._xp.loaded(self._mipmap.texels)
        self._texels_from_board = np.asarray(np.linalg.inv(board_from_texels(target)), dtype=np.float64)
        self._views = virtual_views(mirrors)
        reflectances = np.array([finish.luminance for finish in finishes or uniform_finishes(settings, len(mirrors))])
        layers = pixel_footprints(camera, mirrors, settings.subpixels, reflectances)
        self._layers = [[self._loaded(footprints) for footprints in layer] for layer in layers]
        self.place_board(np.eye(4))

    def place_board(self, *poses: FloatArray) -> None:
        """Move the board to a rigid 4x4 pose, mm, or to three: at the readout of the first, middle and last row.

        With the three poses of a rolling shutter, the map to the print follows a parabola through their maps.
        """
        self._maps = [
            tuple(map_to_print(view, pose, self._texels_from_board) for pose in poses) for view in self._views
        ]

    def render(self) -> NDArray[np.float32]:
        """Render the radiance (h * subpixels, w * subpixels), float32, of the whole sensor; nothing is random."""
        canvases = [self._xp.canvas(self._shape[0] * self._shape[1]) for _ in self._layers]
        for canvas, layer in zip(canvases, self._layers, strict=True):
            for footprints in layer:
                maps = self._maps[footprints.view]
                index = self._level(maps[len(maps) // 2], footprints)
                numbers = [self._xp.numbers(_scaled(to_print, footprints, 0.5**index)) for to_print in maps]
                self._xp.put(canvas, footprints.square, self._radiance(footprints, self._mipmap.levels[index], numbers))
        # A single layer, without a copy, unless there are plates or mirrors that hide each other.
        light = self._xp.finished(canvases[0])
        for canvas in canvases[1:]:
            light = light + self._xp.finished(canvas)
        return light.reshape(self._shape)

    def _loaded(self, footprints: PixelFootprints) -> _LoadedFootprints:
        some = slice(None, None, max(len(footprints.square) // SAMPLED, 1))
        arrays = (
            self._xp.loaded(values)
            for values in (footprints.square, footprints.x, footprints.y, footprints.slide_mm, footprints.weight)
        )
        return _LoadedFootprints(
            footprints.view,
            footprints.steps,
            np.column_stack([footprints.x, footprints.y])[some].astype(np.float64),
            *arrays,
        )

    def _level(self, to_print: PrintMap, footprints: _LoadedFootprints) -> int:
        """The finest level whose texels are as wide as the view's footprints."""
        rays = np.column_stack([footprints.some, np.ones(len(footprints.some))])
        rays = rays[rays @ to_print.depth > 0.0]
        depth = (rays @ to_print.depth)[:, None]
        at = rays @ to_print.print.T / depth
        moves = to_print.print[:, :2] @ footprints.steps - at[:, :, None] * (to_print.depth[:2] @ footprints.steps)
        widest = (np.linalg.norm(moves, axis=-1) / depth).max(initial=1.0)
        return int(min(np.ceil(np.log2(widest)), len(self._mipmap.levels) - 1))

    def _radiance(self, footprints: _LoadedFootprints, level: MipLevel, numbers: list[list[Any]]) -> Any:
        """Mean radiance of the print over footprints, times their transmittance."""
        xp, x, y, slide = self._xp, footprints.x, footprints.y, footprints.slide_mm
        n = numbers[0]
        if len(numbers) == 3:
            time = xp.real(footprints.square // self._shape[1]) * (1.0 / (self._shape[0] - 1))
            n = [
                a + time * (4.0 * b - 3.0 * a - c + time * (2.0 * (a + c) - 4.0 * b))
                for a, b, c in zip(*numbers, strict=True)
            ]
        columns = xp.index(level.columns)
        per_depth = 1.0 / (n[6] * x + n[7] * y + n[8])
        u = (n[0] * x + n[1] * y + n[2] - slide * (n[9] * x + n[10] * y + n[11])) * per_depth
        v = (n[3] * x + n[4] * y + n[5] - slide * (n[12] * x + n[13] * y + n[14])) * per_depth
        # A box with the variance of the footprint, which is a parallelogram.
        wide = xp.sqrt((n[15] - u * n[19]) ** 2 + (n[16] - u * n[20]) ** 2) * per_depth
        high = xp.sqrt((n[17] - v * n[19]) ** 2 + (n[18] - v * n[20]) ** 2) * per_depth
        column, left = _overlap(xp, u, wide, columns)
        row, upper = _overlap(xp, v, high, xp.index(level.rows))
        at = row * columns + column + xp.index(level.begin)
        above = _mixed(xp.take(self._texels, at), xp.take(self._texels, at + 1), left)
        below = _mixed(xp.take(self._texels, at + columns), xp.take(self._texels, at + columns + 1), left)
        return xp.where(per_depth > 0.0, footprints.weight * _mixed(above, below, upper), 0.0)


def map_to_print(view: VirtualView, rig_from_board: FloatArray, texels_from_board: FloatArray) -> PrintMap:
    """Map from a view to the print (3x3 `texels_from_board`) on a board at a rigid 4x4 pose in rig, mm."""
    board_from_rig = rig_from_board[:3, :3].T
    centre = board_from_rig @ (view.centre_in_rig_mm - rig_from_board[:3, 3])
    turn, normal = board_from_rig @ view.turn, board_from_rig @ view.normal_in_rig

    def meets_board(start: FloatArray) -> FloatArray:
        """Rows (2, 3) of which the quotient by `turn[2]` is where the ray from a start meets z = 0."""
        return np.outer(start[:2], turn[2]) - start[2] * turn[:2]

    # Seen from the unprinted side, or looking away: a depth that is never positive.
    depth = turn[2] if centre[2] < 0.0 else np.array([0.0, 0.0, -1.0])
    flat = texels_from_board[:2, :2]
    return PrintMap(
        flat @ meets_board(centre) + np.outer(texels_from_board[:2, 2], turn[2]), depth, flat @ meets_board(normal)
    )


def _scaled(to_print: PrintMap, footprints: _LoadedFootprints, scale: float) -> list[float]:
    """The 21 coefficients of a map to a mipmap level, whose texels are counted from the corner of the border."""
    at = scale * to_print.print + to_print.depth
    parts = (
        at,
        to_print.depth,
        scale * to_print.slide,
        at[:, :2] @ footprints.steps,
        to_print.depth[:2] @ footprints.steps,
    )
    return [float(number) for part in parts for number in part.ravel()]


def _overlap(xp: Arithmetic, middle: Any, width: Any, count: Any) -> tuple[Any, Any]:
    """The first of the two texels that boxes at most one texel wide meet, and the fraction in it."""
    width = xp.minimum(width, 1.0)
    start = xp.maximum(xp.minimum(middle, xp.real(count) - 0.5), 0.5) - 0.5 * width
    first = xp.minimum(xp.truncated(start), count - 2)
    return first, xp.minimum((xp.real(first) + 1.0 - start) / width, 1.0)


def _mixed(first: Any, second: Any, part: Any) -> Any:
    return second + part * (first - second)
