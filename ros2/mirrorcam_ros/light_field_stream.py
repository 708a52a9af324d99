"""The messages of a camera, frame by frame; this module does not need ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.core.video.camera_addresses import open_camera
from mirrorcam.core.video.frames import Lost
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth
from mirrorcam.optics.light_field.io.ros_messages import Published, frame_messages, latched_messages, stamp_ns
from mirrorcam.optics.light_field.io.stream import light_fields
from mirrorcam.optics.light_field.light_field import LightField


@dataclass(frozen=True)
class Settings:
    """Settings of the node; 0 stands for the default of the library.

    Parameters
    ----------
    layout
        `layout.json` of `mirrorcam calibrate`.
    device
        Number or address of the camera, as `mirrorcam decode --live` takes it.
    depth
        Whether depth is measured.
    near_mm, far_mm
        Depth range that is searched.
    width_px
        Width of every view.
    reference_depth_mm
        Depth of zero disparity.
    """

    layout: Path
    device: str = "0"
    depth: bool = True
    near_mm: float = 0.0
    far_mm: float = 0.0
    width_px: int = 0
    reference_depth_mm: float = 0.0


class LightFieldStream:
    """Decodes a camera's frames; raises InputError if settings, layout or camera do not allow that.

    `on_note` gets a line when the camera disconnects and when it is back.
    """

    def __init__(self, settings: Settings, on_note: Callable[[str], None]) -> None:
        layout = Layout.load(settings.layout)
        self._decoder = Decoder(
            layout,
            width_px=settings.width_px or None,
            reference_depth_mm=settings.reference_depth_mm or None,
        )
        samples = np.zeros((*self._decoder.weights.shape, 3), np.uint8)
        self._empty = LightField.of(self._decoder.views, samples, self._decoder.weights)
        self._depth: VideoDepth | None = None
        if settings.depth:
            near_mm, far_mm = settings.near_mm or None, settings.far_mm or None
            estimator = DepthEstimator(self._empty, near_mm=near_mm, far_mm=far_mm, quality="fast")
            self._depth = VideoDepth(estimator)
        # Robots act on the newest frame: none waits while another is decoded.
        size_px = layout.camera.width_px, layout.camera.height_px
        self._camera = open_camera(settings.device, *size_px, on_note, buffered=1)
        self._start_ns = self._camera.started_ns or time.time_ns()

    @property
    def dropped(self) -> int:
        """Number of frames that came faster than they were decoded."""
        return self._camera.dropped

    def stop(self) -> None:
        """End `frames`, also while it waits for the camera."""
        self._camera.stop()

    def latched(self) -> list[Published]:
        """The messages that are published once."""
        return list(latched_messages(self._empty, self._start_ns))

    def topics(self) -> list[Published]:
        """A message for every topic that frames are published on."""
        return list(frame_messages(self._empty, self._start_ns, None if self._depth is None else self._unknown()))

    def _unknown(self) -> DepthMap:
        """A depth map without any depth."""
        view = np.argwhere((self._empty.positions_mm == 0).all(axis=2))[0]
        unknown = np.full((self._empty.height_px, self._empty.width_px), np.nan, np.float32)
        return DepthMap(
            views=self._empty,
            view=(int(view[0]), int(view[1])),
            depth_mm=unknown,
            sigma_mm=unknown,
            confidence=np.zeros_like(unknown),
        )

    def frames(self, wants_depth: Callable[[], bool]) -> Generator[list[Published] | Lost]:
        """The messages of each frame, or why it is lost; depth is measured while there are subscribers.

        A recording, from a server or a file, is played in real time.
        """
        for item in light_fields(self._decoder, self._camera, ahead=0):
            if isinstance(item, Lost):
                yield item
                continue
            frame, light_field = item
            stamp = stamp_ns(frame.time_s, self._start_ns)
            if self._camera.ends:
                time.sleep(max(0.0, (stamp - time.time_ns()) / 1e9))
            depth = self._depth.estimate(light_field) if self._depth is not None and wants_depth() else None
            yield list(frame_messages(light_field, stamp, depth))
