"""Overview of a tabletop set: the frame, the true central view and its inverse depth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopSet, read_map

HEIGHT_PX = 480
GAP_PX = 10


def overview(folder: Path) -> NDArray[np.uint8]:
    """Draw the overview of a tabletop set.

    Parameters
    ----------
    folder
        Folder of the set.

    Returns
    -------
    array (h, w, 3)
        The frame at the left; at the right the true central view above its inverse depth, red where near. Frame and
        view are gamma-encoded, since their files hold linear values.

    Raises
    ------
    InputError
        If a file of the set is missing or cannot be read.
    """
    manifest = TabletopSet.load(folder)
    t, s = manifest.central_view
    frame, view = (
        _for_screens(read_image(folder / name)) for name in (manifest.frame_name, f"truth/views/{t}_{s}.png")
    )
    nearness = 1.0 / read_map(folder / f"truth/depth/{t}_{s}.exr", "depth")
    low, high = float(nearness.min()), float(nearness.max())
    grey = np.rint(255.0 * (nearness - low) / max(high - low, 1e-12)).astype(np.uint8)
    near = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_TURBO))[..., ::-1]
    height, width = (HEIGHT_PX - GAP_PX) // 2, round((HEIGHT_PX - GAP_PX) / 2 * view.shape[1] / view.shape[0])
    small = [np.asarray(cv2.resize(image, (width, height))) for image in (view, near)]
    wide = round(HEIGHT_PX * frame.shape[1] / frame.shape[0])
    large = np.asarray(cv2.resize(frame, (wide, HEIGHT_PX), interpolation=cv2.INTER_AREA))
    picture = np.full((HEIGHT_PX, wide + GAP_PX + width, 3), 255, dtype=np.uint8)
    picture[:, :wide], picture[:height, wide + GAP_PX :], picture[-height:, wide + GAP_PX :] = large, *small
    return picture


def _for_screens(linear: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.rint(255.0 * (linear / 255.0) ** (1.0 / 2.2)).astype(np.uint8)
