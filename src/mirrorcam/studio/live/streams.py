"""The streams of a live session: the source of frames, and their recording."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirrorcam.core.disk.bags import is_bag
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import check_size, picture_size, pictures_in, read_image
from mirrorcam.core.video.background_recorder import FINISHING_S, BackgroundRecorder, RecordingCounts
from mirrorcam.core.video.camera_addresses import existing, is_sdp, open_camera, without_password
from mirrorcam.core.video.frames import Frame, Lost, Source
from mirrorcam.core.video.video_files import open_video
from mirrorcam.optics.geometry.camera import Camera

FOLDER_HZ = 5.0
"""Frame rate of a folder of pictures."""

Kind = Literal["camera", "video", "folder"]


class PictureFolder:
    """The pictures of a folder as frames, sorted by name; `on_note` is called about its other files.

    Raises InputError for a folder without pictures, or if the size of the first differs from the layout's camera.
    """

    def __init__(self, folder: Path, size: tuple[int, int], on_note: Callable[[str], None] = lambda line: None) -> None:
        self._paths, self._stopped, self._size = pictures_in([folder], on_note), threading.Event(), size
        check_size(self._paths[0], picture_size(self._paths[0]), size, "the layout's camera")

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Yield the pictures after number `after`; raises InputError for one of another size."""
        for number, path in enumerate(self._paths):
            if number <= after:
                continue
            if self._stopped.is_set():
                return
            try:
                pixels = read_image(path)
            except DamagedPicture:
                yield Lost(number, "is damaged")
                continue
            check_size(path, (pixels.shape[1], pixels.shape[0]), self._size, "the layout's camera")
            yield Frame(number, number / FOLDER_HZ, pixels)

    def stop(self) -> None:
        """End `frames`."""
        self._stopped.set()


@dataclass(frozen=True)
class LiveSource:
    """A source of frames, with its name and kind; all but cameras are read at their stated times."""

    source: Source
    name: str
    kind: Kind

    @property
    def ends(self) -> bool:
        """Whether it is finite, and can be read again from its start; a camera is not."""
        return self.kind != "camera"


def open_source(text: str, expected: Camera, on_note: Callable[[str], None] = lambda line: None) -> LiveSource:
    """Open a source by name: a folder, a video file, or the number or address of a camera.

    Parameters
    ----------
    text
        Name of the source.
    expected
        Camera whose picture size the frames must have.
    on_note
        Called with lines about outages of a camera, remarks on a video, and ignored files of a folder.

    Raises
    ------
    InputError
        If the source cannot be opened, or its frames have another size.
    """
    size = expected.width_px, expected.height_px
    is_number = text.isascii() and text.isdigit()
    path = None if is_number else existing(text)
    if path is not None and path.is_dir() and not is_bag(path):
        return LiveSource(PictureFolder(path, size, on_note), path.name, "folder")
    if path is not None and not is_sdp(path):
        video = open_video(path, on_note)
        check_size(path, (video.width_px, video.height_px), size, "the layout's camera")
        return LiveSource(video, path.name, "video")
    if not is_number and path is None and "://" not in text and not text.startswith("/dev/"):
        raise InputError(
            f"{text}: no such file, expected a video, a folder of pictures, or a camera's number or address"
        )
    return LiveSource(open_camera(text, *size, on_note=on_note), without_password(text), "camera")


WRITING_S = 1.0
"""Time for a pending write to end when the session is closed."""


class LiveRecording:
    """Records frames to one file after another, as ordered.

    Parameters
    ----------
    camera
        Camera whose picture size the frames have.
    on_note
        Called with a line when frames are lost, and when a file is finished.
    """

    def __init__(self, camera: Camera, on_note: Callable[[str], None]) -> None:
        self._camera, self._on_note = camera, on_note
        self._recorder: BackgroundRecorder | None = None
        self._finishing: list[BackgroundRecorder] = []
        self._reported_loss = False

    @property
    def counts(self) -> RecordingCounts:
        """Counts of the current recording."""
        return RecordingCounts() if self._recorder is None else self._recorder.counts

    def give(self, item: Frame | Lost) -> None:
        """Record a frame; called in the thread that reads the source."""
        recorder = self._recorder
        if recorder is not None:
            recorder.give(item)

    def order(self, path: Path | None) -> None:
        """Record to a file from now on, or stop (None).

        Raises InputError, once, if the disk fails.
        """
        self._report_finished()
        recorder = self._recorder
        if recorder is not None and recorder.path != path:
            self._stop(recorder)
            recorder = None
        if path is None:
            return
        if recorder is None:
            self._reported_loss = False
            self._recorder = BackgroundRecorder(path, self._camera.width_px, self._camera.height_px)
        elif recorder.failed is not None:
            self._recorder = None
            recorder.finish()
            recorder.finished(WRITING_S)
            raise InputError(str(recorder))
        elif recorder.counts.too_slow and not self._reported_loss:
            self._reported_loss = True
            self._on_note(f"{path}: frames are lost: they come faster than they can be written")

    def close(self) -> None:
        """Finish all files."""
        if self._recorder is not None:
            self._stop(self._recorder)
        self._report_finished(FINISHING_S + WRITING_S)

    def _stop(self, recorder: BackgroundRecorder) -> None:
        self._recorder = None
        recorder.finish()
        self._finishing.append(recorder)

    def _report_finished(self, timeout_s: float = 0.0) -> None:
        """Report finished files, and wait for each at most `timeout_s`."""
        for recorder in list(self._finishing):
            if recorder.finished(timeout_s):
                self._finishing.remove(recorder)
                self._on_note(str(recorder))
