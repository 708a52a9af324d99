"""Analytic renderer of a board seen via mirrors, for large sets.

The virtual origin of the light of every subpixel is computed once per device (`fast.pixel_footprints`). Each frame
needs a projective map to the print per mirror, computed in float64, and the mean of the print over the footprint of
each subpixel. The footprint is replaced by a box along the axes of the print with the same second moments, and the mean
over it is exact for the 2 x 2 texels that it meets. Light is reflected once, and only mirrors occlude.

Dr.Jit computes arrays of millions of subpixels if a backend compiles, otherwise NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.render_scenes.boards import board_from_texels, printed_radiance
from mirrorcam.render_scenes.fast.pixel_footprints import PixelFootprints, pixel_footprints
from mirrorcam.render_scenes.fast.print_map import (
    MipLevel,
    PrintMap,
    build_mipmap,
    coefficients,
    map_to_print,
    virtual_views,
)
from mirrorcam.render_scenes.lens import defocused
from mirrorcam.render_scenes.mirror_finish import MirrorFinish, uniform_finishes
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.variant import SCALAR, use_variant


class Arithmetic(Protocol):
    """Arithmetic on float32 and uint32; values of `scalars` and `index` may change without recompilation."""

    def load(self, values: NDArray[Any]) -> Any:
        """Convert a NumPy array of float32 or uint32."""

    def scalars(self, values: list[float]) -> list[Any]:
        """Return floats that broadcast to all elements."""

    def index(self, value: int) -> Any:
        """Return an unsigned integer that broadcasts to all elements."""

    def minimum(self, a: Any, b: Any) -> Any: ...

    def maximum(self, a: Any, b: Any) -> Any: ...

    def sqrt(self, a: Any) -> Any: ...

    def where(self, condition: Any, a: Any, b: Any) -> Any: ...

    def truncate(self, a: Any) -> Any:
        """Convert non-negative floats to unsigned integers, rounding down."""

    def to_float(self, a: Any) -> Any:
        """Convert integers to floats."""

    def gather(self, table: Any, index: Any) -> Any:
        """Look up elements of a table of floats."""

    def zeros(self, size: int) -> Any:
        """Return a new array of zeros."""

    def scatter(self, array: Any, index: Any, values: Any) -> None:
        """Write values at distinct indices of an array."""

    def to_numpy(self, array: Any) -> NDArray[np.float32]:
        """Convert an array to NumPy."""


class NumpyArithmetic:
    """NumPy arithmetic, if no backend compiles."""

    def load(self, values: NDArray[Any]) -> Any:
        return values

    def scalars(self, values: list[float]) -> list[Any]:
        return [np.float32(value) for value in values]

    def index(self, value: int) -> Any:
        return np.uint32(value)

    def minimum(self, a: Any, b: Any) -> Any:
        return np.minimum(a, b)

    def maximum(self, a: Any, b: Any) -> Any:
        return np.maximum(a, b)

    def sqrt(self, a: Any) -> Any:
        return np.sqrt(a)

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        return np.where(condition, a, b)

    def truncate(self, a: Any) -> Any:
        return a.astype(np.uint32)

    def to_float(self, a: Any) -> Any:
        return np.float32(a)

    def gather(self, table: Any, index: Any) -> Any:
        return table[index]

    def zeros(self, size: int) -> Any:
        return np.zeros(size, dtype=np.float32)

    def scatter(self, array: Any, index: Any, values: Any) -> None:
        array[index] = values

    def to_numpy(self, array: Any) -> NDArray[np.float32]:
        return np.asarray(array)


class DrJitArithmetic:
    """Dr.Jit arithmetic, in the current variant of Mitsuba."""

    def __init__(self) -> None:
        import drjit
        import mitsuba

        self._dr, self._float, self._uint = drjit, mitsuba.Float, mitsuba.UInt32

    def load(self, values: NDArray[Any]) -> Any:
        array = (self._uint if values.dtype == np.uint32 else self._float)(values)
        self._dr.eval(array)
        return array

    def scalars(self, values: list[float]) -> list[Any]:
        return [self._dr.opaque(self._float, value) for value in values]

    def index(self, value: int) -> Any:
        return self._dr.opaque(self._uint, value)

    def minimum(self, a: Any, b: Any) -> Any:
        return self._dr.minimum(a, b)

    def maximum(self, a: Any, b: Any) -> Any:
        return self._dr.maximum(a, b)

    def sqrt(self, a: Any) -> Any:
        return self._dr.sqrt(a)

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        return self._dr.select(condition, a, b)

    def truncate(self, a: Any) -> Any:
        return self._uint(a)

    def to_float(self, a: Any) -> Any:
        return self._float(a)

    def gather(self, table: Any, index: Any) -> Any:
        return self._dr.gather(self._float, table, index)

    def zeros(self, size: int) -> Any:
        array = self._dr.zeros(self._float, size)
        # A separate buffer, so that kernels do not depend on where it comes from.
        self._dr.make_opaque(array)
        return array

    def scatter(self, array: Any, index: Any, values: Any) -> None:
        self._dr.scatter(array, values, index)

    def to_numpy(self, array: Any) -> NDArray[np.float32]:
        return np.asarray(array.numpy())


SAMPLES = 1024  # footprints of a view, at least, that determine its mipmap level


@dataclass(frozen=True)
class _LoadedFootprints:
    """Footprints as arrays of the arithmetic, and the normalized coordinates `sample` (m, 2) of sample of them.

    `subpixel` is the index in the window of their view, row by row.
    """

    steps: FloatArray
    sample: FloatArray
    subpixel: Any
    x: Any
    y: Any
    centre_shift_mm: Any
    pupil: tuple[Any, Any] | None


@dataclass(frozen=True)
class _ViewWindow:
    """Window (h, w) of the picture around the subpixels of a view.

    `x`, `y` (h, w) are normalized coordinates, `relative_spread` (h, w) is the defocus relative to that of the full
    pupil. All are empty for a pinhole.
    """

    view: int
    slices: tuple[slice, slice]
    footprints: tuple[_LoadedFootprints, ...]
    weight: NDArray[np.float32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    relative_spread: NDArray[np.float32]


class FastScene:
    """A movable board, seen by a camera via flat mirrors or, without mirrors, directly.

    Moving the board needs no compilation. If neither a GPU nor an LLVM compiles, NumPy computes the same.

    Parameters
    ----------
    camera
        The camera, at the origin of the rig frame.
    mirrors
        The mirrors; empty for the bare camera.
    board
        The board.
    settings
        Light, reflectance and subpixels.
    finishes
        Surface finishes; only their reflectance is used. By default the mirrors are uniform.
    variant
        Mitsuba's variant; by default the fastest available.
    """

    def __init__(
        self,
        camera: Camera,
        mirrors: tuple[Mirror, ...],
        board: CalibrationBoard,
        settings: RenderSettings,
        *,
        finishes: Sequence[MirrorFinish] = (),
        variant: str | None = None,
    ) -> None:
        self.variant = use_variant(variant)
        self._xp: Arithmetic = NumpyArithmetic() if self.variant == SCALAR else DrJitArithmetic()
        self._shape = camera.height_px * settings.subpixels, camera.width_px * settings.subpixels
        self._mipmap = build_mipmap(printed_radiance(board, settings))
        self._texels = self._xp.load(self._mipmap.texels)
        self._texels_from_board = np.asarray(np.linalg.inv(board_from_texels(board)), dtype=np.float64)
        self._views = virtual_views(mirrors)
        self._subpixels, self._fx_px = settings.subpixels, camera.fx_px
        self._pupil = settings.sensor.pupil
        reflectances = np.array([finish.luminance for finish in finishes or uniform_finishes(settings, len(mirrors))])
        views = pixel_footprints(camera, mirrors, settings.subpixels, reflectances, self._pupil)
        self._windows = [self._window(parts) for parts in views]
        self.place_board(np.eye(4))

    def place_board(self, *poses: FloatArray) -> None:
        """Move the board to a rigid pose (4, 4), mm, or to three: at the readout of the first, middle and last rows.

        With three poses of a rolling shutter, the map to the print follows a parabola through their maps.
        """
        self._maps = [
            tuple(map_to_print(view, pose, self._texels_from_board, self._pupil) for pose in poses)
            for view in self._views
        ]

    def render(self) -> NDArray[np.float32]:
        """Render the radiance (h * subpixels, w * subpixels), float32, of the full sensor, deterministically."""
        light = np.zeros(self._shape, dtype=np.float32)
        canvases = [self._in_focus(window) for window in self._windows]
        for window, canvas in zip(self._windows, canvases, strict=True):
            radiance = self._xp.to_numpy(canvas).reshape(window.weight.shape)
            if self._pupil.aperture_mm:
                radiance = defocused(radiance, self._defocus_px2(window), self._subpixels)
            cv2.accumulateProduct(window.weight, np.ascontiguousarray(radiance), light[window.slices])
        return light

    def _in_focus(self, window: _ViewWindow) -> Any:
        """Return the radiance of a view in focus, as an array of the arithmetic."""
        maps = self._maps[window.view]
        canvas = self._xp.zeros(window.weight.size)
        for footprints in window.footprints:
            index = self._level(maps[len(maps) // 2], footprints)
            scalars = [self._xp.scalars(coefficients(to_print, footprints.steps, 0.5**index)) for to_print in maps]
            radiance = self._radiance(footprints, self._mipmap.levels[index], scalars, self._time(window, footprints))
            self._xp.scatter(canvas, footprints.subpixel, radiance)
        return canvas

    def _time(self, window: _ViewWindow, footprints: _LoadedFootprints) -> Any:
        """Return the readout times of the footprints' rows, 0 to 1."""
        rows, width = window.slices[0], window.weight.shape[1]
        row = self._xp.to_float(footprints.subpixel // self._xp.index(width)) + self._xp.scalars([float(rows.start)])[0]
        # Subpixel row r of k per pixel is at row (r + 1/2) / k - 1/2; the first and the last row are read at 0 and 1.
        return (row - 0.5 * (self._subpixels - 1)) * (1.0 / (self._shape[0] - self._subpixels))

    def _defocus_px2(self, window: _ViewWindow) -> NDArray[np.float32]:
        """Return the defocus variance (h, w), px^2, of a view: d^2 / 16 for a circle of confusion of diameter d."""
        maps = self._maps[window.view]
        in_focus = np.array([0.0, 0.0, 1.0 / self._pupil.focus_mm])
        coefficients_px = self._fx_px * self._pupil.aperture_mm / 4.0 * (in_focus - maps[len(maps) // 2].inverse_depth)
        a, b, c = coefficients_px.astype(np.float32)
        sigma_px = a * window.x
        sigma_px += b * window.y
        sigma_px += c
        sigma_px *= window.relative_spread
        sigma_px *= sigma_px
        return sigma_px

    def _window(self, parts: Sequence[PixelFootprints]) -> _ViewWindow:
        """Return the window around the footprints of a view."""
        row, column = np.divmod(np.concatenate([part.subpixel for part in parts]).astype(np.int64), self._shape[1])
        top, left = int(row.min()), int(column.min())
        shape = int(row.max()) + 1 - top, int(column.max()) + 1 - left
        subpixel = (row - top) * shape[1] + column - left

        def image_of(name: str) -> NDArray[np.float32]:
            values = np.zeros(shape, dtype=np.float32)
            values.ravel()[subpixel] = np.concatenate([getattr(part, name) for part in parts])
            return values

        ends = np.cumsum([len(part.subpixel) for part in parts])[:-1]
        blurred = bool(self._pupil.aperture_mm)
        empty = np.zeros((0, 0), dtype=np.float32)
        return _ViewWindow(
            view=parts[0].view,
            slices=(slice(top, top + shape[0]), slice(left, left + shape[1])),
            footprints=tuple(
                self._loaded(part, index.astype(np.uint32))
                for part, index in zip(parts, np.split(subpixel, ends), strict=True)
            ),
            weight=image_of("weight"),
            x=image_of("x") if blurred else empty,
            y=image_of("y") if blurred else empty,
            relative_spread=image_of("relative_spread") if blurred else empty,
        )

    def _loaded(self, footprints: PixelFootprints, subpixel: NDArray[np.uint32]) -> _LoadedFootprints:
        sample = slice(None, None, max(len(subpixel) // SAMPLES, 1))
        pupil = footprints.pupil_x, footprints.pupil_y
        load = self._xp.load
        return _LoadedFootprints(
            steps=footprints.steps,
            sample=np.column_stack([footprints.x, footprints.y])[sample].astype(np.float64),
            subpixel=load(subpixel),
            x=load(footprints.x),
            y=load(footprints.y),
            centre_shift_mm=load(footprints.centre_shift_mm),
            pupil=(load(pupil[0]), load(pupil[1])) if np.any(pupil) else None,
        )

    def _level(self, to_print: PrintMap, footprints: _LoadedFootprints) -> int:
        """Return the finest level whose texels are at least as wide as the sampled footprints on the print."""
        rays = np.column_stack([footprints.sample, np.ones(len(footprints.sample))])
        rays = rays[rays @ to_print.depth > 0.0]
        depth = (rays @ to_print.depth)[:, None]
        texels = rays @ to_print.print.T / depth
        finest = self._mipmap.levels[0]
        on_print = ((texels > 0.0) & (texels < np.array([finest.columns, finest.rows]))).all(axis=1)
        texels, depth = texels[on_print], depth[on_print]
        sides = to_print.print[:, :2] @ footprints.steps - texels[:, :, None] * (to_print.depth[:2] @ footprints.steps)
        widest = (np.linalg.norm(sides, axis=-1) / depth).max(initial=1.0)
        return int(min(np.ceil(np.log2(widest)), len(self._mipmap.levels) - 1))

    def _radiance(self, footprints: _LoadedFootprints, level: MipLevel, scalars: list[list[Any]], time: Any) -> Any:
        """Return the mean radiance of the print over footprints, at readout times 0 to 1 of a rolling shutter."""
        xp, x, y, shift_mm = self._xp, footprints.x, footprints.y, footprints.centre_shift_mm
        n = scalars[0]
        if len(scalars) == 3:
            n = [
                a + time * (4.0 * b - 3.0 * a - c + time * (2.0 * (a + c) - 4.0 * b))
                for a, b, c in zip(*scalars, strict=True)
            ]
        columns = xp.index(level.columns)
        depth = n[6] * x + n[7] * y + n[8]
        u = n[0] * x + n[1] * y + n[2] - shift_mm * (n[9] * x + n[10] * y + n[11])
        v = n[3] * x + n[4] * y + n[5] - shift_mm * (n[12] * x + n[13] * y + n[14])
        if footprints.pupil is not None:
            for first, a in ((21, footprints.pupil[0]), (27, footprints.pupil[1])):
                u += a * (n[first] * x + n[first + 1] * y + n[first + 2])
                v += a * (n[first + 3] * x + n[first + 4] * y + n[first + 5])
            depth += footprints.pupil[0] * n[33] + footprints.pupil[1] * n[34]
        inverse_depth = 1.0 / depth
        u, v = u * inverse_depth, v * inverse_depth
        # A box with the variance of the footprint, which is a parallelogram.
        width = xp.sqrt((n[15] - u * n[19]) ** 2 + (n[16] - u * n[20]) ** 2) * inverse_depth
        height = xp.sqrt((n[17] - v * n[19]) ** 2 + (n[18] - v * n[20]) ** 2) * inverse_depth
        column, left = _overlap(xp, u, width, columns)
        row, upper = _overlap(xp, v, height, xp.index(level.rows))
        index = row * columns + column + xp.index(level.begin)
        above = _mix(xp.gather(self._texels, index), xp.gather(self._texels, index + 1), left)
        below = _mix(xp.gather(self._texels, index + columns), xp.gather(self._texels, index + columns + 1), left)
        return xp.where(inverse_depth > 0.0, _mix(above, below, upper), 0.0)


def _overlap(xp: Arithmetic, centre: Any, width: Any, count: Any) -> tuple[Any, Any]:
    """Return the first of the two texels that each box overlaps, clipped to one texel, and its fraction in it."""
    width = xp.minimum(width, 1.0)
    start = xp.maximum(xp.minimum(centre, xp.to_float(count) - 0.5), 0.5) - 0.5 * width
    first = xp.minimum(xp.truncate(start), count - 2)
    return first, xp.minimum((xp.to_float(first) + 1.0 - start) / width, 1.0)


def _mix(first: Any, second: Any, fraction: Any) -> Any:
    return second + fraction * (first - second)
