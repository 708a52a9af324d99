"""The pixels of each sub-image, well inside its edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.geometry.layout import Layout

MARGIN_PX = 24
"""Inside an outline: beyond the blur of the edge of a mirror, and as far as it may be off its place."""


@dataclass(frozen=True, eq=False)
class SubImage:
    """Window (rows, columns) of a frame, and which of its pixels (h, w) belong to the sub-image, 255 or 0."""

    window: tuple[slice, slice]
    mask: NDArray[np.uint8]

    @property
    def pixels(self) -> int:
        """Number of its pixels."""
        return int(np.count_nonzero(self.mask))


def sub_image_masks(layout: Layout, margin_px: int = MARGIN_PX) -> list[SubImage | None]:
    """The pixels of each mirror's sub-image on the sensor, without a margin; None of one that shows nothing."""
    camera = layout.camera
    found: list[SubImage | None] = []
    for k in range(len(layout.mirrors)):
        outline = layout.outline_px(k, usable=True)
        outline = outline[np.isfinite(outline).all(axis=1)]
        filled: Any = np.zeros((camera.height_px, camera.width_px), np.uint8)
        cv2.fillConvexPoly(filled, np.rint(np.clip(outline, -1e4, 1e4)).astype(np.int32), [255])
        kernel = np.ones((2 * margin_px + 1,) * 2, np.uint8)
        filled = cv2.erode(filled, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=[255])
        rows, columns = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
        if not len(rows):
            found.append(None)
            continue
        window = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        found.append(SubImage(window, np.ascontiguousarray(filled[window])))
    return found
