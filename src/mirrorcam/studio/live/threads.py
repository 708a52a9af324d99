"""The threads of a live session: each passes work to a process, and publishes the results."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import numbered
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_process import WorkerDied, WorkerProcess
from mirrorcam.studio.live.depth import LiveDepth
from mirrorcam.studio.live.session import LiveSession
from mirrorcam.studio.live.setup import Aligning, AlignmentReport, LiveSetup, PoseHint
from mirrorcam.studio.live.status import LiveMeters
from mirrorcam.studio.live.values import Answer, FrameResults, LivePictures, LiveRequest, Orders, SessionAbout

Result = TypeVar("Result")
ENDING_S = 5.0
"""Time for work to end by itself."""

_resident: list[Any] = []
"""In a worker process: the object whose methods it calls."""


def _make(kind: Callable[..., object], *arguments: Any) -> None:
    _resident[:] = [kind(*arguments)]


def _apply(method: Callable[..., Result], *arguments: Any) -> Result:
    return method(_resident[0], *arguments)


class LiveWorker:
    """A thread that calls methods of an object in a worker process, as a subclass defines in `_work`; must be closed.

    Parameters
    ----------
    purpose
        Purpose, for messages.
    fail
        Called with one line if `_work` fails before `close`.
    at_once
        Whether `close` ends a call in progress; otherwise it waits for ENDING_S.
    """

    def __init__(self, purpose: str, fail: Callable[[str], None], *, at_once: bool = True) -> None:
        self._purpose, self._fail, self._at_once = purpose, fail, at_once
        self._process, self._changed, self._ending = WorkerProcess(), threading.Condition(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"live {purpose}", daemon=True)

    def start(self) -> None:
        """Begin the work."""
        self._thread.start()

    def close(self) -> None:
        """End the thread and the process."""
        with self._changed:
            self._ending.set()
            self._changed.notify_all()
        if self._at_once:
            self._process.close()
        if self._thread.ident is not None:
            self._thread.join(ENDING_S)
        self._process.close()

    def _work(self) -> None:
        """Work until `_ending` is set; `_changed` is notified then."""
        raise NotImplementedError

    def _make(self, kind: Callable[..., object], *arguments: Any) -> None:
        """Make the object in the process."""
        self._process.call(_make, kind, *arguments)

    def _call(self, method: Callable[..., Result], *arguments: Any) -> Result:
        """Call a method of the object in the process."""
        result: Result = self._process.call(_apply, method, *arguments)
        return result

    def _run(self) -> None:
        try:
            self._work()
        except (InputError, RuntimeError, WorkerDied) as error:
            if not self._ending.is_set():
                died = isinstance(error, WorkerDied)
                self._fail(f"the process for {self._purpose} has ended {error}" if died else str(error))


class DepthThread(LiveWorker):
    """Publishes pictures of depth; a newer input replaces a waiting one.

    Parameters
    ----------
    layout
        layout.json.
    width_px
        Width of the views in which depth is estimated.
    pictures, meters
        Receive pictures, and count them.
    """

    def __init__(self, layout: Path, width_px: int, pictures: LivePictures, meters: LiveMeters) -> None:
        super().__init__("depth", partial(meters.fail_part, "depth"))
        self._layout, self._width_px = layout, width_px
        self._pictures, self._meters = pictures, meters
        self._input: tuple[FrameResults, NDArray[np.uint8]] | None = None

    @property
    def wants_samples(self) -> bool:
        """Whether depth needs the samples of the next frame."""
        return self._input is None and self._pictures.wanted("depth")

    def give(self, results: FrameResults, samples: NDArray[np.uint8]) -> None:
        """Estimate depth in the samples (t, s, v, u, 3) of a frame next."""
        with self._changed:
            self._input = (results, samples)
            self._changed.notify_all()

    def _work(self) -> None:
        self._make(LiveDepth, self._layout, self._width_px)
        while (item := self._next()) is not None:
            results, samples = item
            picture = self._call(LiveDepth.measure, samples)
            self._meters.note_depth(results, picture.median_mm)
            self._pictures.put("depth", results, picture.jpeg, picture.depth_mm)

    def _next(self) -> tuple[FrameResults, NDArray[np.uint8]] | None:
        """Wait for the newest input; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._input is not None or self._ending.is_set())
            item, self._input = self._input, None
            return None if self._ending.is_set() else item


