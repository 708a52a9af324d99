"""A live session in its own process: converts frames to pictures for a page."""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.live_camera import LiveCamera
from mirrorcam.core.video.newest_frame import ArrivedFrame, NewestFrame
from mirrorcam.optics.alignment.meters import FocusMeter, measure_exposure, sharpness, sub_image_masks
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth.estimate import DEFAULT_FAR, DEFAULT_NEAR
from mirrorcam.optics.light_field.io.view_images import tiled_views
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus, to_bytes
from mirrorcam.studio.live.streams import LiveRecording, open_source
from mirrorcam.studio.live.values import Answer, FrameResults, LiveRequest, Orders, PictureKind, SessionAbout

JPEG_QUALITY = 82
METER_S = 0.2
"""Time between measurements of focus and exposure."""
RECENT_FRAMES, RECENT_STEP_S = 6, 0.5
"""Number of frames kept for the alignment, and time between them."""


class LiveSession:
    """Decodes the newest frames of a source into pictures; a finite source waits for an order.

    Raises InputError if the layout or the source cannot be opened, or the views have no common field.
    """

    def __init__(self, request: LiveRequest) -> None:
        cv2.setNumThreads(1)
        self.layout = Layout.load(request.layout)
        camera = self.layout.camera
        self._lines: deque[str] = deque(maxlen=100)
        self._decoder = Decoder(self.layout, width_px=request.view_width_px)
        self._small = Decoder(self.layout, width_px=request.depth_width_px)
        blank = self._decoder.decode(np.zeros((camera.height_px, camera.width_px, 3), np.uint8))
        height, width, _ = tiled_views(blank).shape
        self._views_px = (width, height)
        scale = request.frame_width_px / camera.width_px
        self._frame_px = (request.frame_width_px, round(camera.height_px * scale))
        self._masks = sub_image_masks(self.layout)
        self._meter, self._measured_s = FocusMeter(len(self._masks)), -np.inf
        self._recent: deque[NDArray[np.uint8]] = deque(maxlen=RECENT_FRAMES)
        self._recent_s = -np.inf
        self._recording = LiveRecording(camera, self._lines.append)
        self.opened = open_source(request.source, camera, self._lines.append)
        self._every, self._plays = request.every_frame, 0
        self._newest: NewestFrame | None = None
        self._dropped = self._lost = 0
        self._last: ArrivedFrame | None = None
        self._made: dict[PictureKind, float | None] = {}
        if not self.opened.ends:
            self._read()

    def about(self) -> SessionAbout:
        """Properties of the session."""
        views, small = self._decoder.views, self._small.views
        sizes: dict[PictureKind, tuple[int, int]] = {
            "frame": self._frame_px,
            "views": self._views_px,
            "refocus": (views.width_px, views.height_px),
            "depth": (small.width_px, small.height_px),
        }
        camera, reference = self.layout.camera, views.reference_depth_mm
        min_focus_mm = views.reference_view_depth_mm + max(float(views.positions_mm[..., 2].max()), 0.0)
        return SessionAbout(
            source=self.opened.name,
            kind=self.opened.kind,
            layout_kind=self.layout.kind,
            camera_px=(camera.width_px, camera.height_px),
            sizes_px=sizes,
            grid=(views.rows, views.cols),
            reference_mm=reference,
            near_mm=DEFAULT_NEAR * reference,
            far_mm=DEFAULT_FAR * reference,
            least_focus_mm=min_focus_mm,
        )

    def next(self, orders: Orders) -> Answer:
        """Return the ordered pictures of the next frame. Raises InputError as the source does."""
        if orders.reset_focus:
            self._meter.reset()
        self._recording.order(orders.record)
        if orders.plays > self._plays and self.opened.ends:
            self._plays = orders.plays
            if self._newest is None or self._newest.ended:
                self._read()
        arrived = None if self._newest is None else self._newest.take(orders.timeout_s)
        ended = self._newest is not None and self._newest.ended
        results = None
        if arrived is not None:
            self._last, self._made = arrived, {}
            results = self._results(arrived, orders)
        elif ended and self._last is not None:
            results = self._reordered(self._last, orders)
        counts = self._recording.counts
        source = self.opened.source
        live = source if isinstance(source, LiveCamera) else None
        return Answer(
            results,
            ended=ended,
            dropped=self._dropped
            + (0 if self._newest is None else self._newest.dropped)
            + (0 if live is None else live.dropped),
            lost=self._lost + (0 if self._newest is None else self._newest.lost),
            outages=0 if live is None else live.outages,
            recorded=counts.recorded,
            not_recorded=counts.lost,
            memory_mb=resident_mb(),
            lines=self._messages(),
        )

    def close(self) -> tuple[str, ...]:
        """Finish the recording, release the source, and return the last messages."""
        self._recording.order(None)
        if self._newest is None:
            self.opened.source.stop()
        else:
            self._newest.stop()
        self._recording.close()
        return self._messages()

    def _read(self) -> None:
        """Read the source; a finite one from its start."""
        if self._newest is not None:
            self._dropped += self._newest.dropped
            self._lost += self._newest.lost
        self._newest = NewestFrame(
            self.opened.source,
            paced=self.opened.ends and not self._every,
            keep_all=self._every,
            on_arrival=self._recording.give,
        )

    def _reordered(self, last: ArrivedFrame, orders: Orders) -> FrameResults | None:
        """Return newly ordered results of the last frame: other kinds, another focus, or depth."""
        kinds = tuple(
            kind
            for kind in orders.kinds
            if kind not in self._made or (kind == "refocus" and self._made[kind] != orders.focus_mm)
        )
        depth = orders.depth and "depth" not in self._made
        if not kinds and not depth:
            return None
        remaining = replace(orders, kinds=kinds, depth=depth, frames=False, take=None)
        return replace(self._results(replace(last, arrived_s=time.monotonic()), remaining), repeated=True)

    def _results(self, arrived: ArrivedFrame, orders: Orders) -> FrameResults:
        frame, jpegs = arrived.frame, dict[PictureKind, bytes]()
        if "frame" in orders.kinds:
            jpegs["frame"] = _jpeg(cv2.resize(frame.pixels, self._frame_px, interpolation=cv2.INTER_AREA))
        if "views" in orders.kinds or "refocus" in orders.kinds:
            light_field = self._decoder.decode(frame.pixels)
            if "views" in orders.kinds:
                jpegs["views"] = _jpeg(tiled_views(light_field))
            if "refocus" in orders.kinds:
                depth = light_field.reference_depth_mm if orders.focus_mm is None else orders.focus_mm
                jpegs["refocus"] = _jpeg(to_bytes(refocus(light_field, FocalPlane.at_depth(light_field, depth))))
        done = time.monotonic()
        self._made |= dict.fromkeys(jpegs, orders.focus_mm) | ({"depth": None} if orders.depth else {})
        samples = self._small.decode(frame.pixels).samples if orders.depth else None
        measured = done - self._measured_s >= METER_S
        grey: Any = cv2.cvtColor(frame.pixels, cv2.COLOR_RGB2GRAY) if measured or orders.frames else None
        sharp, exposure = None, None
        if measured:
            self._measured_s = done
            sharp = tuple(self._meter.measure(sharpness(grey, self._masks)).tolist())
            exposure = measure_exposure(frame.pixels, self._masks)
        if grey is not None and done - self._recent_s >= RECENT_STEP_S:
            self._recent_s = done
            self._recent.append(grey)
        return FrameResults(
            number=frame.number,
            time_s=frame.time_s,
            arrived_s=arrived.arrived_s,
            done_s=done,
            jpegs=jpegs,
            sharpness=sharp,
            exposure=exposure,
            samples=None if samples is None else np.asarray(samples, np.uint8),
            frames=tuple(self._recent) if orders.frames else (),
            taken=self._save_picture(frame, orders.take),
        )

    def _save_picture(self, frame: Frame, path: Path | None) -> Path | None:
        if path is None:
            return None
        if path.exists():
            raise InputError(f"{path}: exists, expected a new name")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image(path, frame.pixels)
        return path

    def _messages(self) -> tuple[str, ...]:
        lines = tuple(self._lines)
        self._lines.clear()
        return lines


def _jpeg(picture: Any) -> bytes:
    """Encode an RGB picture (h, w, 3) as JPEG."""
    encoded: bytes = simplejpeg.encode_jpeg(np.ascontiguousarray(picture), JPEG_QUALITY, colorsubsampling="420")
    return encoded


def resident_mb() -> float:
    """Return the resident memory of this process, MB; NaN except on Linux."""
    if sys.platform != "linux":
        return float("nan")
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
