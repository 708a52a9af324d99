"""The pictures of a calibration: files as they are, and of each video its sharpest frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mirrorcam.core.images.pictures import check_size, is_picture, pictures_in, read_image
from mirrorcam.core.values import InputError
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import MISSING, Video
from mirrorcam.optics.calibration.corner_files import SUFFIX as MRCAL_SUFFIX
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.frame_choice import SharpestFrames, SharpFrame
from mirrorcam.optics.geometry.camera import Camera

SEARCHED = 60
"""Frames of a video in which boards are searched."""


@dataclass(frozen=True, eq=False)
class CalibrationPictures:
    """Pictures to search, each a file or the grey values (h, w) of a frame, and their names.

    `most` is the number of them to use, where there are frames of a video among them; else None, all. `sources` has the
    video and frame number of each; None for a picture.
    """

    pictures: list[Path | Grey]
    names: list[str]
    most: int | None
    sources: list[tuple[Path, int] | None]

    @property
    def labels(self) -> list[str]:
        """Names that tell pictures of several folders apart: paths as given, and frames of videos."""
        return [
            each.as_posix() if source is None and isinstance(each, Path) else name
            for each, name, source in zip(self.pictures, self.names, self.sources, strict=True)
        ]

    def read(self) -> list[Grey]:
        """All of them in grey; raises InputError for a file that cannot be read."""
        return [read_image(each, grey=True) if isinstance(each, Path) else each for each in self.pictures]

    def beside(self, numbers: Sequence[int]) -> list[tuple[Grey, Grey] | None]:
        """The frames before and after some pictures; None for one that is no frame of a video, or lacks either."""
        wanted: dict[Path, set[int]] = {}
        for source in (self.sources[number] for number in numbers):
            if source is not None:
                wanted.setdefault(source[0], set()).update((source[1] - 1, source[1] + 1))
        found = {path: _frames(path, frames) for path, frames in wanted.items()}
        pairs: list[tuple[Grey, Grey] | None] = []
        for source in (self.sources[number] for number in numbers):
            of_video = {} if source is None else found[source[0]]
            before, after = (None if source is None else of_video.get(source[1] + step) for step in (-1, 1))
            pairs.append(None if before is None or after is None else (before, after))
        return pairs


def calibration_pictures(
    paths: Sequence[Path], most: int, *, camera: Camera | None = None, tell: Callable[[str], None]
) -> CalibrationPictures:
    """The pictures of files, folders and videos, in order.

    Parameters
    ----------
    paths
        Picture files, folders of them, and videos.
    most
        Number of pictures to use where there is a video among them.
    camera
        Whose size videos must have; None for any.
    tell
        Called with a sentence about each video: what to know of it, how many of its frames were chosen, and how long it
        took; and about files of folders that are left out, and pictures of 16 bits.

    Raises
    ------
    InputError
        For a folder without pictures, and for a file that is neither a picture nor a video, or of another size.
    """
    pictures: list[Path | Grey] = []
    names: list[str] = []
    sources: list[tuple[Path, int] | None] = []
    for path in pictures_in(paths, tell):
        if is_picture(path):
            pictures.append(path)
            names.append(path.name)
            sources.append(None)
            continue
        if path.suffix.lower() in (".csv", MRCAL_SUFFIX):
            raise InputError(f"{path}: a table of corners, expected pictures: give it with --corners")
        for frame in _sharp_frames(path, camera, tell):
            pictures.append(frame.picture)
            names.append(f"{path.name} frame {frame.number}")
            sources.append((path, frame.number))
    return CalibrationPictures(pictures, names, most if any(sources) else None, sources)


def _sharp_frames(path: Path, camera: Camera | None, tell: Callable[[str], None]) -> list[SharpFrame]:
    started = time.monotonic()
    video, kept, count, damaged, missing = Video(path, tell), SharpestFrames(SEARCHED), 0, 0, 0
    if camera is not None:
        check_size(path, (video.width_px, video.height_px), (camera.width_px, camera.height_px), "the layout's camera")
    if video.sample_bits.largest:
        tell(f"{path.name}: {video.sample_bits}")
    for frame in video.frames():
        count += 1
        if not isinstance(frame, Frame):
            missing += frame.reason == MISSING
            damaged += frame.reason != MISSING
            continue
        kept.add(SharpFrame.of(frame.number, _grey(frame)))
    chosen = kept.chosen()
    if not chosen:
        raise InputError(f"{path}: none of its {count} frames can be read, expected a video of a board")
    lost = f", {damaged} of them damaged" if damaged else ""
    lost += f", {missing} more missing by its times" if missing else ""
    tell(
        f"{path.name}: the {len(chosen)} sharpest of {count - missing} frames, from all of the video{lost}, "
        f"read in {time.monotonic() - started:.1f} s"
    )
    return chosen


def _frames(path: Path, numbers: set[int]) -> dict[int, Grey]:
    """Frames of a video by their numbers, without those that are not there or damaged."""
    found: dict[int, Grey] = {}
    for frame in Video(path).frames():
        if frame.number > max(numbers):
            break
        if frame.number in numbers and isinstance(frame, Frame):
            found[frame.number] = _grey(frame)
    return found


def _grey(frame: Frame) -> Grey:
    return np.asarray(cv2.cvtColor(frame.pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
