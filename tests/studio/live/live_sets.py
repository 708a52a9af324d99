"""A small layout, its video and pictures, for tests of live sessions."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from tests.core.video.videos import write_mjpeg
from tests.optics.light_field.photographs import photographed, waves

WIDTH_PX, HEIGHT_PX = 480, 270


def small(layout: Layout) -> Layout:
    """The layout before a sensor of a quarter of its size, of a pinhole."""
    full = layout.camera
    camera = Camera(
        name="small",
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        fx_px=full.fx_px / 4.0,
        fy_px=full.fy_px / 4.0,
        cx_px=(full.cx_px + 0.5) / 4.0 - 0.5,
        cy_px=(full.cy_px + 0.5) / 4.0 - 0.5,
    )
    return layout.replaced(camera=camera)


def frame(layout: Layout, depth_mm: float = 400.0, shift_mm: float = 0.0) -> NDArray[np.uint8]:
    """What the camera sees of a texture at a depth."""
    shown = photographed(layout, depth_mm, lambda x, y: waves(x + shift_mm, y))
    return np.asarray(np.round(shown * 220.0), np.uint8)


def write_live_set(folder: Path, layout: Layout, frames: int = 12) -> tuple[Path, Path]:
    """layout.json of the small layout, and a video of a texture that moves."""
    device = small(layout)
    device.save(folder / "layout.json")
    shown = [frame(device, shift_mm=1.5 * number) for number in range(frames)]
    return folder / "layout.json", write_mjpeg(folder / "video.avi", shown)


def repeated(path: Path, to: Path, times: int) -> None:
    """A video of JPEG pictures that shows the same frames again and again."""
    with av.open(str(path)) as given:
        packets = [bytes(packet) for packet in given.demux(video=0) if packet.size]
        size = given.streams.video[0].codec_context
        with av.open(str(to), "w") as made:
            stream: Any = made.add_stream("mjpeg", rate=25)
            stream.width, stream.height, stream.pix_fmt = size.width, size.height, "yuvj420p"
            for number in range(times * len(packets)):
                packet: Any = av.Packet(packets[number % len(packets)])
                packet.stream, packet.time_base = stream, Fraction(1, 25)
                packet.pts = packet.dts = number
                packet.is_keyframe = True
                made.mux(packet)
