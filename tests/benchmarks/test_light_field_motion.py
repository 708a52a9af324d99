"""Frames of a mirror camera that moves, decoded and tracked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.light_field_motion import error, film_by_mirrors, track
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

LAYOUT = Path("tests/data/fold_90_layout.json")


@pytest.mark.slow
def test_the_mirror_cameras_own_frames_tell_how_it_moved() -> None:
    layout = Layout.load(LAYOUT)
    small = layout.replaced(camera=layout.camera.binned(0.5))
    path = [rigid(np.eye(3), [6.0 * number, -3.0 * number, 4.0 * number]) for number in range(3)]
    filmed = film_by_mirrors("walk", path, small, seed=0, noise_grey=1.5)
    poses, _ = track(filmed)
    for pose, true in zip(poses, filmed.poses, strict=True):
        off = error(pose.world_from_view, true)
        assert np.linalg.norm(off[:3]) < 0.3
        assert np.linalg.norm(off[3:]) < np.radians(0.05)
