"""nerfstudio's frames: its pixels, its metres, and cameras that look along their own -z."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.nerfstudio_frames import WORLD_FROM_VIEW, frame
from mirrorcam.optics.geometry.transforms import rigid


def test_a_view_looks_along_the_worlds_y_and_has_its_z_up() -> None:
    made = frame("a", (64, 48), (50.0, 51.0), (31.5, 23.5), rigid(WORLD_FROM_VIEW, [100.0, 0.0, 0.0]), {"k1": 0.0})
    transform = np.array(made["transform_matrix"])
    assert np.array_equal(transform[:3, :3] @ [0.0, 0.0, -1.0], [0.0, 1.0, 0.0])
    assert np.array_equal(transform[:3, :3] @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    assert np.array_equal(transform[:3, 3], [0.1, 0.0, 0.0])
    assert np.linalg.det(transform[:3, :3]) == 1.0
    # The middle of a picture of 64x48 px is at (32, 24) where corners are counted.
    assert (made["cx"], made["cy"], made["w"], made["h"]) == (32.0, 24.0, 64, 48)
    assert (made["file_path"], made["mask_path"], made["k1"]) == ("images/a.png", "masks/a.png", 0.0)
