"""The sheet that a board is printed on: its picture, and where it lies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.targets import DICTIONARIES, Charuco, Checkerboard, Target
from mirrorcam.render_scenes.settings import RenderSettings

MARGIN_SQUARES = 1  # of white paper around the printed squares
_MOST_TEXELS_PER_SQUARE = 64


def print_on_paper(target: Target) -> NDArray[np.uint8]:
    """The sheet, as coarse as its edges allow: the print with its margin of white paper, 0 ink and 255 paper.

    One texel a square is exact for a checkerboard. With markers, one texel a marker module is exact where a square is a
    whole number of modules; otherwise markers (never squares) are drawn at the nearest size that falls on texels.
    """
    if isinstance(target, Checkerboard):
        return np.pad(target.image(1), MARGIN_SQUARES, constant_values=255)
    texels, marker_mm = _marker_raster(target)
    image = target.replaced(marker_mm=marker_mm).image(texels)
    return np.pad(image, MARGIN_SQUARES * texels, constant_values=255)


def _marker_raster(target: Charuco) -> tuple[int, float]:
    """Texels a square, and the marker_mm nearest to the target's whose modules are then whole numbers of texels."""
    modules = DICTIONARIES[target.dictionary][1]
    choices = [
        (texels, texels_per_module * modules * target.square_mm / texels)
        for texels in range(modules + 1, _MOST_TEXELS_PER_SQUARE + 1)
        for texels_per_module in range(1, (texels - 1) // modules + 1)
        if (texels - texels_per_module * modules) % 2 == 0  # else the marker would not be centred
    ]
    return min(choices, key=lambda choice: (round(abs(choice[1] - target.marker_mm), 9), choice[0]))


def printed_radiance(target: Target, settings: RenderSettings) -> FloatArray:
    """How bright the sheet (rows, columns) is, texel by texel."""
    return np.asarray(settings.ink + (settings.paper - settings.ink) * (print_on_paper(target) / 255.0))


def board_from_texels(target: Target) -> FloatArray:
    """The 3x3 from (column, row, 1) on the sheet, in texels from its top left corner, to x, y, 1 on the board, mm."""
    texel_mm = target.size_mm[0] / (print_on_paper(target).shape[1] // (target.cols + 2 * MARGIN_SQUARES)) / target.cols
    margin_mm = MARGIN_SQUARES * target.square_mm
    return np.array([[texel_mm, 0.0, -margin_mm], [0.0, texel_mm, -margin_mm], [0.0, 0.0, 1.0]])


def rig_from_rectangle(target: Target, rig_from_board: FloatArray) -> FloatArray:
    """The 4x4 that lays Mitsuba's rectangle ([-1, 1]^2, shining along +z, v up) on the sheet, printed side out."""
    width, height = target.size_mm
    margin = MARGIN_SQUARES * target.square_mm
    board_from_sheet = np.diag([width / 2 + margin, -(height / 2 + margin), -1.0, 1.0])
    board_from_sheet[:2, 3] = width / 2, height / 2
    return rig_from_board @ board_from_sheet
