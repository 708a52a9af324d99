"""Recordings of a wall with noise, for what depends on the frames before."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.video.frames import Frame
from mirrorcam.optics.light_field.io.recording import Recording, about
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph


def noisy_walls(count: int, seed: int = 0) -> list[LightField]:
    """Frames of a wall that stays, with noise of 3 grey levels."""
    wall, random = photograph(grid_views(), [Surface(520.0)])[0], np.random.default_rng(seed)
    noisy = [np.rint(wall.samples + 3.0 * random.normal(size=wall.samples.shape)) for _ in range(count)]
    return [LightField.of(wall, np.clip(each, 0, 255).astype(np.uint8), wall.weights) for each in noisy]


def write_recording(path: Path, frames: list[LightField]) -> None:
    """Write frames as a recording in Zarr, 30 a second."""
    recording = Recording(path, about(frames[0], {"sha256": "feed"}), ZarrSink())
    for number, each in enumerate(frames):
        recording.add(Frame(number, number / 30.0, np.zeros((2, 2, 3), np.uint8)), each)
    recording.finish()
    recording.close()
