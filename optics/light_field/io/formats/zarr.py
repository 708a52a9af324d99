"""Recordings in Zarr, as `mirrorcam decode` makes them from videos: read frame by frame, written with one frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.light_field_format import Contents, Format, depthless_writer
from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields, ZarrSink
from mirrorcam.optics.light_field.light_field import LightField


def is_recording(path: Path) -> bool:
    """Return whether a path is a folder of Zarr, or of an interrupted recording."""
    return path.is_dir() and ((path / "zarr.json").exists() or path.name.endswith((".zarr", ".zarr.partial")))


def write_recording(path: Path, light_field: LightField) -> None:
    """Write one light field as a recording with one frame."""
    from mirrorcam.core.video.frames import Frame
    from mirrorcam.optics.light_field.io.recording import Recording, about

    recording = Recording(path, about(light_field, {"file": path.stem}), ZarrSink())
    if recording.is_complete:
        raise InputError(f"{path}: exists, expected a new name")
    recording.add(Frame(0, 0.0, np.empty((0, 0, 3), np.uint8)), light_field)
    recording.finish()


def _contents(stored: StoredLightFields) -> Contents:
    return Contents(stored, is_recording=True, times_s=stored.times_s)


FORMAT = Format(
    name="zarr",
    ending=".zarr",
    detect=is_recording,
    read=lambda path, assumed: _contents(StoredLightFields(path)),
    write=depthless_writer(write_recording),
)
