"""The engine of a camera on the page: frames, views, refocused pictures and depth of a camera, as a page shows them.

The engine's own process does no heavy work. One process decodes and encodes, one estimates depth at its own rate, and
one aligns and detects boards; a thread of the engine serves each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.background_recorder import new_recording
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.jobs import PICTURES
from mirrorcam.studio.live.status import LiveMeters, LiveStatus
from mirrorcam.studio.live.threads import DecodingThread, DepthThread, SetupThread
from mirrorcam.studio.live.values import LivePicture, LivePictures, LiveRequest, PictureKind, SessionAbout

OUTLINE_POINTS = 8
"""Number of points on each edge of an outline."""


class LiveEngine:
    """A live session. Use it in a `with` block, or `close` it.

    Parameters
    ----------
    request
        Layout, source and sizes of the session.
    out
        Folder for recordings and calibration pictures.
    board
        board.toml, to take calibration pictures.
    idle_s
        Time after which pictures of a kind that `wait_for` did not request are no longer made; by default, they always
        are.
    hold
        Whether a source that ends (a video, a folder) waits for `begin`; a camera does not.
    on_note
        Called with each message of the session, in a thread of the engine.

    Attributes
    ----------
    about : SessionAbout
        Properties of the session.
    focus_mm : float
        Depth of the refocused picture.

    Raises
    ------
    InputError
        If the layout, the board or the source cannot be opened.
    """

    def __init__(
        self,
        request: LiveRequest,
        *,
        out: Path = Path("output/live"),
        board: Path | None = None,
        idle_s: float | None = None,
        hold: bool = False,
        on_note: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.request, self.out, self.board = request, out, board
        self._pictures, self._meters = LivePictures(idle_s), LiveMeters(on_note)
        self._depth = DepthThread(request.layout, request.depth_width_px, self._pictures, self._meters)
        self._setup = SetupThread(request.layout, board, self._meters)
        self._decoding = DecodingThread(
            request, pictures=self._pictures, meters=self._meters, depth=self._depth, setup=self._setup, hold=hold
        )
        self._workers = (self._depth, self._setup, self._decoding)
        try:
            self.about: SessionAbout = self._decoding.open()
            self.focus_mm = self.about.reference_mm
        except BaseException:
            self.close()
            raise
        for worker in self._workers:
            worker.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Finish the recording and end all processes."""
        self._pictures.end()
        for worker in self._workers:
            worker.close()

    def outlines_px(self) -> dict[str, list[list[float]]]:
        """Outline (n, 2) of each mirror's sub-image as designed, in pixels of the camera, by the mirror's name."""
        layout = Layout.load(self.request.layout)
        outlines = {}
        for k, name in enumerate(layout.mirror_names):
            outline = layout.outline_px(k, points_per_edge=OUTLINE_POINTS, usable=True)
            outlines[name] = outline[np.isfinite(outline).all(axis=1)].round(1).tolist()
        return outlines

    def begin(self) -> None:
        """Start a waiting source; no effect on a started one."""
        self._decoding.play(again=False)

    def play_again(self) -> None:
        """Restart a source that has ended. Raises InputError if it has not ended, or has failed."""
        status = self._meters.status
        if status.failed is not None or not status.over:
            raise InputError(f"{self.about.source} is playing or has failed, expected a source that has ended")
        self._decoding.play(again=True)

    def latest(self, kind: PictureKind) -> LivePicture | None:
        """The newest picture of a kind; None before the first."""
        return self._pictures.latest(kind)

    def wait_for(self, kind: PictureKind, after: int, timeout_s: float) -> LivePicture | None:
        """Wait for a picture of a kind with a serial number above `after`; None if none arrives in time."""
        return self._pictures.wait_for(kind, after, timeout_s)

    def focus(self, depth_mm: float) -> None:
        """Refocus at a depth from the next frame on. Raises InputError for a depth that is not beyond the views."""
        if not depth_mm > self.about.least_focus_mm:
            limit = f"more than {self.about.least_focus_mm:.0f} mm"
            raise InputError(f"focus at {depth_mm:g} mm, expected a depth beyond the views, {limit}")
        self.focus_mm = depth_mm
        self._decoding.order(focus_mm=depth_mm)

    def align(self, on: bool) -> None:
        """Switch the repeated comparison of mirrors with the layout on, from the start, or off."""
        self._setup.align(on)

    def reset_focus_meter(self) -> None:
        """Reset the best sharpness so far."""
        self._decoding.order(reset_focus=True)

    def record(self) -> Path:
        """Write every frame to a new video from the next one on, and return its path.

        Raises InputError if the source has ended, or the folder cannot be written.
        """
        self._refuse_ended()
        path = new_recording(self.out / "recordings")
        self._decoding.order(record=path)
        return path

    def stop_recording(self) -> None:
        """Finish the video."""
        self._decoding.order(record=None)

    def take_picture(self) -> Path:
        """Write the next frame as a calibration picture, without loss, and return its path; `status` has the hint.

        Raises InputError without a board, or if the source has ended.
        """
        self._refuse_ended()
        if self.board is None:
            raise InputError("no board is stated, expected --board board.toml to take calibration pictures")
        return self._decoding.take(self.out / PICTURES)

    def status(self) -> LiveStatus:
        """The state of the session."""
        return replace(
            self._meters.status,
            aligning=self._setup.aligning,
            alignment=self._setup.report,
            hint=self._setup.hint,
            pictures_kept=sum(1 for _ in (self.out / PICTURES).glob("picture_*.png")),
            recording=self._decoding.recording,
        )

    def _refuse_ended(self) -> None:
        if self._meters.status.ended:
            raise InputError(f"{self.about.source} has ended, expected a source with more frames")
