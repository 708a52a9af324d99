"""The recording of a live session: every frame that arrives while it is on, however fast frames become pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mirrorcam.core.values import InputError
from mirrorcam.core.video.background_recorder import FINISHING_S, BackgroundRecorder, RecordingCounts
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.optics.geometry.camera import Camera

WRITING_S = 1.0
"""Time that a write which has begun has to end, when the session is closed."""


class LiveRecording:
    """Records to one file after another, as ordered.

    Parameters
    ----------
    camera
        The camera whose size frames have.
    tell
        Takes a line when frames are lost, and when a file is finished.
    """

    def __init__(self, camera: Camera, tell: Callable[[str], None]) -> None:
        self._camera, self._tell = camera, tell
        self._recorder: BackgroundRecorder | None = None
        self._finishing: list[BackgroundRecorder] = []
        self._told_lost = False

    @property
    def counts(self) -> RecordingCounts:
        """What has become of the frames of the recording that runs."""
        return RecordingCounts() if self._recorder is None else self._recorder.counts

    def give(self, item: Frame | Lost) -> None:
        """Record what arrives, in the thread that reads the source."""
        recorder = self._recorder
        if recorder is not None:
            recorder.give(item)

    def order(self, path: Path | None) -> None:
        """Record into a file from now on; None: into none.

        Raises InputError, once, where its disk takes no more.
        """
        self._tell_finished()
        recorder = self._recorder
        if recorder is not None and recorder.path != path:
            self._stop(recorder)
            recorder = None
        if path is None:
            return
        if recorder is None:
            self._told_lost = False
            self._recorder = BackgroundRecorder(path, self._camera.width_px, self._camera.height_px)
        elif recorder.failed is not None:
            self._recorder = None
            recorder.finish()
            recorder.finished(WRITING_S)
            raise InputError(str(recorder))
        elif recorder.counts.too_slow and not self._told_lost:
            self._told_lost = True
            self._tell(f"{path}: frames are lost, as they come faster than they can be written")

    def close(self) -> None:
        """Finish all files."""
        if self._recorder is not None:
            self._stop(self._recorder)
        self._tell_finished(FINISHING_S + WRITING_S)

    def _stop(self, recorder: BackgroundRecorder) -> None:
        self._recorder = None
        recorder.finish()
        self._finishing.append(recorder)

    def _tell_finished(self, timeout_s: float = 0.0) -> None:
        """Tell of files that are finished, at the latest after a time."""
        for recorder in list(self._finishing):
            if recorder.finished(timeout_s):
                self._finishing.remove(recorder)
                self._tell(str(recorder))