class SetupThread(LiveWorker):
    """Keeps the newest report of the mirrors and the newest hint; pictures take precedence over frames.

    Parameters
    ----------
    layout
        layout.json.
    board
        board.toml; None if no calibration pictures are taken.
    meters
        Receive the message of a failure.

    Attributes
    ----------
    report : AlignmentReport or None
        Alignment from the last frames; None before the first result since it was switched on.
    hint : PoseHint or None
        Hint after the last calibration picture.
    """

    def __init__(self, layout: Path, board: Path | None, meters: LiveMeters) -> None:
        super().__init__("setup", partial(meters.fail_part, "setup"))
        self._layout, self._board = layout, board
        self._aligning, self._restart, self._switch_count = False, True, 0
        self._frames: tuple[NDArray[np.uint8], ...] = ()
        self._pictures: deque[Path] = deque()
        self.report: AlignmentReport | None = None
        self.hint: PoseHint | None = None

    @property
    def aligning(self) -> Aligning:
        """Whether mirrors are compared with the layout."""
        with self._changed:
            return "off" if not self._aligning else "measuring" if self._frames else "waiting"

    def align(self, on: bool) -> None:
        """Switch the repeated comparison of mirrors with the layout on, from the start, or off."""
        with self._changed:
            self._aligning, self._restart, self._frames = on, True, ()
            if on:
                self._switch_count, self.report = self._switch_count + 1, None

    def give_frames(self, frames: tuple[NDArray[np.uint8], ...]) -> None:
        """Compare mirrors in grey frames (h, w) next."""
        with self._changed:
            self._frames = frames
            self._changed.notify_all()

    def give_picture(self, path: Path) -> None:
        """Find the board in a calibration picture next."""
        with self._changed:
            self._pictures.append(path)
            self._changed.notify_all()

    def _work(self) -> None:
        self._make(LiveSetup, self._layout, self._board)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._pictures or self._frames) or self._ending.is_set())
                if self._ending.is_set():
                    return
                path = self._pictures.popleft() if self._pictures else None
                frames, restart, switch_count = self._frames, self._restart, self._switch_count
                if path is None:
                    self._restart = False
            if path is not None:
                self.hint = self._call(LiveSetup.add_picture, path)
                continue
            report = self._call(LiveSetup.align, frames, restart)
            with self._changed:
                if self._switch_count == switch_count:
                    self.report, self._frames = report, ()


ENDED_POLL_S = 0.2
"""Polling interval once the source has ended."""


class DecodingThread(LiveWorker):
    """Publishes pictures of frames, and passes frames to depth and setup when needed.

    Parameters
    ----------
    request
        Request of the session.
    pictures, meters
        Receive pictures, and count them.
    depth, setup
        Receive samples, frames and calibration pictures.
    hold
        Whether a finite source waits for `play`.
    """

    def __init__(
        self,
        request: LiveRequest,
        *,
        pictures: LivePictures,
        meters: LiveMeters,
        depth: DepthThread,
        setup: SetupThread,
        hold: bool = False,
    ) -> None:
        super().__init__("decoding", meters.fail, at_once=False)  # a recording is finished
        self._request, self._pictures, self._meters, self._depth, self._setup = request, pictures, meters, depth, setup
        self._orders = Orders(plays=0 if hold else 1)
        self._ends = False

    @property
    def recording(self) -> Path | None:
        """The video to which frames are recorded."""
        return self._orders.record

    def open(self) -> SessionAbout:
        """Open the source. Raises InputError if that fails."""
        self._make(LiveSession, self._request)
        about = self._call(LiveSession.about)
        self._ends = about.kind != "camera"
        return about

    def order(self, **changes: Any) -> None:
        """Change the orders, fields of `Orders`, from the next frame on."""
        with self._changed:
            self._orders = replace(self._orders, **changes)

    def play(self, *, again: bool) -> None:
        """Start a waiting source; with `again`, restart one that has ended."""
        with self._changed:
            if self._orders.plays == 0 or again:
                self._orders = replace(self._orders, plays=self._orders.plays + 1)
                self._changed.notify_all()

    def take(self, folder: Path) -> Path:
        """Write the next frame into a folder, and return its path."""
        with self._changed:
            path = self._orders.take or numbered(folder, "picture", ".png")
            self._orders = replace(self._orders, take=path)
        return path

    def _work(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._ending.is_set() or not self._ends or self._orders.plays > 0)
        while not self._ending.is_set():
            orders = self._current_orders()
            try:
                answer = self._call(LiveSession.next, orders)
            except InputError as error:
                if orders.take is None and orders.record is None:
                    raise
                # A write error ends the recording or picture, not the session.
                self._meters.say(str(error))
                self.order(take=None, record=None)
                continue
            self._distribute(answer, orders)
            if answer.ended:
                self._wait_after_end(orders.plays)
        try:
            for line in self._call(LiveSession.close):
                self._meters.say(line)
        except (InputError, RuntimeError, WorkerDied) as error:
            self._meters.say(str(error))

    def _wait_after_end(self, plays: int) -> None:
        """Wait after the source has ended for the `plays`-th time."""
        with self._changed:
            if self._orders.plays == plays:
                # Recording and picture end with the source.
                if self._orders.take is not None:
                    self._meters.say("the source has ended before the calibration picture was taken")
                self._orders = replace(self._orders, record=None, take=None)
            self._changed.wait_for(lambda: self._ending.is_set() or self._orders.plays > plays, timeout=ENDED_POLL_S)

    def _current_orders(self) -> Orders:
        """Return the orders without unwatched pictures, but with the needs of depth and setup."""
        orders = self._orders
        return replace(
            orders,
            kinds=tuple(kind for kind in orders.kinds if self._pictures.wanted(kind)),
            depth=self._depth.wants_samples,
            frames=self._setup.aligning == "waiting",
        )

    def _distribute(self, answer: Answer, orders: Orders) -> None:
        """Distribute the results of a frame, count it, and remove completed orders."""
        results = answer.results
        with self._changed:
            if orders.reset_focus:
                self._orders = replace(self._orders, reset_focus=False)
            if results is not None and results.taken is not None and self._orders.take == results.taken:
                self._orders = replace(self._orders, take=None)
        if results is not None:
            for kind, jpeg in results.jpegs.items():
                self._pictures.put(kind, results, jpeg)
            if results.samples is not None:
                self._depth.give(replace(results, jpegs={}, frames=()), results.samples)
            if results.frames:
                self._setup.give_frames(results.frames)
            if results.taken is not None:
                self._setup.give_picture(results.taken)
        self._meters.note(answer)
