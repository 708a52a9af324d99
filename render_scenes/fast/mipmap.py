"""The print of a board at several scales, for footprints of several sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray


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
