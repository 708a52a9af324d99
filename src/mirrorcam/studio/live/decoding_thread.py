"""The thread of a live session that has frames decoded as they are ordered, and hands on what becomes of each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from mirrorcam.core.disk.files import numbered
from mirrorcam.core.processes.worker_process import WorkerDied
from mirrorcam.core.values import InputError
from mirrorcam.studio.live.depth_thread import DepthThread
from mirrorcam.studio.live.pictures import LivePictures
from mirrorcam.studio.live.session import close_session, next_pictures, open_session
from mirrorcam.studio.live.setup_thread import SetupThread
from mirrorcam.studio.live.status import LiveMeters
from mirrorcam.studio.live.values import Answer, LiveRequest, Orders, SessionAbout
from mirrorcam.studio.live.worker import LiveWorker

OVER_S = 0.2
"""Time between questions of what is new, once the source has ended."""


class DecodingThread:
    """Puts pictures of frames, and gives depth and setup what they want of them.

    Parameters
    ----------
    request
        What is shown.
    pictures, meters
        Where pictures go, and what counts them.
    depth, setup
        What is given samples, frames and calibration pictures.
    hold
        Whether a source that ends waits for `play`.
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
        self._request, self._pictures, self._meters, self._depth, self._setup = request, pictures, meters, depth, setup
        self._orders = Orders(plays=0 if hold else 1)
        self._ends = False
        self._worker = LiveWorker("decoding", self._decode, meters.fail)

    @property
    def recording(self) -> Path | None:
        """The video that frames go to."""
        return self._orders.record

    def open(self) -> SessionAbout:
        """Open the source. Raises InputError where that cannot be."""
        about: SessionAbout = self._worker.process.call(open_session, self._request)
        self._ends = about.kind != "camera"
        return about

    def start(self) -> None:
        """Begin."""
        self._worker.start()

    def order(self, **changes: Any) -> None:
        """Change what is wanted of frames from the next one on, fields of `Orders`."""
        with self._worker.changed:
            self._orders = replace(self._orders, **changes)

    def play(self, *, again: bool) -> None:
        """Let a source that waits begin; `again`: let one that has ended play from its start."""
        with self._worker.changed:
            if self._orders.plays == 0 or again:
                self._orders = replace(self._orders, plays=self._orders.plays + 1)
                self._worker.changed.notify_all()

    def take(self, folder: Path) -> Path:
        """Have the next frame written below a folder, and return its path."""
        with self._worker.changed:
            path = self._orders.take or numbered(folder, "picture", ".png")
            self._orders = replace(self._orders, take=path)
        return path

    def close(self) -> None:
        """Finish the recording, and end."""
        self._worker.close()

    def _decode(self) -> None:
        process, changed, ending = self._worker.process, self._worker.changed, self._worker.ending
        with changed:
            changed.wait_for(lambda: ending.is_set() or not self._ends or self._orders.plays > 0)
        while not ending.is_set():
            orders = self._ordered()
            try:
                answer: Answer = process.call(next_pictures, orders)
            except InputError as error:
                if orders.take is None and orders.record is None:
                    raise
                # A file that cannot be written ends what it was for, not the session.
                self._meters.say(str(error))
                self.order(take=None, record=None)
                continue
            self._hand_on(answer, orders)
            if answer.over:
                self._rest(orders.plays)
        try:
            for line in process.call(close_session):
                self._meters.say(line)
        except (InputError, RuntimeError, WorkerDied) as error:
            self._meters.say(str(error))

    def _rest(self, plays: int) -> None:
        """After the end of a source that has played a number of times: wait for more to do."""
        with self._worker.changed:
            if self._orders.plays == plays:
                # What frames went to ends with them: played again, they begin anew.
                if self._orders.take is not None:
                    self._meters.say("the source has ended before the calibration picture was taken")
                self._orders = replace(self._orders, record=None, take=None)
            ending = self._worker.ending
            self._worker.changed.wait_for(lambda: ending.is_set() or self._orders.plays > plays, timeout=OVER_S)

    def _ordered(self) -> Orders:
        """What is ordered, without what nobody waits for, and with what depth and setup want."""
        with self._worker.changed:
            orders = self._orders
        return replace(
            orders,
            kinds=tuple(kind for kind in orders.kinds if self._pictures.wanted(kind)),
            depth=self._depth.wants_samples,
            frames=self._setup.wants_frames,
        )

    def _hand_on(self, answer: Answer, orders: Orders) -> None:
        """Pass on what a frame has become, then count it; orders that have been carried out are orders no more."""
        shown = answer.shown
        with self._worker.changed:
            if orders.reset_focus:
                self._orders = replace(self._orders, reset_focus=False)
            if shown is not None and shown.taken is not None and self._orders.take == shown.taken:
                self._orders = replace(self._orders, take=None)
        if shown is not None:
            for kind, jpeg in shown.jpegs.items():
                self._pictures.put(kind, shown, jpeg)
            if shown.samples is not None:
                self._depth.give(replace(shown, jpegs={}, frames=()), shown.samples)
            if shown.frames:
                self._setup.give_frames(shown.frames)
            if shown.taken is not None:
                self._setup.give_picture(shown.taken)
        self._meters.note(answer)
