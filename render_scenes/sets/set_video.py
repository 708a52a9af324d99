"""The video of a rendered set: whether its frames can be encoded, and its file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.sets.video import write_h264, write_mjpeg
from mirrorcam.render_scenes.settings import RenderSettings


def check_video(settings: RenderSettings, camera: Camera, rate_hz: float | None) -> None:
    """Raise InputError where the frames cannot be put into the video that is asked for."""
    video, sensor = settings.video, settings.sensor
    if video is not None and rate_hz is None:
        raise InputError(f"video {video}: its frames are moments of a motion, expected a rate_hz")
    if video == "avi" and sensor.jpeg_quality is None:
        raise InputError("video avi: holds the JPEG files of a sensor, expected one with jpeg_quality")
    if (video == "mp4" or sensor.h264_crf is not None) and (camera.width_px % 2 or camera.height_px % 2):
        size = f"{camera.width_px} x {camera.height_px}"
        raise InputError(f"H.264: a sensor of {size} pixels, expected even numbers of columns and rows")


def write_video(path: Path, out: Path, dataset: Dataset, on_picture: Callable[[int], None]) -> None:
    """Write the video of the set in a folder; `on_picture` is called with the number of pictures written so far."""
    assert dataset.rate_hz is not None
    pictures = [out / name for name in dataset.frame_names]
    settings = dataset.settings
    if settings.video == "avi":
        write_mjpeg(path, pictures, dataset.rate_hz, on_picture)
    else:
        crf = settings.video_crf if settings.sensor.h264_crf is None else settings.sensor.h264_crf
        write_h264(path, pictures, dataset.rate_hz, crf, on_picture)
