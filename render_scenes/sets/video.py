"""The video of a rendered set, and H.264 compression of a picture. The bytes depend only on the pictures.

Encoding uses one thread, writes no date, and has the settings of a camera's encoder (`zerolatency`: no B-frames, no
lookahead). With B-frames, x264 reads memory that it has not written, and its output differs from run to run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic, read_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.video.animation import X264, file_address, require_x264
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.settings import RenderSettings

_X264 = {"preset": "veryfast", "tune": "zerolatency", "flags": "+bitexact"}
_FULL_RANGE = 2  # AVCOL_RANGE_JPEG: 0 to 255, as in pictures


def write_mjpeg(path: Path, pictures: Iterable[Path], rate_hz: float, on_picture: Callable[[int], None]) -> None:
    """Write an AVI of unchanged JPEG files atomically; `on_picture` is called with the number written so far."""
    with atomic(path) as temporary, _open(temporary) as container:
        stream = None
        for number, picture in enumerate(pictures):
            if stream is None:
                stream = container.add_stream("mjpeg", rate=_rate(rate_hz))
                stream.height, stream.width = read_image(picture).shape[:2]
                stream.pix_fmt = "yuvj420p"
            packet = _av().Packet(read_bytes(picture))
            packet.stream, packet.time_base = stream, 1 / _rate(rate_hz)
            packet.pts = packet.dts = number
            packet.is_keyframe = True
            container.mux(packet)
            on_picture(number + 1)


def write_h264(
    path: Path, pictures: Iterable[Path], rate_hz: float, crf: int, on_picture: Callable[[int], None]
) -> None:
    """Write an MP4 of pictures with even sides, atomically; `crf` is x264's constant rate factor, 0 (lossless) to 51.

    `on_picture` is called with the number of pictures written so far.
    """
    require_x264()
    with atomic(path) as temporary, _open(temporary) as container:
        stream = None
        for number, picture in enumerate(pictures):
            image = read_image(picture)
            if stream is None:
                stream = container.add_stream(X264, rate=_rate(rate_hz), options=_X264 | {"crf": str(crf)})
                _prepare(stream.codec_context, image)
            container.mux(stream.encode(_frame(image, number, _rate(rate_hz))))
            on_picture(number + 1)
        if stream is not None:
            container.mux(stream.encode(None))


def as_key_frame(picture: NDArray[np.uint8], crf: int) -> NDArray[np.uint8]:
    """Compress and decompress a picture with even sides, grey (h, w) or RGB (h, w, 3), as a key frame of H.264."""
    require_x264()
    encoder, decoder = (_av().CodecContext.create(*codec) for codec in ((X264, "w"), ("h264", "r")))
    encoder.options = _X264 | {"crf": str(crf)}
    encoder.framerate = Fraction(30)
    encoder.time_base = Fraction(1, 30)
    _prepare(encoder, picture)
    decoder.thread_count = 1
    packets = [*encoder.encode(_frame(picture, 0, Fraction(30))), *encoder.encode(None)]
    (frame,) = [frame for packet in (*packets, None) for frame in decoder.decode(packet)]
    if picture.ndim == 3:
        colours = frame.reformat(format="rgb24", src_color_range=_FULL_RANGE)
        return np.asarray(colours.to_ndarray(), dtype=np.uint8)
    luma = frame.planes[0]
    rows = np.frombuffer(luma, np.uint8).reshape(luma.height, luma.line_size)
    return np.array(rows[:, : luma.width])


def _av() -> Any:
    import av

    return av


def _open(path: Path) -> Any:
    return _av().open(file_address(path), "w", options={"fflags": "+bitexact"})


def _rate(rate_hz: float) -> Fraction:
    """Return a rate such as 29.97 as a fraction that suits video time bases."""
    return Fraction(rate_hz).limit_denominator(1001)


def _prepare(encoder: Any, image: NDArray[np.uint8]) -> None:
    encoder.height, encoder.width = image.shape[:2]
    encoder.pix_fmt = "yuv420p"
    encoder.color_range = _FULL_RANGE
    encoder.thread_count = 1


def _frame(image: NDArray[np.uint8], number: int, rate: Fraction) -> Any:
    """Convert a picture, grey (h, w) or RGB (h, w, 3), to a frame of an encoder."""
    grey = image if image.ndim == 2 else image[..., 0]
    if image.ndim == 2 or (image == grey[..., None]).all():
        # Exact luma and neutral chroma.
        chroma = np.full((grey.shape[0] // 2, grey.shape[1]), 128, dtype=np.uint8)
        frame = _av().VideoFrame.from_ndarray(np.concatenate([grey, chroma]), format="yuv420p")
    else:
        rgb = _av().VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        frame = rgb.reformat(format="yuv420p", dst_color_range=_FULL_RANGE)
    frame.color_range = _FULL_RANGE
    frame.pts, frame.time_base = number, 1 / rate
    return frame


def check_video(settings: RenderSettings, camera: Camera, rate_hz: float | None) -> None:
    """Raise InputError if the frames do not suit the requested video."""
    video, sensor = settings.video, settings.sensor
    if video is not None and rate_hz is None:
        raise InputError(f"video {video} needs a frame rate, expected a rate_hz")
    if video == "avi" and sensor.jpeg_quality is None:
        raise InputError("video avi needs JPEG pictures, expected a sensor with jpeg_quality")
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
