"""Decode a video or the stream of a camera into a ROS 2 bag."""

from __future__ import annotations

import glob
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import Any

from mirrorcam import Decoder, LightField
from mirrorcam.core.console.reporter import Reporter
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.video.frames import Frame, Lost, WatchedSource
from mirrorcam.core.video.live_camera import LiveCamera
from mirrorcam.core.video.stream_losses import Stream, expected_frames, losses, sources_text
from mirrorcam.core.video.video import Video
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth
from mirrorcam.optics.light_field.io.bag_writer import BagWriter
from mirrorcam.optics.light_field.io.recording import NothingDecoded
from mirrorcam.optics.light_field.io.ros_messages import frame_messages, latched_messages, stamp_ns
from mirrorcam.optics.light_field.io.stream import RecordingCheck, decoded_ahead

ShowDepth = Callable[[float, LightField, DepthMap | None], None]
"""Shows a decoded frame, given its time in s, its light field, and its depth, if estimated."""


def refuse_bag(name: str, output: OutputFolder, check: RecordingCheck | None) -> None:
    """Raise InputError if NAME.mcap exists, as recordings are never replaced, or if rosbags is not installed."""
    require("robot")
    path = output.path / f"{name}.mcap"
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists, and recordings are never replaced; expected another --out")
    if check is not None:
        output.refuse_others(f"{glob.escape(name)}_{check.file}")


@dataclass(frozen=True)
class BagRecorder:
    """Decodes up to `limit` frames of a stream into a ROS 2 bag in a folder, with depth if there is an estimator."""

    decoder: Decoder
    output: OutputFolder
    estimator: DepthEstimator | None
    limit: int | None
    reporter: Reporter
    check: RecordingCheck | None = None
    show: ShowDepth | None = None

    def record(self, source: Stream, name: str, origin: dict[str, Any]) -> int:
        """Decode a stream into NAME.mcap; Ctrl-C keeps the decoded frames of a camera, and none of a video.

        Returns the number of lost frames. Raises InputError if the stream has no usable frame, or nothing can be
        written.
        """
        expected, lost = expected_frames(source, self.limit), dict[int, str]()
        video = None if self.estimator is None else VideoDepth(self.estimator)
        watched, kept, interrupted = WatchedSource(source), 0, False
        start_ns = 0 if isinstance(source, Video) else source.started_ns
        path = self.output.path / f"{name}.mcap"
        with self.output.staged(complete=False) as folder, BagWriter(folder / path.name) as bag:
            try:
                with self.reporter.work("decode", name, "frames") as advance:
                    for item in islice(decoded_ahead(self.decoder, watched), self.limit):
                        if isinstance(item, Lost):
                            lost[item.number] = item.reason
                        else:
                            self._write(bag, *item, video, first=not kept, start_ns=start_ns)
                            kept += 1
                        advance(kept + len(lost), max(kept + len(lost), expected or 0))
            except KeyboardInterrupt:
                interrupted = True
                if not (isinstance(source, LiveCamera) and kept):
                    raise
            for line in losses(source, kept, lost, None if interrupted else expected):
                self.reporter.note("decode", f"{name}: {line}")
            if not kept:
                raise NothingDecoded(f"{name}: no frame could be decoded, expected at least one")
        self.reporter.note("decode", f"{path} written: {count_text(kept, 'frame')}")
        if self.check is not None:
            self.check.report(watched.sample.frames, f"{name}_{self.check.file}", sources_text(source))
        if interrupted:
            raise KeyboardInterrupt
        return len(lost) + max((expected or 0) - kept - len(lost), 0)

    def _write(
        self,
        bag: BagWriter,
        frame: Frame,
        light_field: LightField,
        video: VideoDepth | None,
        *,
        first: bool,
        start_ns: int,
    ) -> None:
        depth = None if video is None else video.estimate(light_field)
        stamp = stamp_ns(frame.time_s, start_ns)
        latched = latched_messages(light_field, stamp) if first else ()
        bag.write([*latched, *frame_messages(light_field, stamp, depth)], stamp)
        if self.show is not None:
            self.show(frame.time_s, light_field, depth)
