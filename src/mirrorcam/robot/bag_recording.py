"""A video or a camera's stream becomes a ROS 2 bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from mirrorcam.core.console.reporter import Reporter
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.pictures import is_picture
from mirrorcam.core.values import InputError
from mirrorcam.core.video.frames import Frame, Lost, WatchedSource
from mirrorcam.core.video.live_camera import LiveCamera
from mirrorcam.core.video.stream_losses import Stream, expected_frames, losses, sources_text
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, VideoDepth
from mirrorcam.optics.light_field.io.bag_writer import BagWriter, Compression, need_rosbags
from mirrorcam.optics.light_field.io.recording import NothingDecoded
from mirrorcam.optics.light_field.io.ros_messages import frame_messages, latched_messages, stamp_ns
from mirrorcam.optics.light_field.io.stream import RecordingCheck, decoded_ahead
from mirrorcam.optics.light_field.light_field import LightField

ShowDepth = Callable[[float, LightField, DepthMap | None], None]
"""What else happens to a frame: its time in s, its light field, and its depth where that is measured."""


def refuse_bag(path: Path, frames: Sequence[Path], output: OutputFolder, check: RecordingCheck | None) -> None:
    """Raise InputError for a name that is none of a bag, or taken, and for frames that are not one video.

    Like all recordings, bags are never replaced.
    """
    need_rosbags()
    if len(frames) > 1 or any(map(is_picture, frames)):
        raise InputError(f"--mcap {path}: expected one video or --device; pictures have no times")
    if path.suffix != ".mcap":
        raise InputError(f"--mcap {path}: expected a name that ends in .mcap")
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists, and recordings are never replaced: expected a new name")
    if check is not None:
        output.refuse_others(f"{path.stem}_{check.file}")


@dataclass(frozen=True)
class BagRecorder:
    """Decodes a stream into a ROS 2 bag, with depth where there is an estimator, up to `limit` frames."""

    decoder: Decoder
    output: OutputFolder
    path: Path
    compression: Compression
    estimator: DepthEstimator | None
    limit: int | None
    reporter: Reporter
    check: RecordingCheck | None = None
    show: ShowDepth | None = None

    def record(self, source: Stream, name: str, origin: dict[str, Any]) -> int:
        """Decode a stream; of a camera, what was decoded until Ctrl-C is kept, of a video only all of it.

        Returns the number of frames that it states and that could not be used. Raises InputError for a stream without a
        frame that can be used, and where nothing can be written.
        """
        expected, lost = expected_frames(source, self.limit), dict[int, str]()
        video = None if self.estimator is None else VideoDepth(self.estimator)
        watched, kept, interrupted = WatchedSource(source), 0, False
        start_ns = source.started_ns if isinstance(source, LiveCamera) else 0
        with self.output.staged(complete=False) as folder, BagWriter(folder / self.path.name, self.compression) as bag:
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
                raise NothingDecoded(f"{name}: not one frame could be decoded, expected at least one")
        self.reporter.note("decode", f"{self.path} written: {count_text(kept, 'frame')}")
        if self.check is not None:
            self.check.report(watched.seen.kept, f"{self.path.stem}_{self.check.file}", sources_text(source))
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
        before = latched_messages(light_field, stamp) if first else ()
        bag.write([*before, *frame_messages(light_field, stamp, depth)], stamp)
        if self.show is not None:
            self.show(frame.time_s, light_field, depth)
